"""Polygons beside each other: whether any two overlap, and where a slit is left between neighbours.

::

    +-------+.......          +-------+ +-------+
    |   A   | B    :          |   A   | |   B   |      Where two polygons are meant to share a side, one that reaches
    |    +--|---+  :          |       | |       |      into the other gives elements twice, and a slit leaves their
    +----|--+   |  :          +-------+ +-------+      meshes apart.
         +------+..:              overlap  ^ gap
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from envs.polygons.rings import pairs_of, place
from envs.types import RELATIVE_TOLERANCE, DomainError, Floats


@dataclass(frozen=True)
class Gap:
    """A slit between two polygons.

    Attributes:
        first, second: the polygons, by number, in ascending order.
        x, y: a vertex of the one that is near the other.
        width: its distance from it.
    """

    first: int
    second: int
    x: float
    y: float
    width: float


def check_overlaps(polygons: Sequence[Sequence[Floats]], sources: Sequence[str], tolerance: float) -> None:
    """Refuse polygons of which two have a part in common.

    Args:
        polygons: for each its valid rings, each (n, 2), the outer one first.
        sources: what messages call each.
        tolerance: a common part that is narrower, in the polygons' units, is what rounding leaves.

    Raises:
        DomainError: the first two that overlap, with a place in the common part and its area.
    """
    for i, j, common in overlaps(polygons, tolerance):
        where = common.point_on_surface().coords[0]
        raise DomainError(
            f"{sources[j]}: overlaps polygon {i} at {place(where)}, by an area of {common.area:.6g}; cut it off one of "
            "the two"
        )


def overlaps(polygons: Sequence[Sequence[Floats]], tolerance: float) -> Iterator[tuple[int, int, shapely.Geometry]]:
    """The pairs i < j of polygons that overlap, in order of i, and the largest piece that each has in common.

    Args:
        polygons, tolerance: as for `check_overlaps`.
    """
    solid = solids(polygons)
    for i, j in pairs_of(shapely.STRtree(solid), solid, "intersects"):
        later = i < j
        order = np.lexsort([j[later], i[later]])
        for a, b in zip(i[later][order].tolist(), j[later][order].tolist(), strict=True):
            parts = shapely.get_parts(shapely.intersection(solid[a], solid[b]))
            if not len(parts):
                continue
            # A thin strip of width w and length l has the area w l and the perimeter 2 l.
            wide = parts[2.0 * shapely.area(parts) > tolerance * shapely.length(parts)]
            if len(wide):
                yield a, b, wide[shapely.area(wide).argmax()]


def gaps_between(polygons: Sequence[Sequence[Floats]], tolerance: float) -> list[Gap]:
    """Where neighbouring polygons are apart by up to a tolerance, yet do not touch: the widest place of each pair.

    Looked at are the vertices: along two straight sides the width has its extremes there.

    Args:
        polygons: for each its valid rings, each (n, 2), the outer one first.
        tolerance: the widest gap that is told, in the polygons' units.
    """
    if len(polygons) < 2:
        return []
    solid = solids(polygons)
    points = np.concatenate([ring for rings in polygons for ring in rings])
    owner = np.repeat(np.arange(len(polygons)), [sum(map(len, rings)) for rings in polygons])
    touching = RELATIVE_TOLERANCE * float(np.hypot(*np.ptp(points, axis=0)))
    places = shapely.points(points)
    found: dict[tuple[int, int], Gap] = {}
    for i, j in pairs_of(shapely.STRtree(solid), places, "dwithin", tolerance):
        apart = owner[i] != j
        i, j = i[apart], j[apart]
        width = shapely.distance(places[i], solid[j])
        for k in np.flatnonzero(width > touching).tolist():
            first, second = sorted((int(owner[i[k]]), int(j[k])))
            known = found.get((first, second))
            if known is None or known.width < width[k]:
                x, y = points[i[k]].tolist()
                found[first, second] = Gap(first, second, x, y, float(width[k]))
    return [found[pair] for pair in sorted(found)]


def solids(polygons: Sequence[Sequence[Floats]]) -> np.ndarray:
    """(p,) the polygons as shapely's, prepared to be asked often."""
    solid = np.array([shapely.Polygon(rings[0], rings[1:]) for rings in polygons], dtype=object)
    shapely.prepare(solid)
    return solid
