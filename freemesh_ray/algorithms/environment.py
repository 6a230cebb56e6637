"""FreeMesh-v0, with what a user adds to it, as an environment that RLlib knows by name."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import gymnasium as gym
from gymnasium.vector import VectorEnv
from ray import tune

from envs.mesh_env import MeshEnv
from envs.plug_in import NONE, PlugIns
from envs.vector_env import MeshVectorEnv
from envs.wrapped_env import WrappedVectorEnv, wrapped

NAME = "FreeMesh-v0"


def create(context: Mapping[str, Any]) -> gym.Env[Any, Any] | VectorEnv:
    """The native batched environment where RLlib asks for ``num_envs``, else a single one; a batch of single ones where
    ``plug_ins`` wrap them.
    """
    options = dict(context)
    num_envs = options.pop("num_envs", None)
    plug_ins: PlugIns = options.pop("plug_ins", NONE)
    options |= {"reward": plug_ins.reward, "observe": plug_ins.observe}
    if plug_ins.wrappers:
        make = wrapped if num_envs is None else partial(WrappedVectorEnv, num_envs)
        return make(plug_ins.wrappers, **options)
    return MeshEnv(**options) if num_envs is None else MeshVectorEnv(num_envs=num_envs, **options)


def register() -> str:
    """Make the environment known to RLlib on this and every worker process; its name."""
    tune.register_env(NAME, create)
    return NAME
