"""Configuration tree -> a ready RLlib algorithm."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from envs.domains.load import source
from envs.plug_in import subclass
from freemesh_ray.algorithms.curriculum import Curriculum
from freemesh_ray.algorithms.device import gpus_here, gpus_per_learner
from freemesh_ray.algorithms.environment import register
from freemesh_ray.algorithms.mesh_algorithm import MeshAlgorithm, MeshConfig
from freemesh_ray.config import ALGORITHMS, algorithm_name, meshing_parameters, plug_ins

Config = Mapping[str, Any]


def config_class(name: str) -> type[MeshConfig]:
    """The RLlib configuration of an algorithm of `ALGORITHMS`, or of a plug-in.

    Raises:
        PluginError: a plug-in's is none.
    """
    found: type[MeshConfig] = subclass(
        ALGORITHMS[algorithm_name(name)].config, "algorithm", MeshConfig, "a class of MeshConfig"
    ).value
    return found


def configured(config: Config) -> MeshConfig:
    """The algorithm that a configuration tree (see ``config.load``) describes.

    Raises:
        ConfigError: a GPU is asked for that there is not.
        PluginError: a plug-in cannot be had.
    """
    learner, runners, curriculum = config["learner"], config["runners"], config["curriculum"]
    domains = [source(stage) for stage in curriculum["stages"]]
    return (
        config_class(config["algorithm"])()
        .configure(config)
        .environment(
            register(),
            env_config={
                "domain": domains,
                "parameters": meshing_parameters(config),
                "plug_ins": plug_ins(config),
            },
        )
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
            evaluation_metrics=tuple(config["evaluation"]["metrics"]),
            curriculum=Curriculum(**{**curriculum, "stages": tuple(domain.name for domain in domains)}),
        )
        # When to evaluate is the training loop's to decide: see training.Training.
        .evaluation(evaluation_interval=None, evaluation_duration=config["evaluation"]["episodes"])
        .debugging(seed=config["seed"], log_level="ERROR")
    )


def build(config: Config) -> MeshAlgorithm:
    """Start the algorithm's processes; ``stop()`` ends them."""
    return configured(config).build_algo()
