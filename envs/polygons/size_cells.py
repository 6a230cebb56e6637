"""A size as a function of place, in cells no larger than the size there: points to remember it by, and elements.

The cells are squares that are split into four until each is at most as large as the size at its middle.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from envs.errors import UserError
from envs.types import Floats

#: Sizes, (m,), at (m, 2) places; domain units.
Size = Callable[[Floats], Floats]

#: Cells along the longer side to begin with; how often they are split at most, and up to how many cells.
FIRST, SPLITS, MOST_CELLS = 16, 12, 200_000


class Cells(NamedTuple):
    """Square cells that cover a box.

    Attributes:
        points: (m, 3) float64, x, y and the size at their middles.
        sides: (m,) float64, domain units.
    """

    points: Floats
    sides: Floats

    @property
    def elements(self) -> float:
        """Squares of the size wanted that the cells hold."""
        return float(((self.sides / self.points[:, 2]) ** 2).sum())


def cells(size: Size, low: Floats, high: Floats) -> Cells:
    """The cells of a box.

    Args:
        size: asked for the middles of cells.
        low, high: (2,) corners of the box.

    Raises:
        UserError: a size that is no positive number, or so many shapes or such small sizes that the cells are too many.
    """
    side = float((high - low).max()) / FIRST
    counts = np.maximum(1, np.ceil((high - low) / side - 1e-9)).astype(np.int64)
    steps = np.stack(np.meshgrid(*(np.arange(count) for count in counts), indexing="ij"), axis=-1).reshape(-1, 2)
    middles = low + (steps + 0.5) * side
    done: list[Floats] = []
    sides: list[Floats] = []
    for level in range(SPLITS + 1):
        found = sizes_of(size, middles)
        split = (found < side) & (level < SPLITS)
        done.append(np.column_stack([middles, found])[~split])
        sides.append(np.full(int((~split).sum()), side))
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * side / 4.0
        middles, side = (middles[split][:, None] + corners).reshape(-1, 2), side / 2.0
        if sum(map(len, done)) + len(middles) > MOST_CELLS:
            raise UserError(
                f"sizes down to {found.min():g} take more than {MOST_CELLS:,} cells to describe: give larger sizes"
            )
        if len(middles) == 0:
            break
    return Cells(np.concatenate(done), np.concatenate(sides))


def sizes_of(size: Size, places: Floats) -> Floats:
    """What a function says of places.

    Raises:
        UserError: it returned something else than a positive number for each.
    """
    try:
        found = np.broadcast_to(np.asarray(size(places), dtype=np.float64), (len(places),))
    except (TypeError, ValueError):
        raise UserError(f"size: return a number for each of the {len(places)} places, (m, 2), that are given") from None
    wrong = np.flatnonzero(~(np.isfinite(found) & (found > 0.0)))
    if len(wrong):
        x, y = places[wrong[0]]
        raise UserError(f"size: {found[wrong[0]]:g} at ({x:g}, {y:g}): return positive numbers")
    return found
