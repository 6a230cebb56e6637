"""Learning curves beside Stable-Baselines3's."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from freemesh_ray import plots
from freemesh_ray.bench.trainings import DOMAIN, RATIO, algorithm, stable_baselines
from freemesh_ray.formatting.table import table
from freemesh_ray.local_ray import local_ray

SEEDS = (356, 567, 999)
STEPS = 60_000


def bench_curves(folder: Path) -> None:
    """Learning curves, ours and Stable-Baselines3's: same environment, same numbers, three seeds each."""
    from stable_baselines3.common.callbacks import BaseCallback

    class Returns(BaseCallback):
        def __init__(self) -> None:
            super().__init__()
            self.ended: list[tuple[int, float]] = []

        def _on_step(self) -> bool:
            self.ended += [
                (self.num_timesteps, info["episode"]["r"]) for info in self.locals["infos"] if "episode" in info
            ]
            return True

    folder.mkdir(parents=True, exist_ok=True)
    ended: dict[str, list[list[tuple[int, float]]]] = {"freemesh-ray": [], "Stable-Baselines3": []}
    for seed in SEEDS:
        with local_ray(0):
            algo, own = algorithm(0, seed=seed, warmup=5000), []
            while algo.env_steps < STEPS:
                algo.training_step()
                own += [(algo.env_steps, episode.episode_return) for episode in algo.finished]
                algo.finished.clear()
            algo.stop()
        ended["freemesh-ray"].append(own)
        model, returns = stable_baselines(seed=seed, warmup=5000), Returns()
        model.learn(STEPS, callback=returns)
        ended["Stable-Baselines3"].append(returns.ended)
        print(f"seed {seed}: done", file=sys.stderr, flush=True)
    edges = np.arange(0, STEPS + 1, STEPS // 15)
    curves = {label: np.array([binned(run, edges) for run in runs]) for label, runs in ended.items()}
    (folder / "curves.json").write_text(
        json.dumps({"steps": edges[1:].tolist(), **{label: values.tolist() for label, values in curves.items()}})
    )
    plots.draw_curves(
        {label: [(edges[1:], one) for one in values] for label, values in curves.items()}, folder / "curves.png",
        xlabel="environment steps", ylabel="return of a training episode",
        title=f"SAC on {DOMAIN}, {RATIO} updates a step, {len(SEEDS)} seeds",
    )  # fmt: skip
    rows = [
        [
            f"{edges[i + 1]:,}",
            *(f"{curves[label][:, i].mean():.1f} ± {curves[label][:, i].std():.1f}" for label in curves),
        ]
        for i in range(2, len(edges) - 1, 3)
    ]
    print(f"learning curves on {DOMAIN}: return of training episodes, {len(SEEDS)} seeds -> {folder / 'curves.png'}")
    print(table(["env steps", *curves], rows))


def binned(ended: list[tuple[int, float]], edges: np.ndarray) -> list[float]:
    """Mean return of the episodes that ended between consecutive edges; nan where none did."""
    steps, returns = np.array(ended).T
    means = []
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        inside = returns[(steps > low) & (steps <= high)]
        means.append(float(inside.mean()) if len(inside) else float("nan"))
    return means
