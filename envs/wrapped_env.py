"""FreeMesh-v0 in Gymnasium wrappers of a user's: a single environment, and a batch of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import SyncVectorEnv

from envs.errors import PluginError
from envs.mesh_env import MeshEnv, Task, ending
from envs.plug_in import PlugIn, subclass

KEY = "env.wrappers"


class Guard(gym.Wrapper[np.ndarray, np.ndarray, np.ndarray, np.ndarray]):
    """The outermost wrapper: what the others raise or return is an observation of numbers, or a `PluginError`."""

    def __init__(self, env: gym.Env[Any, Any], wrappers: Sequence[PlugIn]) -> None:
        super().__init__(env)
        self._all = PlugIn(KEY, ", ".join(plug_in.spec for plug_in in wrappers), None, wrappers[-1].file)
        seen, acted = env.observation_space, env.action_space
        if not isinstance(seen, spaces.Box) or len(seen.shape) != 1:
            raise self._all.wrong(f"observations are {seen}", "leave them a Box of one dimension")
        ends = (acted.low, acted.high) if isinstance(acted, spaces.Box) and len(acted.shape) == 1 else ()
        if [set(end.tolist()) for end in ends] != [{-1}, {1}]:
            raise self._all.wrong(f"actions are {acted}", "leave them a Box of one dimension from -1 to 1")
        self.observation_space = spaces.Box(seen.low.astype(np.float32), seen.high.astype(np.float32), dtype=np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, acted.shape, dtype=np.float32)

    def reset(self, **options: Any) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode.

        Raises:
            PluginError: a wrapper failed.
        """
        found = self._call(self.env.reset, 2, **options)
        return self._observation(found[0]), found[1]

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Take a step.

        Raises:
            PluginError: a wrapper failed.
        """
        observation, reward, terminated, truncated, info = self._call(self.env.step, 5, action)
        number = self._all.as_number(reward)
        if terminated or truncated:  # by a wrapper, perhaps
            info = {**ending(base(self).episodes, 0), **info}
        return self._observation(observation), number, bool(terminated), bool(truncated), info

    def _call(self, function: Any, count: int, *arguments: Any, **options: Any) -> tuple[Any, ...]:
        def call() -> Any:
            return function(*arguments, **options)

        found = PlugIn(KEY, self._all.spec, call, self._all.file)()
        if not isinstance(found, tuple) or len(found) != count:
            raise self._all.wrong(f"returned {found!r:.60}", f"return {count} values, as Gymnasium has them")
        return found

    def _observation(self, found: Any) -> np.ndarray:
        shape = self.observation_space.shape
        try:
            observation = np.array(found, dtype=np.float32)
        except (TypeError, ValueError):
            raise self._all.wrong(f"observed {found!r:.60}", f"return {shape} numbers") from None
        if observation.shape != shape:
            raise self._all.wrong(f"observed {observation.shape}", f"return {shape}, as the observation space says")
        if not np.isfinite(observation).all():
            raise self._all.wrong(f"observed {observation[~np.isfinite(observation)][0]}", "return finite numbers")
        return observation


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


def base(env: gym.Env[Any, Any]) -> MeshEnv:
    """The environment within wrappers.

    Raises:
        PluginError: there is none.
    """
    inner = env.unwrapped
    if not isinstance(inner, MeshEnv):
        raise PluginError(f"{KEY}: wraps no {MeshEnv.__name__}: hand the environment to super().__init__")
    return inner
