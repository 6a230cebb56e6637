"""Where rows of boundary layers end along a side that has none: their points come first on it, its own give way."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from envs.types import Floats

#: Vertices stay where they are when the rows end before this share of the first segment.
FREE = 0.6


@dataclass(frozen=True, eq=False)
class Stretch:
    """A stretch of boundary without layers, from one corner to the next.

    Attributes:
        points: (k, 2) float64 its vertices, the ends included.
        taken_first, taken_last: how much of its length rows take at its ends.
        more: segments that it gets beyond those it needs, 0 or 1.
    """

    points: Floats
    taken_first: float = 0.0
    taken_last: float = 0.0
    more: int = 0

    @cached_property
    def along(self) -> Floats:
        """(k,) distance of each vertex from the first one."""
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))])

    @property
    def length(self) -> float:
        """Along it."""
        return float(self.along[-1])

    def at(self, distances: Floats) -> Floats:
        """(m, 2) places at (m,) distances from the first vertex along it."""
        return np.stack([np.interp(distances, self.along, self.points[:, axis]) for axis in (0, 1)], axis=1)

    @property
    def segments(self) -> int:
        """Segments between the rows at its ends: as many, or fewer by an even number, as it had."""
        count = len(self.points) - 1
        if self._undisturbed:
            return count + self.more
        free = 1.0 - (self.taken_first + self.taken_last) / self.length
        return count - 2 * int((count - max(1.0, count * free)) / 2.0 + 0.25) + self.more

    @property
    def _undisturbed(self) -> bool:
        first, last = FREE * self.along[1], FREE * (self.length - self.along[-2])
        if len(self.points) == 2:
            return bool(self.taken_first + self.taken_last <= first)
        return bool(self.taken_first <= first and self.taken_last <= last)

    def inside(self) -> Floats:
        """(segments - 1, 2) the vertices between the rows at its ends: the given ones, and where they are in the way as
        many spaced as they are.
        """
        if self._undisturbed:
            given = self.points
            if self.more:
                i = int(np.diff(self.along).argmax())
                given = np.insert(given, i + 1, 0.5 * (given[i] + given[i + 1]), axis=0)
            return given[1:-1]
        steps = np.arange(len(self.points), dtype=np.float64)
        ends = np.interp([self.taken_first, self.length - self.taken_last], self.along, steps)
        wanted = np.linspace(ends[0], ends[1], self.segments + 1)[1:-1]
        return self.at(np.interp(wanted, steps, self.along))
