"""Which edges lie along a line."""

from __future__ import annotations

import numpy as np
import shapely

from envs.polygons.rings import extent
from envs.types import RELATIVE_TOLERANCE, Floats, Ints

#: Vertices lie on a line within this many tolerances: those between its own points are interpolated.
LOOSE = 10.0


def edges_along(points: Floats, edges: Ints, line: Floats) -> Ints:
    """(k, 2) int64: the edges that lie along a line, each in the line's direction, in their order along it.

    Args:
        points: (p, 2) float64.
        edges: (e, 2) int64, in either direction.
        line: (n, 2) float64, a polyline; where edges lie along it, it is straight between their ends, or they stand for
            a stretch of it with no other of their vertices on it.
    """
    used = np.unique(edges)
    if not len(used):
        return edges.reshape(-1, 2)
    tolerance = LOOSE * RELATIVE_TOLERANCE * max(extent(points), extent(line))
    pieces = shapely.linestrings(np.stack([line[:-1], line[1:]], axis=1))
    vertex, piece = shapely.STRtree(pieces).query(shapely.points(points[used]), predicate="dwithin", distance=tolerance)
    vertex = used[vertex]
    # A line that crosses itself, or is closed, passes a vertex twice.
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    at = (np.cumsum(steps) - steps)[piece] + shapely.line_locate_point(pieces[piece], shapely.points(points[vertex]))
    order = np.argsort(at, kind="stable")
    passed = vertex[order]
    passed = passed[np.append(True, passed[1:] != passed[:-1])[: len(passed)]]
    steps_along = np.stack([passed[:-1], passed[1:]], axis=1)
    base = len(points)
    known = np.sort(edges, axis=1) @ [base, 1]
    return steps_along[np.isin(np.sort(steps_along, axis=1) @ [base, 1], known)]
