"""The learning algorithms on Gymnasium's Pendulum, beside Stable-Baselines3's.

    .venv/bin/python docs/benchmarks/pendulum.py

Both sides have the same settings, environments, network sizes and ratio of updates to steps. A random policy's return
is about -1,200, a good one's -150 to -200.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.wrappers import RescaleAction
from script import require_stable_baselines, run_script

from freemesh_ray.cli.arguments import Parser
from freemesh_ray.formatting.table import table
from freemesh_ray.local_ray import local_ray

NAME = "Pendulum-v1"
HIDDEN = [64, 64]
#: Environments stepped together, steps of each in a round; ppo's round is longer.
ENVS, FRAGMENT, PPO_ENVS, PPO_ROUND = 4, 8, 16, 1024
EPISODES = 10
SEEDS = (356, 567, 999)
#: Env steps of each algorithm's training.
STEPS = {"sac": 6_000, "td3": 10_000, "ddpg": 8_000, "ppo": 50_000}

Act = Callable[[np.ndarray], np.ndarray]


def create(context: Any = None) -> gym.Env[np.ndarray, np.ndarray]:
    """Pendulum with actions in [-1, 1]."""
    return RescaleAction(gym.make(NAME), np.float32(-1.0), np.float32(1.0))


def score(act: Act) -> float:
    """Mean return of ``act``, observations (batch, 3) -> actions (batch, 1), from the same ten starts."""
    envs = gym.vector.SyncVectorEnv([create] * EPISODES)
    obs: np.ndarray = envs.reset(seed=1000)[0]
    returns, over = np.zeros(EPISODES), np.zeros(EPISODES, dtype=np.bool_)
    while not over.all():
        obs, rewards, _, truncated, _ = envs.step(act(obs))
        returns += np.where(over, 0.0, rewards)
        over |= truncated
    return float(returns.mean())


def deterministic(layers: Sequence[tuple[Any, Any]]) -> Act:
    """The squashed mean of an exported actor (``MeshAlgorithm.actor_weights``)."""

    def act(obs: np.ndarray) -> np.ndarray:
        x = obs
        for weight, bias in layers[:-1]:
            x = np.maximum(x @ weight + bias, 0.0)
        weight, bias = layers[-1]
        return np.tanh((x @ weight + bias)[:, :1])

    return act


def ours(name: str, seed: int) -> Any:
    """One of this package's algorithms, on Pendulum, without env runners."""
    from ray import tune

    from freemesh_ray.algorithms.build import config_class

    tune.register_env(NAME, create)
    if name == "ppo":
        config, envs = config_class(name)().training(lr=1e-3, gamma=0.9, minibatch_size=128), PPO_ENVS
        config.training(train_batch_size_per_learner=PPO_ROUND)
    else:
        config, envs = config_class(name)(), ENVS
        own = {"alpha_lr": 1e-3, "initial_alpha": 1.0} if name == "sac" else {}
        config.training(
            **own, actor_lr=1e-3, critic_lr=1e-3, gamma=0.98, train_batch_size_per_learner=128, warmup_steps=1000
        )
        config.env_runners(rollout_fragment_length=FRAGMENT)
    return (
        config.environment(NAME)
        .env_runners(num_envs_per_env_runner=envs, gym_env_vectorize_mode="sync")
        .training(hidden=HIDDEN)
        .debugging(seed=seed, log_level="ERROR")
        .build_algo()
    )


def theirs(name: str, seed: int) -> Any:
    """The same of Stable-Baselines3."""
    import stable_baselines3
    import torch
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.noise import NormalActionNoise

    torch.set_num_threads(1)
    algorithm = getattr(stable_baselines3, name.upper())
    env = make_vec_env(create, n_envs=PPO_ENVS if name == "ppo" else ENVS, seed=seed)
    same = {"learning_rate": 1e-3, "seed": seed, "device": "cpu"}
    if name == "ppo":
        return algorithm(
            "MlpPolicy", env, n_steps=PPO_ROUND // PPO_ENVS, batch_size=128, gamma=0.9,
            policy_kwargs={"net_arch": HIDDEN, "activation_fn": torch.nn.ReLU}, **same,
        )  # fmt: skip
    noise = {} if name == "sac" else {"action_noise": NormalActionNoise(np.zeros(1), np.full(1, 0.1))}
    return algorithm(
        "MlpPolicy", env, gamma=0.98, batch_size=128, learning_starts=1000, train_freq=FRAGMENT,
        gradient_steps=FRAGMENT * ENVS, policy_kwargs={"net_arch": HIDDEN}, **noise, **same,
    )  # fmt: skip


def our_training(name: str, seed: int, steps: int) -> tuple[float, float]:
    """Score after ``steps`` env steps, and the seconds they took."""
    with local_ray(0):
        algorithm = ours(name, seed)
        began = time.perf_counter()
        while algorithm.env_steps < steps:
            algorithm.training_step()
        took = time.perf_counter() - began
        found = score(deterministic(algorithm.actor_weights()))
        algorithm.stop()
    return found, took


def their_training(name: str, seed: int, steps: int) -> tuple[float, float]:
    """The same of Stable-Baselines3."""
    model = theirs(name, seed)
    began = time.perf_counter()
    model.learn(steps)
    return score(lambda obs: model.predict(obs, deterministic=True)[0]), time.perf_counter() - began


def main() -> None:
    """Train every algorithm with every seed, ours and theirs in turn, and print the table.

    Raises:
        UserError: Stable-Baselines3 is not installed.
    """
    Parser(description="Train every algorithm on Pendulum, beside Stable-Baselines3's.").parse_args()
    require_stable_baselines()
    rows = []
    for name, steps in STEPS.items():
        pairs = []
        for seed in SEEDS:
            pairs.append((our_training(name, seed, steps), their_training(name, seed, steps)))
            print(f"{name}, seed {seed}: done", file=sys.stderr, flush=True)
        scores = [" ".join(f"{pair[side][0]:.0f}" for pair in pairs) for side in (0, 1)]
        ratio = float(np.median([theirs[1] / ours[1] for ours, theirs in pairs]))
        rows.append([name, f"{steps:,}", *scores, f"{ratio:.1f}"])
    print(f"algorithms on Pendulum: mean return of {EPISODES} episodes, {len(SEEDS)} seeds")
    print(table(["", "env steps", "freemesh-ray", "Stable-Baselines3", "times as fast"], rows))


if __name__ == "__main__":
    run_script(main)
