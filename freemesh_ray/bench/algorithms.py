"""All algorithms on Pendulum, beside Stable-Baselines3's."""

from __future__ import annotations

import sys

import numpy as np

from freemesh_ray.bench import pendulum
from freemesh_ray.bench.curves import SEEDS
from freemesh_ray.formatting.table import table
from freemesh_ray.local_ray import local_ray

#: Env steps of each algorithm on Pendulum.
STEPS = {"sac": 6_000, "td3": 10_000, "ddpg": 8_000, "ppo": 50_000}


def bench_algorithms() -> None:
    """What each algorithm has learnt of Pendulum, ours and Stable-Baselines3's in turn: same numbers, three seeds."""
    rows = []
    for name, steps in STEPS.items():
        pairs = []
        for seed in SEEDS:
            with local_ray(0):
                own = pendulum.our_training(name, seed, steps)
            pairs.append((own, pendulum.their_training(name, seed, steps)))
            print(f"{name}, seed {seed}: done", file=sys.stderr, flush=True)
        scores = [" ".join(f"{one[side][0]:.0f}" for one in pairs) for side in (0, 1)]
        ratio = float(np.median([theirs[1] / ours[1] for ours, theirs in pairs]))
        rows.append([name, f"{steps:,}", *scores, f"{ratio:.1f}"])
    print(f"algorithms on Pendulum: mean return of {pendulum.EPISODES} episodes, {len(SEEDS)} seeds")
    print(table(["", "env steps", "freemesh-ray", "Stable-Baselines3", "times as fast"], rows))
