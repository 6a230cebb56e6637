"""Configuration tree -> a ready RLlib algorithm."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import ray
from ray import cloudpickle

from envs.domains.load import source
from envs.errors import PluginError
from envs.plug_ins.lookup import is_spec, subclass
from envs.plug_ins.search_path import folders
from freemesh_ray.algorithms.curriculum import Curriculum
from freemesh_ray.algorithms.device import gpus_here, gpus_per_learner
from freemesh_ray.algorithms.environment import create, register
from freemesh_ray.algorithms.mesh_algorithm import MeshAlgorithm, MeshConfig
from freemesh_ray.config import ALGORITHMS, algorithm_name, meshing_parameters, plug_ins, plug_ins_named
from freemesh_ray.config.env_runner_count import runner_count

Config = Mapping[str, Any]
#: Seconds that another process gets to say what is wrong with a plug-in there.
PATIENCE = 60


def config_class(name: str) -> type[MeshConfig]:
    """The RLlib configuration of an algorithm of `ALGORITHMS`, or of a plug-in.

    Raises:
        PluginError: a plug-in's is none.
    """
    named = ALGORITHMS[algorithm_name(name)].config
    found: type[MeshConfig] = subclass(named, "algorithm", MeshConfig, "a class of MeshConfig").value
    if is_spec(name):  # env runners and learners get its classes as they are here, wherever they look for modules
        cloudpickle.register_pickle_by_value(sys.modules[found.__module__])
    return found


def configured(config: Config) -> MeshConfig:
    """The algorithm that a configuration tree (see ``config.load``) describes.

    Raises:
        ConfigError: a GPU is asked for that there is not.
        PluginError: a plug-in cannot be had.
    """
    learner, runners, curriculum = config["learner"], config["runners"], config["curriculum"]
    domains = [source(stage) for stage in curriculum["stages"]]
    own = {"plug_ins": plug_ins(config), "folders": folders()} if plug_ins_named(config) else {}
    name = algorithm_name(config["algorithm"])
    return (
        config_class(config["algorithm"])()
        .configure(config)
        .environment(register(), env_config={"domain": domains, "parameters": meshing_parameters(config), **own})
        .env_runners(num_env_runners=runner_count(config), num_envs_per_env_runner=runners["envs_per_runner"])
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
            plugged=(name, ALGORITHMS[name]) if is_spec(config["algorithm"]) else None,
            curriculum=Curriculum(**{**curriculum, "stages": tuple(domain.name for domain in domains)}),
        )
        # When to evaluate is the training loop's to decide: see training.Training.
        .evaluation(evaluation_interval=None, evaluation_duration=config["evaluation"]["episodes"])
        .debugging(seed=config["seed"], log_level="ERROR")
    )


def build(config: Config) -> MeshAlgorithm:
    """Start the algorithm's processes; ``stop()`` ends them.

    Raises:
        ConfigError, PluginError: see `configured`; a plug-in cannot be had in another process.
    """
    made = configured(config)
    try:
        return made.build_algo()
    except Exception as error:
        if plug_ins_named(config) and (fault := _fault_elsewhere(made.env_config)):
            raise PluginError(f"{fault}, for other processes, too") from error
        raise


def _fault_elsewhere(context: Mapping[str, Any]) -> str:
    """What is wrong with plug-ins in another process of Ray; empty where nothing is, or none answers."""

    def fault() -> str:
        try:
            create(context).reset(seed=0)
        except PluginError as error:
            return str(error)
        return ""

    try:
        found: str = ray.get(ray.remote(num_cpus=0)(fault).remote(), timeout=PATIENCE)
    except Exception:
        return ""
    return found
