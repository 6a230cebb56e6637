"""Returns over n steps (Sutton and Barto 2018, chapter 7): rewards of several steps in one transition.

Of step t it is (s_t, a_t, r_t + gamma r_(t+1) + .. + gamma^(m-1) r_(t+m-1), s_(t+m)) with m = n, or as many steps as
the episode still had. Whether it terminated or was truncated after them stands apart, as for single steps: after a
truncation the value of s_(t+m) counts, discounted by gamma^m.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from freemesh_ray.algorithms.replay_buffer import Transitions


class NStepReturns:
    """The steps of several environments whose n-step returns are not yet known.

    Args:
        n: steps of a return, at least 1.
        gamma: discount.
        envs: how many environments.
        observation_size, action_size: widths of the rows.
    """

    def __init__(self, n: int, gamma: float, envs: int, observation_size: int, action_size: int) -> None:
        self._n = n
        self._powers = gamma ** np.arange(n)
        # Of environment i, in the order of their steps, the first count[i] of row i.
        self._obs = np.zeros((envs, n, observation_size), dtype=np.float32)
        self._actions = np.zeros((envs, n, action_size), dtype=np.float32)
        self._returns = np.zeros((envs, n))
        self._count = np.zeros(envs, dtype=np.int64)

    def add(self, live: np.ndarray, step: Transitions, ended: np.ndarray) -> Transitions:
        """Take one step of the live environments; the transitions that it completes.

        Args:
            live: (envs,) bool, the environments that took one.
            step: their transitions, a row each.
            ended: (envs,) bool, where the step was its episode's last.
        """
        envs = np.flatnonzero(live)
        at = self._count[envs]
        self._obs[envs, at], self._actions[envs, at], self._returns[envs, at] = step.obs, step.actions, 0.0
        age = at[:, None] - np.arange(self._n)
        self._returns[envs] += np.where(age >= 0, self._powers[age.clip(0)], 0.0) * step.rewards[:, None]
        self._count[envs] += 1
        # All of an episode that ended, else what has its n steps.
        whole = np.where(ended[envs], self._count[envs], self._count[envs] == self._n)
        row, slot = np.nonzero(np.arange(self._n) < whole[:, None])
        env = envs[row]
        complete = Transitions(
            self._obs[env, slot], self._actions[env, slot], self._returns[env, slot].astype(np.float32),
            step.next_obs[row], step.terminated[row], (self._count[env] - slot).astype(np.float32),
        )  # fmt: skip
        self._forget(envs[whole > 0], ended)
        return complete

    def _forget(self, envs: np.ndarray, ended: np.ndarray) -> None:
        """Of these environments drop the oldest step, or where the episode ended every one."""
        for array in (self._obs, self._actions, self._returns):
            array[envs, :-1] = array[envs, 1:]
        self._count[envs] = np.where(ended[envs], 0, self._count[envs] - 1)

    def clear(self) -> None:
        """Forget the steps: new episodes begin."""
        self._count[:] = 0

    def get_state(self) -> dict[str, Any]:
        """The steps."""
        return {
            "obs": self._obs.copy(),
            "actions": self._actions.copy(),
            "returns": self._returns.copy(),
            "count": self._count.copy(),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Take over steps; of another n or other environments they are forgotten, as they could not be gone on with."""
        if state["obs"].shape != self._obs.shape:
            self.clear()
            return
        self._obs, self._actions = state["obs"].copy(), state["actions"].copy()
        self._returns, self._count = state["returns"].copy(), state["count"].copy()
