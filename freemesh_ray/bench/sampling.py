"""Transitions a second that reach the training's process."""

from __future__ import annotations

import time

from freemesh_ray.bench.ours_and_sb3 import ENVS, algorithm
from freemesh_ray.formatting.table import table
from freemesh_ray.formatting.terminal import say
from freemesh_ray.local_ray import local_ray

#: Env runners, and steps of each environment in a round.
RUNNERS, FRAGMENTS = (0, 1, 2), (8, 64, 256)


def run(seconds: float) -> None:
    """Transitions a second with 0, 1 and 2 env runners, policy included, and with what larger fragments give."""
    rows = []
    for runners in RUNNERS:
        with local_ray(runners):
            algo = algorithm(runners, warmup=1)  # actions are the policy's from the second step on
            speeds = []
            for fragment in FRAGMENTS:
                algo.config._is_frozen = False
                algo.config.rollout_fragment_length = fragment
                warm = time.perf_counter()
                while time.perf_counter() - warm < seconds:  # new processes are slow at first
                    algo._collect()
                count, began = 0, time.perf_counter()
                while time.perf_counter() - began < seconds:
                    count += sum(len(part.transitions) for part in algo._collect())
                speeds.append(count / (time.perf_counter() - began))
            algo.stop()
        rows.append([str(runners), *(f"{speed:,.0f}" for speed in speeds)])
    say(f"sampling, {ENVS} environments a runner: transitions a second, to the learner's process")
    say(table(["env runners", *(f"{steps} steps a round" for steps in FRAGMENTS)], rows))
