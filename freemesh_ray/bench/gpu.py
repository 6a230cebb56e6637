"""Updates a second on the CPU and on CUDA: from which batch size on a GPU is worth it."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from freemesh_ray.formatting.table import table
from freemesh_ray.formatting.terminal import note, say

OBSERVATION, ACTION = 15, 3
BATCHES = (256, 1_024, 4_096, 16_384, 65_536)
#: Updates in one call of the learner.
CALLS = (1, 8, 64)
#: Rows in one call at most.
MOST_ROWS = 2**19


def standalone(device: str, batch: int) -> Any:
    """SAC's learner as trainings have it, without a training around it.

    Args:
        device: ``cpu`` or ``cuda``.
        batch: rows of an update.
    """
    from gymnasium import spaces

    from freemesh_ray.algorithms.sac import SACConfig

    config = SACConfig().training(train_batch_size_per_learner=batch).debugging(seed=0)
    config.learners(num_gpus_per_learner=int(device == "cuda"))
    spec = config.get_default_rl_module_spec()
    spec.observation_space = spaces.Box(-np.inf, np.inf, (OBSERVATION,))
    spec.action_space = spaces.Box(-1.0, 1.0, (ACTION,))
    learner = config.get_default_learner_class()(config=config, module_spec=spec)
    learner.build()
    return learner


def experience(rows: int) -> Any:
    """Random transitions."""
    from freemesh_ray.algorithms.replay_buffer import Transitions

    random = np.random.default_rng(0)
    return Transitions(
        random.standard_normal((rows, OBSERVATION), dtype=np.float32),
        random.uniform(-1.0, 1.0, (rows, ACTION)).astype(np.float32),
        random.standard_normal(rows, dtype=np.float32),
        random.standard_normal((rows, OBSERVATION), dtype=np.float32),
        (random.random(rows) < 0.02).astype(np.float32),
        np.ones(rows, dtype=np.float32),
    )


def updates_per_second(device: str, batch: int, count: int, seconds: float) -> float:
    """Of calls with ``count`` minibatches of ``batch`` rows, from rows in memory to figures; one call is not timed."""
    from freemesh_ray.algorithms.off_policy import batch as as_batch

    learner, rows = standalone(device, batch), as_batch(experience(batch * count))
    learner.update(batch=rows, timesteps={})
    calls, began = 0, time.perf_counter()
    while not calls or time.perf_counter() - began < seconds:
        learner.update(batch=rows, timesteps={})
        calls += 1
    return calls * count / (time.perf_counter() - began)


def run(seconds: float) -> None:
    """Updates a second of SAC's learner against batch size and updates a call, on the CPU and, where it is, on CUDA."""
    import torch

    devices = ["cpu", "cuda"] if torch.cuda.is_available() else ["cpu"]
    rows = []
    for batch in BATCHES:
        for count in (count for count in CALLS if batch * count <= MOST_ROWS):
            speeds = [updates_per_second(device, batch, count, seconds) for device in devices]
            ratio = [f"{speeds[1] / speeds[0]:.2f}"] if len(speeds) > 1 else []
            rows.append([f"{batch:,}", str(count), *(f"{speed:,.1f}" for speed in speeds), *ratio])
            note(f"batch {batch:,}, {count} a call: done")
    say("learner: updates a second, one CPU thread")
    say(table(["batch", "updates a call", *devices, *(["cuda / cpu"] if len(devices) > 1 else [])], rows))
    if len(devices) > 1:
        say(f"CUDA device: {torch.cuda.get_device_name(0)}")
    else:
        say("no CUDA device here: nothing was measured on one")
