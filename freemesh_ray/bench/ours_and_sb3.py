"""The trainings that are measured: ours, and Stable-Baselines3's with the same numbers."""

from __future__ import annotations

from typing import Any

from envs.domains.load import load
from envs.types import MeshingParameters

#: The domain, environments, and gradient steps for each env step, on both sides.
DOMAIN, ENVS, RATIO = "T1", 16, 0.5
#: Rows of an update, of all learners together.
BATCH_SIZE = 256
#: Steps of each environment in a round.
FRAGMENT = 8


def algorithm(
    runners: int,
    *,
    learners: int = 0,
    envs: int = ENVS,
    batch: int = BATCH_SIZE,
    updates_per_step: float = RATIO,
    seed: int = 0,
    warmup: int = 1000,
    **settings: Any,
) -> Any:
    """Our SAC on the measurement's domain, on the CPU; with other ``settings`` of its training, see OffPolicyConfig."""
    from freemesh_ray.algorithms.environment import register
    from freemesh_ray.algorithms.sac import SACConfig

    options = {"domain": [load(DOMAIN)], "parameters": MeshingParameters()}
    return (
        SACConfig()
        .environment(register(), env_config=options)
        .env_runners(num_env_runners=runners, num_envs_per_env_runner=envs, rollout_fragment_length=FRAGMENT)
        .learners(num_learners=learners, num_cpus_per_learner=1)
        .training(
            warmup_steps=warmup,
            updates_per_step=updates_per_step,
            initial_alpha=1.0,  # as Stable-Baselines3 begins
            train_batch_size_per_learner=batch // max(1, learners),
            **settings,
        )
        .debugging(seed=seed, log_level="ERROR")
        .build_algo()
    )


def stable_baselines(*, seed: int, warmup: int = 1000) -> Any:
    """Stable-Baselines3's SAC with the same numbers on the same environment; 8 steps of each env, then the updates."""
    import torch
    from stable_baselines3 import SAC

    from freemesh_ray.bench.sb3_env import MeshVecEnv

    torch.set_num_threads(1)
    env = MeshVecEnv(load(DOMAIN), MeshingParameters(), ENVS)
    return SAC(
        "MlpPolicy", env, learning_rate=3e-4, buffer_size=1_000_000, learning_starts=warmup, batch_size=BATCH_SIZE,
        tau=5e-3, gamma=0.99, train_freq=FRAGMENT, gradient_steps=int(FRAGMENT * ENVS * RATIO),
        policy_kwargs={"net_arch": [128, 128, 128]}, seed=seed, device="cpu",
    )  # fmt: skip
