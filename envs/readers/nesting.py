"""Loops inside loops: which are outer rings, which are holes (the even-odd rule)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from envs.polygons.rings import LARGEST_COORDINATE, check_rings, pairs_of
from envs.types import DomainError, Floats

#: The rings of one polygon, the outer one first.
Rings = list[Floats]

#: Pairs of a ring and one around it, at most.
MOST_INSIDE = 500_000


def nested(groups: Sequence[Sequence[Rings]], source: str) -> list[Rings]:
    """Polygons of groups of faces: a group inside an even number of others is solid, inside an odd number a hole.

    ::

        +--------------+      A in nothing: solid
        | A  +------+  |      B in A: a hole of A
        |    |B +-+ |  |      C in B and A: solid again
        |    |  |C| |  |
        |    |  +-+ |  |      A group of several faces that share sides counts as one: all its faces are solid, or its
        |    +------+  |      outline is a hole.
        +--------------+

    Args:
        groups: each the faces of one connected drawing, each face its rings; groups do not cross each other.
        source: the name that messages begin with.

    Returns:
        The rings of each polygon, outer ones in the order given; of two equal groups one is kept.

    Raises:
        DomainError: too many rings, or rings in each other.
    """
    check_rings(sum(len(rings) for group in groups for rings in group), source)
    groups = without_copies(groups)
    borders = [outermost(group) for group in groups]
    regions = [enclosed(border) for border in borders]
    areas = shapely.area(regions).tolist()
    around = containing(regions, areas, source)
    # The solid groups around each; a hole has one, unless the groups cross each other after all.
    solid = [[p for p in outer if len(around[p]) % 2 == 0] for outer in around]
    holes: dict[int, list[int]] = {}
    polygons: dict[tuple[int, int], Rings] = {}
    for g, group in enumerate(groups):
        if len(around[g]) % 2 and solid[g]:
            holes.setdefault(min(solid[g], key=areas.__getitem__), []).append(g)
        else:
            polygons |= {(g, f): list(rings) for f, rings in enumerate(group)}
    for parent, inside in holes.items():
        found = faces_around(groups[parent], [borders[g][0] for g in inside])
        for g, face in zip(inside, found, strict=True):
            polygons[parent, face].extend(borders[g])
    return list(polygons.values())


def without_copies(groups: Sequence[Sequence[Rings]]) -> list[Sequence[Rings]]:
    """The groups, each drawn once: drawings often hold the same loop twice."""
    kept: dict[bytes, Sequence[Rings]] = {}
    for group in groups:
        points = np.concatenate([ring for rings in group for ring in rings])
        kept.setdefault(np.unique(points, axis=0).tobytes(), group)
    return list(kept.values())


def outermost(group: Sequence[Rings]) -> Rings:
    """The outermost rings of a group's faces together."""
    if len(group) == 1:
        return [group[0][0]]
    whole = shapely.union_all([shapely.Polygon(rings[0]) for rings in group])
    return [np.asarray(polygon.exterior.coords)[:-1] for polygon in shapely.get_parts(whole)]


def containing(regions: Sequence[shapely.Geometry], areas: Sequence[float], source: str) -> list[list[int]]:
    """For each region the larger ones that contain it."""
    found: list[list[int]] = [[] for _ in regions]
    total = 0
    for inner, outer in pairs_of(shapely.STRtree(regions), shapely.point_on_surface(regions), "within"):
        total += len(inner)
        if total > MOST_INSIDE:
            raise DomainError(f"{source}: too many rings inside each other; remove copies, or split the file")
        for i, j in zip(inner.tolist(), outer.tolist(), strict=True):
            if areas[j] > areas[i]:
                found[i].append(j)
    return found


def enclosed(border: Rings) -> shapely.Geometry:
    """What a border encloses; nothing when it is broken, which is for the checks of the rings to say."""
    regions = [shapely.Polygon(r) for r in border if len(r) > 2 and (np.abs(r) <= LARGEST_COORDINATE).all()]
    whole = shapely.MultiPolygon(regions)
    return whole if whole.is_valid else shapely.MultiPolygon()


def faces_around(group: Sequence[Rings], holes: Sequence[Floats]) -> list[int]:
    """For each hole, which face of a group contains it."""
    if len(group) == 1:
        return [0] * len(holes)
    regions = np.array([shapely.Polygon(rings[0]) for rings in group])
    tree, areas = shapely.STRtree(regions), shapely.area(regions)
    places = [shapely.Polygon(hole).point_on_surface() for hole in holes]
    return [min(tree.query(at, predicate="within").tolist(), key=areas.__getitem__, default=0) for at in places]
