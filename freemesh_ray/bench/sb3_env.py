"""The batched environment as Stable-Baselines3 wants it: the peer that speed and learning are measured against."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from envs.mdp.episodes import Episodes
from envs.mesh_env import spaces_of
from envs.types import Domain, MeshingParameters


class MeshVecEnv(VecEnv):
    """B episodes on one domain; an episode that ends is begun anew within the same step, as SB3 expects."""

    def __init__(self, domain: Domain, parameters: MeshingParameters, num_envs: int) -> None:
        self._episodes = Episodes([domain], parameters, num_envs)
        super().__init__(num_envs, *spaces_of(parameters))
        self._actions = np.zeros((num_envs, parameters.action_size))
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self._returns = np.zeros(num_envs)

    def reset(self) -> np.ndarray:
        """Begin all episodes."""
        for i in range(self.num_envs):
            self._begin(i)
        return self._episodes.out.observation.copy()

    def step_async(self, actions: np.ndarray) -> None:
        """Remember the actions."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Take them."""
        out = self._episodes.step(self._actions)
        rewards, done = out.reward.copy(), out.terminated | out.truncated
        self._steps += 1
        self._returns += rewards
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(done):
            infos[i] = {
                "terminal_observation": out.observation[i].copy(),
                "TimeLimit.truncated": bool(out.truncated[i] and not out.terminated[i]),
                "episode": {"r": float(self._returns[i]), "l": int(self._steps[i]), "t": 0.0},
            }
            self._begin(int(i))
        return out.observation.copy(), rewards, done, infos

    def _begin(self, i: int) -> None:
        self._episodes.start(i, 0)
        self._steps[i], self._returns[i] = 0, 0.0

    def close(self) -> None:
        """Nothing to release."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """SB3 asks for the render mode only."""
        return [getattr(self, attr_name, None)] * len(self._indices(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Not supported."""
        raise AttributeError(attr_name)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Not supported."""
        raise AttributeError(method_name)

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """No wrapper is."""
        return [False] * len(self._indices(indices))

    def _indices(self, indices: Any) -> Sequence[int]:
        if indices is None:
            return range(self.num_envs)
        return [indices] if isinstance(indices, int) else list(indices)
