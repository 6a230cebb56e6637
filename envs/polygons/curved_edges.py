"""Which edges of a polyline or a mesh stand for pieces of curves; vertices moved onto the curves.

An edge stands for the piece of a curve between its ends when both lie on it, no other vertex lies between them, the
piece bulges by less than a half circle, and, where the outlines are known that the edges came from, the piece runs
along one of them. So the chord that closes a half disc, or the side of one region that cuts off the cap of another,
stays straight.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from envs.mesh import STRAIGHT, CurvedEdges
from envs.polygons.drawing import Line
from envs.polygons.rings import extent
from envs.types import Floats, Ints

#: A vertex is on a curve when it is no further from it than the chords that it was flattened to, times this, ...
SLACK = 1.1

#: ... and this share of the extent: where ends nearly met, one of them was moved onto the other.
JOINED = 1e-6

#: The curve's middle is no further from that of its edge than this share of the edge's length: 1/2 is a half circle.
BULGE = 0.45

#: A vertex is moved when it is further from where it should be than this share of the coordinates: rounding is less.
ROUNDING = 1e-14

#: Where between its ends a curve is compared with an edge and an outline.
BETWEEN = np.array([0.25, 0.5, 0.75])


def curved_edges(
    points: Floats, edges: Ints, lines: Sequence[Line], outlines: Sequence[Floats] | None = None
) -> CurvedEdges:
    """The edges that stand for pieces of the lines' curves.

    Args:
        points: (p, 2) float64, on the lines or moved onto the curves.
        edges: (e, 2) int64, boundary segments, or edges inside.
        lines: those without a curve are passed over.
        outlines: the rings, each (n, 2), that the edges came from; None: not known, as of lines inside.

    Returns:
        Edges in the given order and direction; an edge that could stand for two curves, for the closer one. Curves on
        which no edge lies are left out.
    """
    curved = [line for line in lines if line.curve is not None]
    if not curved or not len(edges):
        return STRAIGHT
    used = np.unique(edges)
    size = extent(points[used])
    tree = shapely.STRtree(shapely.points(points[used]))
    drawn = None if outlines is None else shapely.STRtree(np.concatenate([segments_of(ring) for ring in outlines]))
    starts_at = np.argsort(edges[:, 0], kind="stable")
    best, owner = np.full(len(edges), np.inf), np.full(len(edges), -1, dtype=np.int64)
    for c, line in enumerate(curved):
        tolerance = SLACK * sagitta(line) + JOINED * size
        near = used[np.sort(tree.query(shapely.linestrings(line.points), predicate="dwithin", distance=2 * tolerance))]
        if len(near) < 2:
            continue
        assert line.curve is not None
        parameters = line.curve.nearest(points[near])
        off = np.linalg.norm(line.curve.at(parameters) - points[near], axis=1)
        on = off <= tolerance
        near, parameters = near[on], parameters[on]
        mine = edges_among(edges, starts_at, near)
        mine = mine[neighbours(points, edges[mine], near, parameters, closes(line))]
        if not len(mine):
            continue
        ends = points[edges[mine]]
        piece = line.curve.between(ends[:, 0], ends[:, 1], BETWEEN)
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        bulge = np.linalg.norm(piece[:, 1] - ends.mean(axis=1), axis=1)
        good = bulge <= BULGE * length
        if drawn is not None:
            inner = shapely.points(piece[good].reshape(-1, 2))
            off = drawn.query_nearest(inner, all_matches=False, return_distance=True)[1].reshape(-1, len(BETWEEN))
            good[good] = (off <= tolerance).all(axis=1)
        better = mine[good & (bulge < best[mine])]
        best[mine] = np.where(good, np.minimum(bulge, best[mine]), best[mine])
        owner[better] = c
    found = np.flatnonzero(owner >= 0)
    which, curve_of = np.unique(owner[found], return_inverse=True)
    curves = tuple(curve for i in which if (curve := curved[i].curve) is not None)
    return CurvedEdges(edges[found], curve_of.astype(np.int64), curves)


def on_curves(points: Floats, curved: CurvedEdges) -> Floats:
    """(p, 2) float64: the points, the ends of curved edges moved to the nearest place of their curve.

    Those of two curves, and those that are there but for rounding, stay as they are. Meshes that share vertices are to
    be given together, so that both keep sharing them.
    """
    moved = np.array(points, dtype=np.float64)
    pairs = np.unique(np.stack([curved.edges.ravel(), np.repeat(curved.curve_of, 2)], axis=1), axis=0)
    several = np.bincount(pairs[:, 0], minlength=len(points)) > 1
    pairs = pairs[~several[pairs[:, 0]]]
    tolerance = ROUNDING * float(np.abs(points).max(initial=0.0))
    for c, curve in enumerate(curved.curves):
        mine = pairs[pairs[:, 1] == c, 0]
        places = curve.at(curve.nearest(points[mine])) if len(mine) else points[mine]
        off = np.linalg.norm(places - points[mine], axis=1) > tolerance
        moved[mine[off]] = places[off]
    return moved


def sagitta(line: Line) -> float:
    """How far the line's chords are from its curve at most, in their middles."""
    assert line.curve is not None
    middles = 0.5 * (line.points[:-1] + line.points[1:])
    return float(np.linalg.norm(line.curve.at(line.curve.nearest(middles)) - middles, axis=1).max())


def closes(line: Line) -> bool:
    """Whether the line ends where it begins."""
    return len(line.points) > 2 and bool(
        np.linalg.norm(line.points[0] - line.points[-1]) <= JOINED * extent(line.points)
    )


def segments_of(ring: Floats) -> np.ndarray:
    """The (n,) segments of an (n, 2) ring, as shapely's."""
    return shapely.linestrings(np.stack([ring, np.roll(ring, -1, axis=0)], axis=1))


def edges_among(edges: Ints, starts_at: Ints, vertices: Ints) -> Ints:
    """(k,) int64: which edges have both ends among vertices, ascending.

    Args:
        edges: (e, 2) int64.
        starts_at: (e,) int64, their order by their first end.
        vertices: (v,) int64, ascending.
    """
    first = edges[starts_at, 0]
    low, high = np.searchsorted(first, vertices, side="left"), np.searchsorted(first, vertices, side="right")
    count = high - low
    candidates = starts_at[np.repeat(low - (np.cumsum(count) - count), count) + np.arange(count.sum())]
    return np.sort(candidates[np.isin(edges[candidates, 1], vertices)])


def neighbours(points: Floats, edges: Ints, vertices: Ints, parameters: Floats, closed: bool) -> np.ndarray:
    """(e,) bool: which edges lead from a vertex on a curve to the next one on it.

    Args:
        points: (p, 2) float64; vertices at one place count as one.
        edges: (e, 2) int64, between vertices of those given.
        vertices: (v,) int64, ascending, that lie on the curve.
        parameters: (v,) float64, where.
        closed: whether the last one is a neighbour of the first one.
    """
    if not len(vertices):
        return np.zeros(len(edges), dtype=bool)
    order = np.argsort(parameters, kind="stable")
    apart = np.any(points[vertices[order[1:]]] != points[vertices[order[:-1]]], axis=1)
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.append(0, np.cumsum(apart))
    count = int(rank.max()) + 1
    between = np.abs(np.diff(rank[np.searchsorted(vertices, edges)], axis=1).ravel())
    return (between == 1) | (closed & (between == count - 1) & (count > 1))
