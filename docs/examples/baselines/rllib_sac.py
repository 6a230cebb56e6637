"""RLlib's own SAC on FreeMesh-v0, learner, buffer and env runner as they come, with the protocol of `sac.py`.

    .venv/bin/python docs/examples/baselines/rllib_sac.py --domain T1 --steps 30000 --seed 356 --out baseline

Written to --out: `evaluations.csv`, a line for each evaluation, and `module.pt`, the state of RLlib's module. What
`freemesh train` has in place of these parts, and why, is in docs/baselines.md.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import ray
import torch
from ray.rllib.algorithms.sac import SACConfig
from ray.rllib.core import DEFAULT_MODULE_ID
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module import RLModule
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

ENV = "envs:FreeMesh-v0"  # the package `envs`, which registers it, and the environment
BATCH_SIZE = 256
COLUMNS = ["env_steps", "updates", "return", "completion_rate", "elements", "element_quality"]


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="RLlib's SAC on FreeMesh-v0")
    parser.add_argument("--domain", default="T1", help="a catalogue name, a polygon file or random-SEED")
    parser.add_argument("--steps", type=int, default=100_000, help="env steps of the training")
    parser.add_argument("--seed", type=int, default=356)
    parser.add_argument("--out", type=Path, default=Path("baseline"), help="folder of the results")
    parser.add_argument("--envs", type=int, default=16, help="environments stepped together")
    parser.add_argument(
        "--warmup", type=int, default=5000, help="env steps of the first policy before the first update"
    )
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


def configuration(args: argparse.Namespace) -> SACConfig:
    """The paper's numbers; RLlib's own differ."""
    return (
        SACConfig()
        .environment(ENV, env_config={"domain": args.domain})
        .env_runners(
            num_env_runners=0, num_envs_per_env_runner=args.envs, rollout_fragment_length=1,
            gym_env_vectorize_mode="vector_entry_point",
        )
        .training(
            actor_lr=3e-4, critic_lr=3e-4, alpha_lr=3e-4, gamma=0.99, tau=0.005, initial_alpha=0.1,
            train_batch_size_per_learner=BATCH_SIZE,
            num_steps_sampled_before_learning_starts=args.warmup,
            # Transitions learnt from for each one sampled.
            training_intensity=args.updates_per_step * BATCH_SIZE,
            replay_buffer_config={"type": "EpisodeReplayBuffer", "capacity": max(args.steps, BATCH_SIZE)},
        )
        .rl_module(
            model_config=DefaultModelConfig(
                fcnet_hiddens=[128, 128], fcnet_activation="relu",
                head_fcnet_hiddens=[128], head_fcnet_activation="relu",
            )
        )
        .reporting(min_time_s_per_iteration=0, min_sample_timesteps_per_iteration=0)
        .debugging(seed=args.seed, log_level="ERROR")
    )  # fmt: skip


def act(module: RLModule, obs: np.ndarray, deterministic: bool) -> np.ndarray:
    """Actions (B, a). RLlib's `explore=False` takes the mean without its tanh, which is not the mean's action."""
    with torch.no_grad():
        outputs = module.forward_inference({Columns.OBS: torch.from_numpy(obs)})[Columns.ACTION_DIST_INPUTS]
        if deterministic:
            return outputs.chunk(2, dim=-1)[0].tanh().numpy()
        return module.get_inference_action_dist_cls().from_logits(outputs).sample().numpy()


def evaluate(module: RLModule, domain: str, episodes: int, seed: int) -> dict[str, float]:
    """Means over whole episodes of the squashed mean; an action is drawn only where the last was rejected, since the
    front is unchanged and the mean would be rejected again. The training's random numbers are left as they are."""
    envs = gym.make_vec(ENV, num_envs=episodes, domain=domain)
    over, rejected = np.zeros(episodes, dtype=bool), np.zeros(episodes, dtype=bool)
    returns, completed, elements, quality = np.zeros((4, episodes))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        obs, _ = envs.reset(seed=seed)
        while not over.all():
            drawn, mean = (act(module, obs, deterministic) for deterministic in (False, True))
            obs, rewards, terminated, truncated, info = envs.step(np.where(rejected[:, None], drawn, mean))
            returns += np.where(over, 0.0, rewards)
            rejected = info["rejection"] != ""
            for i in np.flatnonzero((terminated | truncated) & ~over):
                completed[i], elements[i], quality[i] = terminated[i], info["elements"][i], info["mean_eta"][i]
            over |= terminated | truncated
    envs.close()
    return dict(zip(COLUMNS[2:], (float(x.mean()) for x in (returns, completed, elements, quality)), strict=True))


def train(args: argparse.Namespace) -> dict[str, Any]:
    """The whole run: `args.steps` env steps, its evaluations and its files.

    Returns:
        RLlib's metrics of the last update.
    """
    torch.set_num_threads(1)
    ray.init("local", include_dashboard=False, num_cpus=1, logging_level="ERROR")
    algorithm = configuration(args).build_algo()
    learnt: dict[str, Any] = {}
    steps = updates = 0
    with open(args.out / "evaluations.csv", "w", newline="", buffering=1) as file:
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        while steps < args.steps:
            before, result = steps, algorithm.train()
            steps = int(result["env_runners"]["num_env_steps_sampled_lifetime"])
            if "learners" in result:
                learnt = result["learners"][DEFAULT_MODULE_ID]
                updates = int(learnt["num_module_steps_trained_lifetime"]) // BATCH_SIZE
            if steps // args.eval_every > before // args.eval_every or steps >= args.steps:
                figures = evaluate(algorithm.get_module(), args.domain, args.eval_episodes, args.seed)
                table.writerow({"env_steps": steps, "updates": updates, **figures})
                print(f"step {steps}  " + "  ".join(f"{key} {value:.2f}" for key, value in figures.items()), flush=True)
    torch.save(algorithm.get_module().state_dict(), args.out / "module.pt")
    algorithm.stop()
    ray.shutdown()
    return learnt


if __name__ == "__main__":
    train(parse())
