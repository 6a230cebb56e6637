r"""Rings and lines as one drawing of edges that meet at their ends alone.

::

    +-----------------+        +--------o--------+
    |     \           |        |         \       |       o   points where lines end on a side, cross, or lie upon
    |      \    ____  |   ->   |          \      |           each other: from here on vertices of both
    |  -----\--/----  |        |  ------o--o--o--|
    +--------\--------+        +-----------\-----+

Given vertices keep their places, number for number; what lies within the tolerance of a vertex is that vertex.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from envs.polygons.rings import close_pairs, extent, pairs_of
from envs.types import RELATIVE_TOLERANCE, DomainError, Floats, Ints

#: Rounds in which edges are split where they meet: a point set where two lines cross may lie on a third.
ROUNDS = 8

#: Crossings of lines at most: a scribble of n segments has n^2 / 2.
MOST_CROSSINGS = 100_000


@dataclass(frozen=True)
class Linework:
    """Rings, lines and places over common points.

    Attributes:
        points: (p, 2) float64, distinct; those of the rings first.
        rings: for each polygon its rings, each (n,) int64 vertices in the order given, with those set upon it.
        lines: for each line its vertices, (k,) int64, with those set upon it; a closed one ends with its first.
        places: (m,) int64, the point of each place.
    """

    points: Floats
    rings: list[list[Ints]]
    lines: list[Ints]
    places: Ints


def linework(polygons: Sequence[Sequence[Floats]], lines: Sequence[Floats], places: Floats, source: str) -> Linework:
    """Set vertices wherever lines meet rings, each other or themselves, and wherever places lie on any of them.

    Args:
        polygons: for each its valid rings, each (n, 2); where they share vertices these are equal number for number.
        lines: each (k, 2), k >= 2; closed when its ends are equal.
        places: (m, 2) points.
        source: what messages begin with.

    Raises:
        DomainError: a line without length, or too many crossings.
    """
    rings = [ring for polygon in polygons for ring in polygon]
    given = np.concatenate([*rings, *lines, np.reshape(places, (-1, 2))]) + 0.0
    tolerance = RELATIVE_TOLERANCE * extent(np.concatenate(rings))
    ids, points = _distinct(given, sum(len(ring) for ring in rings), tolerance)
    bounds = np.cumsum([0, *(len(ring) for ring in rings), *(len(line) for line in lines), len(places)])
    parts = [ids[a:b] for a, b in zip(bounds[:-1], bounds[1:], strict=True)]
    # Rings are chains that end where they begin, from here on like closed lines.
    chains = [np.append(part, part[0]) for part in parts[: len(rings)]]
    for number, part in enumerate(parts[len(rings) : -1]):
        chain = part[np.append(True, part[1:] != part[:-1])]
        if len(chain) < 2:
            x, y = points[chain[0]]
            raise DomainError(
                f"{source}: line {number} at ({x:g}, {y:g}) has no length; give it two places or remove it"
            )
        chains.append(chain)
    points, chains = _noded(points, chains, len(rings), parts[-1], tolerance, source)
    starts = np.cumsum([0, *(len(polygon) for polygon in polygons)])
    closed = [chain[:-1] for chain in chains[: len(rings)]]
    return Linework(
        points=points,
        rings=[closed[a:b] for a, b in zip(starts[:-1], starts[1:], strict=True)],
        lines=chains[len(rings) :],
        places=parts[-1],
    )


def _distinct(given: Floats, kept: int, tolerance: float) -> tuple[Ints, Floats]:
    """(n,) which distinct point each given one is, and these; the first ``kept`` are one only where they are equal."""
    _, first, ids = np.unique(given[:, 0] + 1j * given[:, 1], return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))
    ids, points = order[ids.ravel()].astype(np.int64), given[np.sort(first)]
    ring_points = int(ids[:kept].max()) + 1
    stands = np.arange(len(points))
    for i, j in close_pairs(points, tolerance):
        if j >= ring_points and stands[j] == j:
            stands[j] = stands[i]
    kept_ids = np.unique(stands)
    return np.searchsorted(kept_ids, stands[ids]), points[kept_ids]


def _noded(
    points: Floats, chains: list[Ints], rings: int, places: Ints, tolerance: float, source: str
) -> tuple[Floats, list[Ints]]:
    """Points and chains with a vertex wherever a line or a place meets a chain; the first ``rings`` are rings."""
    for _ in range(ROUNDS):
        owner = np.repeat(np.arange(len(chains)), [len(chain) - 1 for chain in chains])
        ends = np.concatenate([np.stack([chain[:-1], chain[1:]], axis=1) for chain in chains])
        edge, point = _points_upon(points, chains, rings, places, ends, owner, tolerance)
        if not len(edge):
            points, edge, point = _crossings(points, rings, ends, owner, tolerance, source)
        if not len(edge):
            break
        chains = _with_points(points, chains, ends, owner, edge, point)
    return points, chains


def _points_upon(
    points: Floats, chains: list[Ints], rings: int, places: Ints, ends: Ints, owner: Ints, tolerance: float
) -> tuple[Ints, Ints]:
    """Edges, and the points that lie upon them between their ends; one of the two is a line's, or a place."""
    asked = np.unique(np.concatenate([*chains, places]))
    of_lines = np.zeros(len(points), dtype=np.bool_)
    of_lines[np.concatenate([*chains[rings:], places])] = True
    lines = shapely.linestrings(points[ends])
    point, edge = shapely.STRtree(lines).query(shapely.points(points[asked]), predicate="dwithin", distance=tolerance)
    point = asked[point]
    upon = (ends[edge] != point[:, None]).all(axis=1) & (of_lines[point] | (owner[edge] >= rings))
    return edge[upon], point[upon]


def _crossings(
    points: Floats, rings: int, ends: Ints, owner: Ints, tolerance: float, source: str
) -> tuple[Floats, Ints, Ints]:
    """The points with those where lines cross something; the edges that do, and which point it is."""
    lines = shapely.linestrings(points[ends])
    drawn = np.flatnonzero(owner >= rings)
    nothing = np.zeros(0, dtype=np.int64)
    first, second = [nothing], [nothing]
    count = 0
    for i, j in pairs_of(shapely.STRtree(lines), lines[drawn], "intersects"):
        i = drawn[i]
        apart = (ends[i][:, :, None] != ends[j][:, None, :]).all(axis=(1, 2)) & ((i < j) | (owner[j] < rings))
        first.append(i[apart])
        second.append(j[apart])
        count += int(apart.sum())
        if count > MOST_CROSSINGS:
            raise DomainError(f"{source}: lines that cross more than {MOST_CROSSINGS:,} times; give fewer lines")
    i, j = np.concatenate(first), np.concatenate(second)
    a, b = points[ends[i, 0]], points[ends[j, 0]]
    u, v = points[ends[i, 1]] - a, points[ends[j, 1]] - b
    cross = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    apart = np.abs(cross) > 0.0
    i, j, a, b, u, v, cross = i[apart], j[apart], a[apart], b[apart], u[apart], v[apart], cross[apart]
    share = ((b - a)[:, 0] * v[:, 1] - (b - a)[:, 1] * v[:, 0]) / cross
    met = a + np.clip(share, 0.0, 1.0)[:, None] * u
    ids, distinct = _distinct(np.concatenate([points, met]), len(points), tolerance)
    return distinct, np.concatenate([i, j]), np.tile(ids[len(points) :], 2)


def _with_points(points: Floats, chains: list[Ints], ends: Ints, owner: Ints, edge: Ints, point: Ints) -> list[Ints]:
    """The chains with points set upon their edges, in order along each."""
    along = points[ends[edge, 1]] - points[ends[edge, 0]]
    share = ((points[point] - points[ends[edge, 0]]) * along).sum(axis=1)
    order = np.lexsort([share, edge])
    edge, point = edge[order], point[order]
    first = np.cumsum([0, *(len(chain) - 1 for chain in chains)])
    grown = []
    for c, chain in enumerate(chains):
        a, b = np.searchsorted(edge, [first[c], first[c + 1]])
        chain = np.insert(chain, edge[a:b] - first[c] + 1, point[a:b])
        grown.append(chain[np.append(True, chain[1:] != chain[:-1])])
    return grown
