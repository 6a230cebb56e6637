"""Experience as flat arrays: a ring of transitions, uniform sampling, a checkpoint of what is filled.

A batch of 256 is one gather an array; nothing is done per episode. Truncation needs no care here: a transition whose
episode was truncated after it is stored with its true successor and ``terminated`` false.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from ray.rllib.utils.checkpoints import Checkpointable


class Transitions(NamedTuple):
    """(s, a, r, s', terminated), one row a step, or the return of several steps.

    Attributes:
        obs: (m, observation size) float32.
        actions: (m, action size) float32.
        rewards: (m,) float32, discounted to s where they are of several steps.
        next_obs: (m, observation size) float32, after the last of them.
        terminated: (m,) float32, 1 where s' is terminal.
        steps: (m,) float32, how many steps lie between s and s'.
    """

    obs: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    next_obs: np.ndarray
    terminated: np.ndarray
    steps: np.ndarray

    def __len__(self) -> int:  # rows, not fields
        return len(self.rewards)


def concatenate(pieces: list[Transitions]) -> Transitions:
    """The rows of all pieces, in order."""
    return Transitions(*(np.concatenate(arrays) for arrays in zip(*pieces, strict=True)))


class ReplayBuffer(Checkpointable):
    """The experience pool D.

    Args:
        capacity: transitions kept; the oldest give way.
        observation_size, action_size: widths of the rows.
        seed: of the sampling.
    """

    def __init__(self, capacity: int, observation_size: int, action_size: int, seed: int | None = None) -> None:
        self._ctor = (capacity, observation_size, action_size, seed)
        self.capacity = capacity
        # Untouched pages cost no memory: a pool of 1e6 starts small.
        self._rows = Transitions(
            np.empty((capacity, observation_size), dtype=np.float32),
            np.empty((capacity, action_size), dtype=np.float32),
            np.empty(capacity, dtype=np.float32),
            np.empty((capacity, observation_size), dtype=np.float32),
            np.empty(capacity, dtype=np.float32),
            np.empty(capacity, dtype=np.float32),
        )
        self._size = 0
        self._next = 0
        self._random = np.random.default_rng(seed)

    def __len__(self) -> int:
        return self._size

    def add(self, new: Transitions) -> None:
        """Append transitions; of more than ``capacity`` only the last are kept."""
        count = min(len(new), self.capacity)
        first = min(count, self.capacity - self._next)
        for stored, rows in zip(self._rows, new, strict=True):
            rows = rows[len(rows) - count :]
            stored[self._next : self._next + first] = rows[:first]
            stored[: count - first] = rows[first:]
        self._next = (self._next + count) % self.capacity
        self._size = min(self.capacity, self._size + count)

    def sample(self, count: int) -> Transitions:
        """``count`` transitions, uniformly with replacement.

        Raises:
            ValueError: the buffer is empty.
        """
        if not self._size:
            raise ValueError("the replay buffer is empty: collect transitions before sampling")
        index = self._random.integers(self._size, size=count)
        return Transitions(*(stored.take(index, axis=0) for stored in self._rows))

    def reseed(self, seed: int) -> None:
        """Sample otherwise from here on."""
        self._random = np.random.default_rng([seed, len(self)])

    def get_state(self, components: Any = None, *, not_components: Any = None, **kwargs: Any) -> dict[str, Any]:
        """What is filled, where the next row goes, and the sampling's random state."""
        return {
            "rows": tuple(stored[: self._size].copy() for stored in self._rows),
            "next": self._next,
            "random": self._random.bit_generator.state,
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Take over a state; one of a larger buffer is cut to the newest ``capacity`` transitions."""
        rows, following = Transitions(*state["rows"]), int(state["next"])
        size = len(rows)
        self._size = self._next = 0
        if size <= self.capacity and (following == size or size == self.capacity):
            for stored, saved in zip(self._rows, rows, strict=True):
                stored[:size] = saved
            self._size, self._next = size, following % self.capacity
        else:
            self.add(Transitions(*(np.roll(saved, -following, axis=0) for saved in rows)))
        self._random.bit_generator.state = state["random"]

    def get_metadata(self) -> dict[str, Any]:
        """Nothing beyond what every checkpointable component says of itself."""
        return super().get_metadata()

    def get_ctor_args_and_kwargs(self) -> tuple[tuple[Any, ...], dict[str, Any]]:
        """Arguments that make an empty buffer like this one."""
        return self._ctor, {}
