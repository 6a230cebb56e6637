"""The mesher's last resort: any even ring, whatever its shape, filled with strictly convex quadrilaterals.

That a filling exists is shown, and one constructed, in :mod:`envs.filling.diagonals`. Mostly dynamic programming finds
a better one (:mod:`envs.filling.chords`), for long rings piece by piece (:mod:`envs.filling.partition`). Both are
smoothed, and the one whose worst element is better is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from envs.filling.chords import by_chords
from envs.filling.diagonals import by_diagonals
from envs.filling.fitness import fitnesses
from envs.filling.partition import partition
from envs.filling.smoothing import smooth, stars_of
from envs.filling.triangulation import triangulate
from envs.types import Floats, Ints

#: Rings up to this length are filled as a whole.
WHOLE = 32


class FillError(ValueError):
    """A ring that cannot be filled: odd, not weakly simple, or thinner than its coordinates are precise."""


@dataclass(frozen=True)
class Fill:
    """A filled ring.

    Attributes:
        points: (p + s, 2) float64, the given points first, untouched, then the new ones inside the ring.
        quads: (m, 4) int64 indices into ``points``, strictly convex and counter-clockwise; every edge of the ring
            belongs to one of them, every other edge to two.
    """

    points: Floats
    quads: Ints


def fill(points: Floats, ring: Ints) -> Fill:
    """Fill a ring with strictly convex quadrilaterals; its edges stay whole.

    Args:
        points: (p, 2) float64.
        ring: (n,) int64 indices into ``points``, n even, n >= 4, counter-clockwise and weakly simple: a point may occur
            more than once where the ring walks a seam. Inner angles lie strictly between 0 and 2 pi.

    Returns:
        The filling, of at most 4 (n - 2) quadrilaterals. The same ring always gets the same one.

    Raises:
        FillError: the ring is odd or shorter than 4, crosses itself or runs clockwise, or is so thin that no strictly
            convex element with float64 coordinates fits.
    """
    points, ring = np.asarray(points, dtype=np.float64), np.asarray(ring, dtype=np.int64)
    n = len(ring)
    if n < 4 or n % 2:
        raise FillError(f"a ring of {n} vertices: only even ones from 4 on can be filled; split an edge")
    if n == 4 and fitnesses(points[ring], np.arange(4)[None])[0] > 0.0:
        return Fill(points.copy(), ring[None].copy())
    xy, quads = best_filling(np.ascontiguousarray(points[ring]))
    number = np.concatenate([ring, len(points) + np.arange(len(xy) - n)])
    return Fill(np.concatenate([points, xy[n:]]), number[quads])


def best_filling(xy: Floats) -> tuple[Floats, Ints]:
    """The filling of a ring whose worst element is best: (n + s, 2) points, the ring's first, and (m, 4) elements."""
    n, place = len(xy), tuple(xy[0].tolist())
    triangulation = triangulate(xy)
    if triangulation is None:
        raise FillError(
            f"a ring of {n} vertices from {place} on has no triangulation: it meets itself, runs clockwise or is too "
            "thin for its coordinates; move its vertices apart"
        )
    candidates = [by_chords(xy) if n <= WHOLE else by_pieces(xy, *triangulation), by_diagonals(xy, *triangulation)]
    fillings = [smoothed(np.concatenate([xy, new]), quads, n) for new, quads in filter(None, candidates)]
    best = max(fillings, key=worst, default=None)
    if best is None or worst(best) == 0.0:
        raise FillError(
            f"a ring of {n} vertices from {place} on is too thin for its coordinates: no strictly convex element fits; "
            "move its vertices apart"
        )
    return best


def worst(filling: tuple[Floats, Ints]) -> float:
    """The least fitness of a filling's elements; 0 when not all are certainly strictly convex."""
    return float(fitnesses(*filling).min())


def smoothed(points: Floats, quads: Ints, first: int) -> tuple[Floats, Ints]:
    """The filling with its points from ``first`` on moved, unless that makes the worst element worse."""
    moved = points.copy()
    smooth(moved, quads, first, *stars_of(quads, len(points)))
    return max((points, quads), (moved, quads), key=worst)


def by_pieces(xy: Floats, triangles: Ints, across: Ints) -> tuple[Floats, Ints] | None:
    """Fill a long ring piece by piece; arguments and result as :func:`envs.filling.diagonals.by_diagonals`."""
    n = len(xy)
    points, rings = partition(xy, triangles, across)
    elements: list[Ints] = []
    for ring in rings:
        here = np.ascontiguousarray(points[ring])
        filling = by_chords(here)
        if filling is None and (triangulation := triangulate(here)):
            filling = by_diagonals(here, *triangulation)
        if filling is None:
            return None
        new, quads = filling
        number = np.concatenate([ring, len(points) + np.arange(len(new))])
        points = np.concatenate([points, new])
        elements.append(number[quads])
    return points[n:], np.concatenate(elements)
