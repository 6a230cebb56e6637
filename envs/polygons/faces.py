"""Polygons divided by lines: each part is a face, its rings walked with the inside to their left.

::

    +---------+---------+        two faces: a line from side to side divides
    |         |   |     |        the right one's outer ring walks the line that ends inside on both of its sides,
    |         |   +     |        the left one has the line that floats as a ring of its own, out and back
    |  +---+  |         |
    +---------+---------+
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from envs.polygons.linework import Linework, linework
from envs.polygons.rings import signed_area
from envs.types import Floats, Ints


@dataclass(frozen=True)
class Face:
    """A part of a polygon that no line divides.

    Attributes:
        rings: each (n, 2) float64, the inside to its left, the outer one first. Edges that are walked in both
            directions are lines.
        places: (m, 2) float64, points strictly inside that a node is to sit on.
        marks: (k, 2) float64, vertices of the rings that places lie on: whoever discretises the rings keeps them.
        polygon: which polygon it is a part of.
    """

    rings: list[Floats]
    places: Floats
    marks: Floats
    polygon: int


def divided(polygons: Sequence[Sequence[Floats]], lines: Sequence[Floats], places: Floats, source: str) -> list[Face]:
    """The faces of polygons, in the polygons' order; what of a line lies outside of all of them has no part in it.

    Lines may touch sides, cross, branch, end inside, float, or be closed. Where they meet sides or each other, all of
    these have a vertex; given vertices stay as they are, bit for bit.

    Args:
        polygons: for each its valid rings, each (n, 2), the outer one first; bare outlines, or discretised.
        lines: each (k, 2), k >= 2; closed when its ends are equal.
        places: (m, 2), m >= 0.
        source: what messages begin with.

    Raises:
        DomainError: a line without length, or too many crossings.
    """
    drawing = linework(polygons, lines, places, source)
    points = drawing.points
    inside = _inside(drawing, polygons)
    lone = _lone_places(drawing)
    marked = np.setdiff1d(drawing.places, lone)
    where = _polygon_of(polygons, points[lone])
    faces = []
    for p, rings in enumerate(drawing.rings):
        walks = _walks(points, [_left(points, ring, r) for r, ring in enumerate(rings)], inside[p])
        faces += _faces(points, walks, points[lone[where == p]], marked, p)
    return faces


def line_edges(drawing: Linework) -> Ints:
    """(e, 2) int64: the edges of lines that are no ring's, each once."""
    rings = [np.stack([ring, np.roll(ring, -1)], axis=1) for polygon in drawing.rings for ring in polygon]
    lines = [np.stack([line[:-1], line[1:]], axis=1) for line in drawing.lines]
    known = set(map(tuple, np.sort(np.concatenate(rings), axis=1).tolist()))
    edges = dict.fromkeys(map(tuple, np.sort(np.concatenate([np.zeros((0, 2), np.int64), *lines]), axis=1).tolist()))
    return np.array([edge for edge in edges if edge not in known], dtype=np.int64).reshape(-1, 2)


def _inside(drawing: Linework, polygons: Sequence[Sequence[Floats]]) -> list[Ints]:
    """For each polygon the edges of lines in it, each (e, 2)."""
    edges = line_edges(drawing)
    where = _polygon_of(polygons, drawing.points[edges].mean(axis=1))
    return [edges[where == p] for p in range(len(polygons))]


def _polygon_of(polygons: Sequence[Sequence[Floats]], places: Floats) -> Ints:
    """(m,) which polygon each place lies in, -1 for none."""
    found = np.full(len(places), -1, dtype=np.int64)
    if len(places):
        areas = np.array([shapely.Polygon(rings[0], rings[1:]) for rings in polygons])
        place, polygon = shapely.STRtree(areas).query(shapely.points(places), predicate="within")
        found[place] = polygon
    return found


def _lone_places(drawing: Linework) -> Ints:
    """The points of places that are no vertex of a ring or line."""
    used = np.zeros(len(drawing.points), dtype=np.bool_)
    for chain in [*(ring for polygon in drawing.rings for ring in polygon), *drawing.lines]:
        used[chain] = True
    return np.unique(drawing.places[~used[drawing.places]])


def _left(points: Floats, ring: Ints, r: int) -> Ints:
    """Ring number r of a polygon with the inside to its left, its first vertex kept first."""
    turned = (signed_area(points[ring]) > 0) == (r == 0)
    return ring if turned else np.roll(ring[::-1], 1)


def _steps(rings: Sequence[Ints]) -> Ints:
    """(s, 2) int64: from each vertex of closed walks to the next."""
    return np.concatenate([np.stack([ring, np.roll(ring, -1)], axis=1) for ring in rings])


def _walks(points: Floats, rings: list[Ints], edges: Ints) -> list[Ints]:
    """The closed walks around what rings, and edges inside, bound, the inside to their left.

    A walk that comes to a vertex leaves it by the first edge clockwise from the one it came by.
    """
    if not len(edges):
        return rings
    steps = np.concatenate([_steps(rings), edges, edges[:, ::-1]]).tolist()
    leaving = dict(steps)
    coming: dict[tuple[int, int], int] = {}
    spokes: dict[int, set[int]] = {v: set() for v in np.unique(edges).tolist()}
    for a, b in steps:
        if a in spokes:
            spokes[a].add(b)
        if b in spokes:
            spokes[b].add(a)
    for v, ends in spokes.items():
        there = np.array(sorted(ends))
        away = points[there] - points[v]
        turned = there[np.argsort(np.arctan2(away[:, 1], away[:, 0]))].tolist()
        coming.update({(u, v): w for u, w in zip(turned, [turned[-1], *turned[:-1]], strict=True)})
    found = []
    left = dict.fromkeys((a, b) for a, b in steps)
    while left:
        a, b = next(iter(left))
        walk = []
        while (a, b) in left:
            del left[a, b]
            walk.append(a)
            a, b = b, coming.get((a, b), leaving[b])
        found.append(np.array(walk, dtype=np.int64))
    return found


def _faces(points: Floats, walks: list[Ints], places: Floats, marked: Ints, polygon: int) -> list[Face]:
    """The faces that walks around the parts of a polygon bound."""
    areas = [_area(points, walk) for walk in walks]
    outer = [i for i, area in enumerate(areas) if area > 0.0]
    within: list[list[Ints]] = [[walks[i]] for i in outer]
    inner = [walk for walk, area in zip(walks, areas, strict=True) if area <= 0.0]
    homes = _homes(points, [walks[i] for i in outer], points[[walk[0] for walk in inner]], inner)
    for walk, home in zip(inner, homes.tolist(), strict=True):
        within[home].append(walk)
    of_place = _homes(points, [walks[i] for i in outer], places, [])
    return [
        Face(
            rings=[points[walk] for walk in face],
            places=places[of_place == f],
            marks=points[np.intersect1d(marked, np.concatenate(face))],
            polygon=polygon,
        )
        for f, face in enumerate(within)
    ]


def _area(points: Floats, walk: Ints) -> float:
    """The area a walk goes around: above 0 around a face, below 0 around a hole, 0 along a line out and back."""
    steps = _steps([walk]).tolist()
    known = set(map(tuple, steps))
    once = np.array([(a, b) for a, b in steps if (b, a) not in known], dtype=np.int64).reshape(-1, 2)
    (ax, ay), (bx, by) = (points[once[:, 0]] - points[walk[0]]).T, (points[once[:, 1]] - points[walk[0]]).T
    return float(0.5 * np.sum(ax * by - ay * bx))


def _homes(points: Floats, outer: list[Ints], probes: Floats, own: list[Ints]) -> Ints:
    """(m,) which of the outer walks is the smallest around each probe, of those that do not pass through ``own``."""
    if len(outer) == 1 or not len(probes):
        return np.zeros(len(probes), dtype=np.int64)
    areas = np.array([_area(points, walk) for walk in outer])
    # Edges walked in both directions do not change what a ray crosses an odd number of times.
    shapes = shapely.polygons([shapely.linearrings(points[walk]) for walk in outer])
    probe, home = shapely.STRtree(shapes).query(shapely.points(probes), predicate="intersects")
    apart = np.ones(len(probe), dtype=np.bool_)
    if own:
        through = [set(walk.tolist()) for walk in outer]
        apart = np.array([not through[h].intersection(own[p].tolist()) for p, h in zip(probe, home, strict=True)])
    probe, home = probe[apart], home[apart]
    order = np.lexsort([areas[home], probe])
    probe, home = probe[order], home[order]
    found = np.zeros(len(probes), dtype=np.int64)
    first = np.append(True, probe[1:] != probe[:-1])[: len(probe)]
    found[probe[first]] = home[first]
    return found
