"""How fast it is here, part by part: one file a part."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path

from freemesh_ray.bench.algorithms import bench_algorithms
from freemesh_ray.bench.curves import bench_curves
from freemesh_ray.bench.environment import bench_env
from freemesh_ray.bench.gpu import bench_gpu
from freemesh_ray.bench.learner import bench_learner
from freemesh_ray.bench.mesher import bench_mesher
from freemesh_ray.bench.sampling import bench_sampling
from freemesh_ray.bench.scaling import bench_scaling
from freemesh_ray.bench.serving import bench as bench_serving
from freemesh_ray.policies.policy import Policy


def run(parts: Sequence[str], *, seconds: float, folder: Path, policy: Policy) -> None:
    """Print the tables of the given parts.

    Args:
        parts: their names.
        seconds: of each measurement.
        folder: where ``curves`` and ``scaling`` write to.
        policy: of ``mesher`` and ``serving``.
    """
    measurements: dict[str, Callable[[], None]] = {
        "env": lambda: bench_env(seconds),
        "learner": lambda: bench_learner(seconds),
        "sampling": lambda: bench_sampling(seconds),
        "mesher": lambda: bench_mesher(policy),
        "curves": lambda: bench_curves(folder),
        "algorithms": bench_algorithms,
        "gpu": lambda: bench_gpu(seconds),
        "serving": lambda: bench_serving({"given": policy}, seconds),
        "scaling": lambda: bench_scaling(seconds, folder),
    }
    for part in parts:
        if part in ("learner", "curves", "algorithms") and find_spec("stable_baselines3") is None:
            print(f"{part}: skipped, Stable-Baselines3 is not installed (pip install stable-baselines3)")
            continue
        measurements[part]()
        print(flush=True)
