"""FreeMesh-v0 in Gymnasium wrappers of a user's: a single environment, and a batch of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import SyncVectorEnv

from envs.mesh_env import MeshEnv, Task
from envs.plug_ins.lookup import subclass
from envs.wrappers.outermost import KEY, Guard, base


class Tasks:
    """The tasks of many environments as one."""

    def __init__(self, tasks: Sequence[Task]) -> None:
        self._tasks = tasks

    def get(self) -> dict[str, float]:
        """Weight of each domain by name."""
        return self._tasks[0].get()

    def set(self, weights: dict[str, float]) -> None:
        """Draw the next episodes of all from these domains alone, in proportion to their weights."""
        for task in self._tasks:
            task.set(weights)


class WrappedVectorEnv(SyncVectorEnv):
    """``num_envs`` wrapped environments, stepped one after another; each goes as a `MeshVectorEnv`'s with its seed.

    Its state is not known, as wrappers keep what they like: a training that goes on begins new episodes.
    """

    def __init__(self, num_envs: int, wrappers: Sequence[Any], **options: Any) -> None:
        """Make them.

        Args:
            num_envs: >= 1.
            wrappers: see `wrapped`.
            options: those of MeshEnv.
        """
        super().__init__([lambda: wrapped(wrappers, **options)] * num_envs)
        self.task = Tasks([base(env).task for env in self.envs])


def wrapped(wrappers: Sequence[Any], **options: Any) -> gym.Env[np.ndarray, np.ndarray]:
    """An environment in wrappers.

    Args:
        wrappers: Gymnasium wrappers, or their names, ``package.module:Name``; the innermost first.
        options: those of MeshEnv.

    Raises:
        PluginError: one cannot be had, or they leave something else than vectors.
    """
    env: gym.Env[Any, Any] = MeshEnv(**options)
    found = [subclass(named, KEY, gym.Wrapper, "a class of gymnasium.Wrapper") for named in wrappers]
    for wrapper in found:
        env = wrapper(env)
        if not (isinstance(env, gym.Wrapper) and isinstance(env.unwrapped, MeshEnv)):
            raise wrapper.wrong("does not wrap the environment that it was given", "hand it to super().__init__")
    return Guard(env, found) if found else env
