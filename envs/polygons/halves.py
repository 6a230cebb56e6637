r"""Half of what is symmetric: the part to the left of an axis, to be meshed and mirrored.

::

    +-----------+              +-----------+
    |   /---\   |              |   /---\   |        The rings are cut where they cross the axis. Along it the ends of
    |  |     |  |              |  |     |  |        the pieces are joined in turns: from the first to the second, from
    x--x-----x--x  the axis    x->x     x->x        the third to the fourth.
    |  |     |  |
    |   \---/   |
    +-----------+
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from envs.polygons.axis import Axis
from envs.polygons.rings import extent, oriented, place
from envs.types import RELATIVE_TOLERANCE, DomainError, Floats

#: How far the two halves may differ, as a share of the diameter, by default.
SYMMETRIC = 1e-6


@dataclass(frozen=True, eq=False)
class Half:
    """A polygon to the left of an axis.

    Attributes:
        rings: the outer one first, each (n, 2) float64; the given vertices, bit for bit, but for those on the axis, and
            new ones where the axis cuts.
        of: number of the polygon that it is a part of, or all.
        image: number of the polygon that its mirror image is a part of, or all.
    """

    rings: list[Floats]
    of: int
    image: int


def halves(polygons: Sequence[Sequence[Floats]], axis: Axis, source: str, tolerance: float | None = None) -> list[Half]:
    """What is to the left of an axis.

    Args:
        polygons: for each its valid rings, each (n, 2), the outer one first.
        axis: that all of them together are symmetric to.
        source: what messages begin with.
        tolerance: how far they may differ from their mirror image; by default ``SYMMETRIC`` of their diameter.

    Raises:
        DomainError: they are not symmetric; the place where they differ most, and the axis that would do, if one does.
    """
    diameter = extent(np.concatenate([ring for rings in polygons for ring in rings]))
    near = SYMMETRIC * diameter if tolerance is None else tolerance
    shapes = [shapely.Polygon(rings[0], rings[1:]) for rings in polygons]
    partners, worst, where = _partners(shapes, axis)
    if worst > near:
        raise DomainError(
            f"{source}: not symmetric to the axis {axis}: {place(where)} is {worst:.3g} from the mirror image, at most "
            f"{near:.3g} is allowed; {_fix(shapes, axis, near)}"
        )
    found = []
    for i, rings in enumerate(polygons):
        whole = [oriented(ring, counterclockwise=r == 0) for r, ring in enumerate(rings)]
        left = _left(whole, axis, RELATIVE_TOLERANCE * diameter)
        if left:
            found.append(Half(left, i, partners[i]))
    return found


def _partners(shapes: Sequence[shapely.Polygon], axis: Axis) -> tuple[list[int], float, Floats]:
    """For each polygon the one that is its mirror image; how far the worst one is off, and where."""
    known = np.array([_known(shape) for shape in shapes])
    partners, worst, where = [], 0.0, axis.start
    for shape in shapes:
        image = shapely.transform(shape, axis.mirrored)
        alike = np.linalg.norm(known - _known(image), axis=1)
        partners.append(int(alike.argmin()))
        off, at = _difference(image, shapes[partners[-1]])
        if off > worst:
            worst, where = off, at
    return partners, worst, where


def _known(shape: shapely.Polygon) -> Floats:
    """(3,) what tells polygons apart: the centre, and the root of the area."""
    return np.array([*shape.centroid.coords[0], np.sqrt(shape.area)])


def _difference(first: shapely.Polygon, second: shapely.Polygon) -> tuple[float, Floats]:
    """How far vertices and middles of segments of two polygons are off the other's outline at most, and where."""
    worst, where = 0.0, np.zeros(2)
    for one, other in ((first, second), (second, first)):
        rings = [shapely.get_coordinates(ring) for ring in (one.exterior, *one.interiors)]
        places = np.concatenate([part for ring in rings for part in (ring, 0.5 * (ring[1:] + ring[:-1]))])
        shapely.prepare(other.boundary)
        off = shapely.distance(other.boundary, shapely.points(places))
        if off.max() > worst:
            worst, where = float(off.max()), places[off.argmax()]
    return worst, where


def _fix(shapes: Sequence[shapely.Polygon], axis: Axis, near: float) -> str:
    """What to do: the axis of this direction through the middle, where that is one."""
    points = shapely.get_coordinates(shapes)
    off = axis.offsets(points)
    middle = replace(axis, start=axis.start + 0.5 * (off.min() + off.max()) * axis.left)
    if _partners(shapes, middle)[1] <= near:
        return f"it is to {middle}: give that axis"
    return "give another axis, or mesh it whole"


def _left(rings: list[Floats], axis: Axis, tolerance: float) -> list[Floats]:
    """The rings to the left of an axis of one symmetric polygon; none: all of it is to the right.

    Each point of a half is joined to its image, so the half is one polygon.

    Args:
        rings: the outer one first, counter-clockwise, the holes clockwise.
        axis: what it is cut at.
        tolerance: how far from the axis a vertex may be that lies on it.
    """
    pieces: list[Floats] = []
    apart: list[Floats] = []
    for ring in rings:
        off = axis.offsets(ring)
        on = np.abs(off) <= tolerance
        side = np.where(on, 0, np.sign(off))
        if (side > 0).all():
            apart.append(ring)
        elif (side > 0).any():
            pieces += _pieces(np.where(on[:, None], axis.projected(ring), ring), side, axis)
    return [_closed(pieces, axis), *apart] if pieces else apart


def _pieces(ring: Floats, side: np.ndarray, axis: Axis) -> list[Floats]:
    """The stretches of a ring to the left of an axis, each from the axis to it.

    Args:
        ring: (n, 2), some of it to the left.
        side: (n,) 1 to the left, 0 on the axis, -1 to the right.
        axis: the axis.
    """
    ahead, beyond = np.roll(ring, -1, axis=0), np.roll(side, -1)
    cut = np.flatnonzero(side * beyond < 0)
    off, other = axis.offsets(ring[cut]), axis.offsets(ahead[cut])
    share = (off / (off - other))[:, None]
    crossing = axis.projected(ring[cut] + share * (ahead[cut] - ring[cut]))
    ring, side = np.insert(ring, cut + 1, crossing, axis=0), np.insert(side, cut + 1, 0)
    left = side > 0
    starts = np.flatnonzero(left & ~np.roll(left, 1)) - 1
    found = []
    for start in starts.tolist():
        walk = np.roll(np.arange(len(ring)), -start)
        end = 1 + int(np.argmin(left[walk[1:]]))
        found.append(ring[walk[: end + 1]])
    return found


def _closed(pieces: list[Floats], axis: Axis) -> Floats:
    """The ring of pieces that begin and end on an axis, joined along it; the inside is left of the pieces and of it."""
    stations = axis.stations(np.concatenate([[piece[0], piece[-1]] for piece in pieces]))
    order = np.argsort(stations, kind="stable") // 2
    # From the end of a piece along the axis to the start of the next one.
    after = dict(zip(order[::2].tolist(), order[1::2].tolist(), strict=True))
    walk = [0]
    while (following := after[walk[-1]]) != 0:
        walk.append(following)
    return np.concatenate([pieces[i] for i in walk])
