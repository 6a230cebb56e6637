"""Configuration tree -> a ready RLlib algorithm."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

from envs.domain import source
from freemesh_ray.algorithms.environment import register
from freemesh_ray.algorithms.sac import SAC, SACConfig
from freemesh_ray.config import meshing_parameters
from freemesh_ray.curriculum import Curriculum


def sac_config(config: Mapping[str, Any]) -> SACConfig:
    """The SAC that a configuration tree (see ``config.load``) describes."""
    learner, sac = config["learner"], config["sac"]
    runners, curriculum = config["runners"], config["curriculum"]
    domains = [source(stage) for stage in curriculum["stages"]]
    return (
        SACConfig()
        .environment(register(), env_config={"domain": domains, **asdict(meshing_parameters(config))})
        .env_runners(
            num_env_runners=runners["count"],
            num_envs_per_env_runner=runners["envs_per_runner"],
            rollout_fragment_length=runners["fragment"],
        )
        .training(
            gamma=learner["gamma"],
            tau=learner["tau"],
            actor_lr=learner["learning_rate"],
            critic_lr=learner["learning_rate"],
            alpha_lr=learner["learning_rate"],
            target_entropy=sac["target_entropy"],
            initial_alpha=sac["initial_alpha"],
            train_batch_size_per_learner=learner["batch_size"],
            replay_buffer_config={"type": "EpisodeReplayBuffer", "capacity": learner["buffer_size"]},
            hidden=learner["hidden"],
            updates_per_step=learner["updates_per_step"],
            warmup_steps=learner["warmup_steps"],
            curriculum=Curriculum(
                stages=tuple(domain.name for domain in domains),
                promote_at=curriculum["promote_at"],
                window=curriculum["window"],
                max_stage_steps=curriculum["max_stage_steps"],
                rehearsal=curriculum["rehearsal"],
            ),
        )
        # When to evaluate is the training loop's to decide: see training.Training.
        .evaluation(evaluation_interval=None, evaluation_duration=config["evaluation"]["episodes"])
        .debugging(seed=config["seed"], log_level="ERROR")
    )


#: What ``algorithm`` in a configuration can be.
ALGORITHMS: dict[str, Callable[[Mapping[str, Any]], SACConfig]] = {"sac": sac_config}


def build(config: Mapping[str, Any]) -> SAC:
    """Start the algorithm's processes; ``stop()`` ends them."""
    return ALGORITHMS[config["algorithm"]](config).build_algo()
