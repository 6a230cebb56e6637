"""Where rows of boundary layers end along a side that has none: their points come first on it, its own give way."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from envs.types import Floats

#: A vertex stays when the rows end before this share of the segment that leads to it.
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

    def inside(self) -> Floats:
        """(m, 2) the vertices between the rows at its ends: the given ones that rows neither pass nor come close to.

        Where these are fewer by an odd number the longest segment that is left is split, or where ``more`` asks for one
        more and they are not: the number of segments changes by an even number, and by ``more``.
        """
        first, last = self.taken_first, self.length - self.taken_last
        steps = np.diff(self.along)
        kept = (self.along[1:-1] - first >= (1.0 - FREE) * steps[:-1]) & (
            last - self.along[1:-1] >= (1.0 - FREE) * steps[1:]
        )
        found = self.points[1:-1][kept]
        if (len(kept) - len(found) + self.more) % 2 == 0:
            return found
        at = np.concatenate([[first], self.along[1:-1][kept], [last]])
        i = int(np.diff(at).argmax())
        return np.insert(found, i, self.at(0.5 * (at[i : i + 1] + at[i + 1])), axis=0)

    @property
    def spacing(self) -> float:
        """The longest segment between the rows."""
        ends = np.array([self.taken_first, self.length - self.taken_last])
        return float(np.diff(np.union1d(ends, self.along[(self.along > ends[0]) & (self.along < ends[1])])).max())
