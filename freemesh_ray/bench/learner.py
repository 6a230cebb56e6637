"""Updates a second of whole training rounds, beside Stable-Baselines3's."""

from __future__ import annotations

import time

import numpy as np

from freemesh_ray.bench.trainings import DOMAIN, RATIO, algorithm, stable_baselines
from freemesh_ray.formatting.table import table
from freemesh_ray.formatting.terminal import say
from freemesh_ray.local_ray import local_ray


def our_updates_per_second(seconds: float) -> float:
    """Whole training rounds: sampling, storing, updating, publishing weights."""
    algo = algorithm(0)
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


def run(seconds: float) -> None:
    """Updates a second of whole training rounds, ours and Stable-Baselines3's in turn, three times each."""
    with local_ray(0):
        pairs = [(our_updates_per_second(seconds), their_updates_per_second(seconds)) for _ in range(3)]
    rows = [[f"run {i + 1}", f"{a:.0f}", f"{b:.0f}", f"{a / b:.2f}"] for i, (a, b) in enumerate(pairs)]
    ratio = float(np.median([a / b for a, b in pairs]))
    say(f"learner, one thread, {DOMAIN}, {RATIO} updates a step: updates a second (median ratio {ratio:.2f})")
    say(table(["", "freemesh-ray", "Stable-Baselines3", "ratio"], rows))
