"""FreeMesh-v0 as an environment that RLlib knows by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ray import tune

from envs.mesh_env import MeshEnv
from envs.vector_env import MeshVectorEnv

NAME = "FreeMesh-v0"


def create(context: Mapping[str, Any]) -> MeshEnv | MeshVectorEnv:
    """The native batched environment where RLlib asks for ``num_envs``, else a single one."""
    options = dict(context)
    num_envs = options.pop("num_envs", None)
    return MeshEnv(**options) if num_envs is None else MeshVectorEnv(num_envs=num_envs, **options)


def register() -> str:
    """Make the environment known to RLlib on this and every worker process; its name."""
    tune.register_env(NAME, create)
    return NAME
