"""Straight lines that shapes are mirrored at or turned around."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from envs.types import DomainError, Floats

#: The coordinate axes by name; with y >= 0 and x >= 0 to the left of each.
NAMED = {"x": ((0.0, 0.0), (1.0, 0.0)), "y": ((0.0, 0.0), (0.0, -1.0))}

#: What may be given.
FORM = "x, y, or x0,y0,x1,y1, two different points"


@dataclass(frozen=True, eq=False)
class Axis:
    """A directed line.

    Attributes:
        start: (2,) float64, a point of it.
        along: (2,) float64, its direction, of length 1.
    """

    start: Floats
    along: Floats

    @property
    def left(self) -> Floats:
        """(2,) the direction to its left."""
        return np.array([-self.along[1], self.along[0]])

    def offsets(self, points: Floats) -> Floats:
        """(n,) how far (n, 2) points lie to its left."""
        return np.asarray((points - self.start) @ self.left)

    def stations(self, points: Floats) -> Floats:
        """(n,) how far (n, 2) points lie along it."""
        return np.asarray((points - self.start) @ self.along)

    def projected(self, points: Floats) -> Floats:
        """(n, 2) the places on it next to points; of a coordinate axis exactly on it."""
        return points - self.offsets(points)[:, None] * self.left

    def mirrored(self, points: Floats) -> Floats:
        """(n, 2) points mirrored at it; at a coordinate axis exactly."""
        # Adding zero makes one number of -0.0 and 0.0.
        return points - (2.0 * self.offsets(points))[:, None] * self.left + 0.0

    def __str__(self) -> str:
        """As it is given on the command line."""
        end = self.start + self.along
        return ",".join(f"{value:.12g}" for value in (*self.start, *end))


def axis_of(given: str | Sequence[Sequence[float]], source: str) -> Axis:
    """An axis.

    Args:
        given: ``x``, ``y``, ``x0,y0,x1,y1``, or two points.
        source: what messages begin with.

    Raises:
        DomainError: none of these.
    """
    wrong = DomainError(f"{source}: {given!r:.60} is no axis; give {FORM}")
    try:
        if isinstance(given, str):
            word = given.strip().lower()
            numbers: object = NAMED[word] if word in NAMED else [float(number) for number in word.split(",")]
        else:
            numbers = given
        ends = np.array(numbers, dtype=np.float64).reshape(2, 2)
    except (TypeError, ValueError):
        raise wrong from None
    way = ends[1] - ends[0]
    length = float(np.hypot(*way))
    if not 0.0 < length < np.inf:
        raise wrong
    return Axis(ends[0], way / length)
