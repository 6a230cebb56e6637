"""SAC's learning curves beside Stable-Baselines3's: same environment, same numbers, three seeds each.

.venv/bin/python docs/benchmarks/learning_curves.py --out docs
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from script import require_stable_baselines, run_script

from freemesh_ray import plots
from freemesh_ray.bench.ours_and_sb3 import DOMAIN, RATIO, algorithm, stable_baselines
from freemesh_ray.cli.arguments import Parser
from freemesh_ray.formatting.table import table
from freemesh_ray.local_ray import local_ray
from freemesh_ray.storage.atomic import check_writable, replacing

SEEDS = (356, 567, 999)
STEPS = 60_000

#: (env steps so far, return) of the episodes of a training, in the order in which they ended.
Ended = list[tuple[int, float]]


def our_training(seed: int) -> Ended:
    """This package's SAC."""
    ended: Ended = []
    with local_ray(0):
        algo = algorithm(0, seed=seed, warmup=5000)
        while algo.env_steps < STEPS:
            algo.training_step()
            ended += [(algo.env_steps, episode.episode_return) for episode in algo.finished]
            algo.finished.clear()
        algo.stop()
    return ended


def their_training(seed: int) -> Ended:
    """Stable-Baselines3's."""
    from stable_baselines3.common.callbacks import BaseCallback

    ended: Ended = []

    class Returns(BaseCallback):
        def _on_step(self) -> bool:
            episodes = (info["episode"] for info in self.locals["infos"] if "episode" in info)
            ended.extend((self.num_timesteps, episode["r"]) for episode in episodes)
            return True

    stable_baselines(seed=seed, warmup=5000).learn(STEPS, callback=Returns())
    return ended


def binned(ended: Ended, edges: np.ndarray) -> list[float]:
    """Mean return of the episodes that ended between consecutive edges; nan where none did."""
    steps, returns = np.array(ended).T
    means = []
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        inside = returns[(steps > low) & (steps <= high)]
        means.append(float(inside.mean()) if len(inside) else float("nan"))
    return means


def write_curves(folder: Path) -> None:
    """Train, write ``curves_sb3.json`` and ``curves_sb3.png``, and print the table.

    Raises:
        OutputError: the folder cannot be written to.
        UserError: Stable-Baselines3 is not installed.
    """
    require_stable_baselines()
    numbers, picture = folder / "curves_sb3.json", folder / "curves_sb3.png"
    for path in (numbers, picture):
        check_writable(path)
    trainings: dict[str, list[Ended]] = {"freemesh-ray": [], "Stable-Baselines3": []}
    for seed in SEEDS:
        trainings["freemesh-ray"].append(our_training(seed))
        trainings["Stable-Baselines3"].append(their_training(seed))
        print(f"seed {seed}: done", file=sys.stderr, flush=True)
    edges = np.arange(0, STEPS + 1, STEPS // 15)
    curves = {label: np.array([binned(ended, edges) for ended in each]) for label, each in trainings.items()}
    with replacing(numbers) as draft:
        values = {label: rows.tolist() for label, rows in curves.items()}
        draft.write_text(json.dumps({"steps": edges[1:].tolist(), **values}))
    plots.draw_curves(
        {label: [(edges[1:], row) for row in rows] for label, rows in curves.items()}, picture,
        xlabel="environment steps", ylabel="return of a training episode",
        title=f"SAC on {DOMAIN}, {RATIO} updates a step, {len(SEEDS)} seeds",
    )  # fmt: skip
    rows = [
        [f"{edges[i + 1]:,}", *(f"{each[:, i].mean():.1f} ± {each[:, i].std():.1f}" for each in curves.values())]
        for i in range(2, len(edges) - 1, 3)
    ]
    print(f"learning curves on {DOMAIN}: return of training episodes, {len(SEEDS)} seeds -> {picture}")
    print(table(["env steps", *curves], rows))


def main() -> None:
    """Parse the command line and train."""
    parser = Parser(description="Draw SAC's learning curves beside Stable-Baselines3's.")
    parser.add_argument("--out", required=True, type=Path, metavar="FOLDER", help="where curves_sb3.* are written")
    write_curves(parser.parse_args().out)


if __name__ == "__main__":
    run_script(main)
