"""FreeMesh-v0, with what a user adds to it, as an environment that RLlib knows by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
from gymnasium.vector import VectorEnv
from ray import tune

from envs.plug_ins.environment_parts import NONE, PlugIns
from envs.plug_ins.search_path import look_in
from envs.vector_env import MeshVectorEnv
from envs.wrappers.wrapped_env import WrappedVectorEnv, wrapped

NAME = "FreeMesh-v0"


def create(context: Mapping[str, Any]) -> gym.Env[Any, Any] | VectorEnv:
    """The native batched environment where RLlib asks for ``num_envs``, else a single one; a batch of single ones where
    ``plug_ins`` wrap them. ``folders`` are where plug-ins are looked for.
    """
    options = dict(context)
    num_envs = options.pop("num_envs", None)
    for folder in options.pop("folders", ()):
        look_in(folder)
    plug_ins: PlugIns = options.pop("plug_ins", NONE)
    options |= {"reward": plug_ins.reward, "observe": plug_ins.observe}
    if num_envs is None:
        return wrapped(plug_ins.wrappers, **options)
    if plug_ins.wrappers:
        return WrappedVectorEnv(num_envs, plug_ins.wrappers, **options)
    return MeshVectorEnv(num_envs=num_envs, **options)


def register() -> str:
    """Make the environment known to RLlib on this and every worker process; its name."""
    tune.register_env(NAME, create)
    return NAME
