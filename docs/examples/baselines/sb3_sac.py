"""Stable-Baselines3's SAC on FreeMesh-v0, with the settings and the evaluations of `sac.py`.

    .venv/bin/pip install stable-baselines3
    .venv/bin/python docs/examples/baselines/sb3_sac.py --domain T1 --steps 30000 --seed 356 --out baseline

Written to --out: `evaluations.csv`, a line for each evaluation, and `sac.zip`, the model.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env

ENV = "envs:FreeMesh-v0"  # the package `envs`, which registers it, and the environment
COLUMNS = ["env_steps", "updates", "return", "completion_rate", "elements", "element_quality"]


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Stable-Baselines3's SAC on FreeMesh-v0")
    parser.add_argument("--domain", default="T1", help="a catalogue name, a polygon file or random-SEED")
    parser.add_argument("--steps", type=int, default=100_000, help="env steps of the training")
    parser.add_argument("--seed", type=int, default=356)
    parser.add_argument("--out", type=Path, default=Path("baseline"), help="folder of the results")
    parser.add_argument("--envs", type=int, default=16, help="environments stepped in turn")
    parser.add_argument("--warmup", type=int, default=5000, help="env steps of random actions before the first update")
    parser.add_argument("--updates-per-step", type=float, default=0.5)
    parser.add_argument("--eval-every", type=int, default=10_000, help="env steps between evaluations")
    parser.add_argument("--eval-episodes", type=int, default=10)
    args = parser.parse_args(arguments)
    try:
        gym.make(ENV, domain=args.domain)
        args.out.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        parser.error(str(error))
    return args


def evaluate(model: SAC, domain: str, episodes: int, seed: int) -> dict[str, float]:
    """Means over whole episodes of the squashed mean; an action is drawn only where the last was rejected, since the
    front is unchanged and the mean would be rejected again. The training's random numbers are left as they are."""
    envs = gym.make_vec(ENV, num_envs=episodes, domain=domain)
    over, rejected = np.zeros(episodes, dtype=bool), np.zeros(episodes, dtype=bool)
    returns, completed, elements, quality = np.zeros((4, episodes))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        obs, _ = envs.reset(seed=seed)
        while not over.all():
            drawn, mean = (model.predict(obs, deterministic=deterministic)[0] for deterministic in (False, True))
            obs, rewards, terminated, truncated, info = envs.step(np.where(rejected[:, None], drawn, mean))
            returns += np.where(over, 0.0, rewards)
            rejected = info["rejection"] != ""
            for i in np.flatnonzero((terminated | truncated) & ~over):
                completed[i], elements[i], quality[i] = terminated[i], info["elements"][i], info["mean_eta"][i]
            over |= terminated | truncated
    envs.close()
    return dict(zip(COLUMNS[2:], (float(x.mean()) for x in (returns, completed, elements, quality)), strict=True))


class Evaluations(BaseCallback):
    """Evaluates the model, and writes a line, every ``args.eval_every`` env steps and at the end."""

    def __init__(self, args: argparse.Namespace, table: Any) -> None:
        super().__init__()
        self.args, self.table, self.last = args, table, 0

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        """After the updates that the last steps gave."""
        if self.num_timesteps // self.args.eval_every > self.last // self.args.eval_every:
            self.write()

    def _on_training_end(self) -> None:
        if self.num_timesteps > self.last:
            self.write()

    def write(self) -> None:
        self.last = self.num_timesteps
        figures = evaluate(self.model, self.args.domain, self.args.eval_episodes, self.args.seed)
        self.table.writerow({"env_steps": self.num_timesteps, "updates": self.model._n_updates, **figures})
        print(f"step {self.num_timesteps}  " + "  ".join(f"{k} {v:.2f}" for k, v in figures.items()), flush=True)


def train(args: argparse.Namespace) -> SAC:
    """The whole run: `args.steps` env steps, its evaluations and its files."""
    torch.set_num_threads(1)
    # Its vector environment begins the next episode in the same step, and keeps the last observation and whether the
    # episode was truncated in `info`; its buffer takes both from there, so that only completed meshes end the return.
    envs = make_vec_env(ENV, n_envs=args.envs, seed=args.seed, env_kwargs={"domain": args.domain})
    model = SAC(
        "MlpPolicy",
        envs,
        learning_rate=3e-4,
        buffer_size=max(args.steps, args.envs),
        learning_starts=args.warmup,
        batch_size=256,
        tau=0.005,
        gamma=0.99,
        train_freq=1,
        gradient_steps=max(1, round(args.envs * args.updates_per_step)),
        ent_coef="auto_0.1",
        policy_kwargs={"net_arch": [128, 128, 128]},
        seed=args.seed,
        device="cpu",
    )
    with open(args.out / "evaluations.csv", "w", newline="", buffering=1) as file:
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        model.learn(args.steps, callback=Evaluations(args, table))
    model.save(args.out / "sac.zip")
    return model


if __name__ == "__main__":
    train(parse())
