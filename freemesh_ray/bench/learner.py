"""Updates a second of whole training rounds, beside Stable-Baselines3's."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from freemesh_ray.bench.ours_and_sb3 import DOMAIN, RATIO, algorithm, stable_baselines
from freemesh_ray.formatting.table import table
from freemesh_ray.formatting.terminal import say
from freemesh_ray.local_ray import local_ray

THEIRS = "Stable-Baselines3"
#: Times that each is measured.
RUNS = 3
#: Settings that make updates cheaper, by what they are called here.
WAYS: dict[str, dict[str, Any]] = {
    "float32": {},
    "bfloat16": {"precision": "bfloat16"},
    "policy_delay 2": {"policy_delay": 2},
    "bfloat16, policy_delay 2": {"precision": "bfloat16", "policy_delay": 2},
}


def our_updates_per_second(seconds: float, settings: Mapping[str, Any]) -> float:
    """Whole training rounds: sampling, storing, updating, publishing weights.

    Args:
        seconds: of measuring, once updates have begun.
        settings: of the learner, of `WAYS`.
    """
    algo = algorithm(0, **settings)
    while algo.updates == 0:
        algo.training_step()
    updates, began = algo.updates, time.perf_counter()
    while time.perf_counter() - began < seconds:
        algo.training_step()
    speed = (algo.updates - updates) / (time.perf_counter() - began)
    algo.stop()
    return speed


def their_updates_per_second(seconds: float) -> float:
    """The same of Stable-Baselines3."""
    from stable_baselines3.common.callbacks import BaseCallback

    class Clock(BaseCallback):
        began, updates = 0.0, 0

        def _on_rollout_start(self) -> None:
            if self.model._n_updates and not self.began:
                self.began, self.updates = time.perf_counter(), self.model._n_updates

        def _on_step(self) -> bool:
            return not self.began or time.perf_counter() - self.began < seconds

    model, clock = stable_baselines(seed=0), Clock()
    model.learn(10**9, callback=clock)
    return (model._n_updates - clock.updates) / (time.perf_counter() - clock.began)


def products() -> str:
    """How this processor multiplies the networks' matrices."""
    import torch

    from freemesh_ray.algorithms import bfloat16, block_products, onednn

    features = {
        "AVX-512": torch.cpu._is_avx512_supported(),
        "AVX512-BF16": torch.cpu._is_avx512_bf16_supported(),
        "AMX": torch.cpu._is_amx_tile_supported(),
    }
    has = ", ".join(name for name, there in features.items() if there) or "no AVX-512"
    compiled = block_products.processor() is not None
    own = "by its own instructions" + (", sac's steps in one kernel" if compiled else "")
    rounded = own if bfloat16.native() else "in float32, it has no instructions for them"
    return f"processor: {has}; float32 products by {'oneDNN' if onednn.available() else 'MKL'}, bfloat16 ones {rounded}"


def run(seconds: float) -> None:
    """Updates a second of whole training rounds, with each of `WAYS` and of Stable-Baselines3 in turn, `RUNS` times."""
    speeds: dict[str, list[float]] = {name: [] for name in (*WAYS, THEIRS)}
    with local_ray(0):
        for _ in range(RUNS):
            for name, settings in WAYS.items():
                speeds[name].append(our_updates_per_second(seconds, settings))
            speeds[THEIRS].append(their_updates_per_second(seconds))
    ratios = {name: np.median(np.divide(found, speeds[THEIRS])) for name, found in speeds.items()}
    rows = [[name, *(f"{speed:.0f}" for speed in found), f"{ratios[name]:.2f}"] for name, found in speeds.items()]
    say(f"learner, one thread, {DOMAIN}, {RATIO} updates a step: updates a second, and the median ratio of a run's")
    say(products())
    say(table(["", *(f"run {i + 1}" for i in range(RUNS)), "ratio"], rows))
