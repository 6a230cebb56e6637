"""What stands around wrappers of a user's: it checks what they return, and finds the environment within."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from envs.errors import PluginError
from envs.mesh_env import MeshEnv, ending
from envs.plug_ins.named_object import PlugIn

#: The setting that names wrappers.
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


def base(env: gym.Env[Any, Any]) -> MeshEnv:
    """The environment within wrappers.

    Raises:
        PluginError: there is none.
    """
    inner = env.unwrapped
    if not isinstance(inner, MeshEnv):
        raise PluginError(f"{KEY}: wraps no {MeshEnv.__name__}: hand the environment to super().__init__")
    return inner
