"""Configuration tree -> a ready RLlib algorithm."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

from envs.domains.load import source
from freemesh_ray.algorithms.curriculum import Curriculum
from freemesh_ray.algorithms.ddpg import DDPGConfig
from freemesh_ray.algorithms.device import gpus_here, gpus_per_learner
from freemesh_ray.algorithms.environment import register
from freemesh_ray.algorithms.mesh_algorithm import MeshAlgorithm, MeshConfig
from freemesh_ray.algorithms.off_policy import OffPolicyConfig
from freemesh_ray.algorithms.ppo import PPOConfig
from freemesh_ray.algorithms.sac import SACConfig
from freemesh_ray.algorithms.td3 import TD3Config
from freemesh_ray.config import meshing_parameters

Config = Mapping[str, Any]


def _off_policy(start: OffPolicyConfig, config: Config, **own: Any) -> MeshConfig:
    """``start`` with what the algorithms with a replay buffer have in common, and what is one's own."""
    learner = config["learner"]
    return start.env_runners(rollout_fragment_length=config["runners"]["fragment"]).training(
        tau=learner["tau"],
        actor_lr=learner["learning_rate"],
        critic_lr=learner["learning_rate"],
        train_batch_size_per_learner=learner["batch_size"] // max(1, learner["count"]),
        replay_buffer_config={"type": "EpisodeReplayBuffer", "capacity": learner["buffer_size"]},
        updates_per_step=learner["updates_per_step"],
        warmup_steps=learner["warmup_steps"],
        **own,
    )


def _sac(config: Config) -> MeshConfig:
    return _off_policy(SACConfig(), config, alpha_lr=config["learner"]["learning_rate"], **config["sac"])


def _td3(config: Config) -> MeshConfig:
    return _off_policy(TD3Config(), config, **config["td3"])


def _ddpg(config: Config) -> MeshConfig:
    return _off_policy(DDPGConfig(), config, **config["ddpg"])


def _ppo(config: Config) -> MeshConfig:
    ppo, learners = config["ppo"], max(1, config["learner"]["count"])
    return PPOConfig().training(
        lr=config["learner"]["learning_rate"],
        train_batch_size_per_learner=math.ceil(ppo["rollout_steps"] / learners),
        num_epochs=ppo["epochs"],
        minibatch_size=ppo["minibatch_size"] // learners,
        clip_param=ppo["clip"],
        lambda_=ppo["gae_lambda"],
        entropy_coeff=ppo["entropy_coefficient"],
        vf_loss_coeff=ppo["value_coefficient"],
        grad_clip=ppo["max_grad_norm"],
    )


#: What ``algorithm`` in a configuration can be.
ALGORITHMS: dict[str, Callable[[Config], MeshConfig]] = {"sac": _sac, "td3": _td3, "ddpg": _ddpg, "ppo": _ppo}


def configured(config: Config) -> MeshConfig:
    """The algorithm that a configuration tree (see ``config.load``) describes.

    Raises:
        ConfigError: a GPU is asked for that there is not.
    """
    learner, runners, curriculum = config["learner"], config["runners"], config["curriculum"]
    domains = [source(stage) for stage in curriculum["stages"]]
    return (
        ALGORITHMS[config["algorithm"]](config)
        .environment(register(), env_config={"domain": domains, **asdict(meshing_parameters(config))})
        .env_runners(num_env_runners=runners["count"], num_envs_per_env_runner=runners["envs_per_runner"])
        .learners(
            num_learners=learner["count"],
            num_cpus_per_learner=1,
            num_gpus_per_learner=gpus_per_learner(learner["device"], learner["count"], gpus_here(learner["count"])),
        )
        .training(
            gamma=learner["gamma"],
            hidden=learner["hidden"],
            runner_timeout=runners["timeout"],
            curriculum=Curriculum(**{**curriculum, "stages": tuple(domain.name for domain in domains)}),
        )
        # When to evaluate is the training loop's to decide: see training.Training.
        .evaluation(evaluation_interval=None, evaluation_duration=config["evaluation"]["episodes"])
        .debugging(seed=config["seed"], log_level="ERROR")
    )


def build(config: Config) -> MeshAlgorithm:
    """Start the algorithm's processes; ``stop()`` ends them."""
    return configured(config).build_algo()
