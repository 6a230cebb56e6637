"""Which boundary segments lie on which line of a drawing: by place, so that names survive however a boundary is split.

A segment lies on a line when both of its ends do and the line stays near it between them, as an arc does and a
semicircle's diameter does not. Of several lines the one that is nearest to its middle has it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely

from envs.polygons.drawing import Line
from envs.polygons.rings import extent
from envs.types import Floats, Ints

#: Ends within this share of the drawing's extent of a line lie on it: drawings are often written with six digits.
ON_LINE = 2e-6

#: How far a line may lie off the middle of a segment on it, over the segment's length; a semicircle does by a half.
BULGE = 0.45


class Along(NamedTuple):
    """What of a line lies on the outlines.

    Attributes:
        ends: (k, 2) float64, where it reaches them, leaves them, begins or ends on them.
        inside: its polylines that lie off them, each (m, 2), cut where they come near.
        on: how much of its length lies on them.
    """

    ends: Floats
    inside: list[Floats]
    on: float


def tolerance(polygons: Sequence[Sequence[Floats]]) -> float:
    """How far off a line a vertex may lie that is on it, in the polygons' units."""
    return ON_LINE * extent(np.concatenate([ring for rings in polygons for ring in rings]))


def segments_of(polygons: Sequence[Sequence[Floats]]) -> shapely.STRtree:
    """The segments of all rings of polygons, to look for those near a line."""
    pairs = [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for rings in polygons for ring in rings]
    return shapely.STRtree(shapely.linestrings(np.concatenate(pairs)))


def along(line: Line, outlines: shapely.STRtree, near: float) -> Along:
    """Divide a line into what lies on the outlines and what does not.

    Args:
        line: of a drawing.
        outlines: see `segments_of`.
        near: the distance within which it lies on them.
    """
    path = shapely.LineString(line.points)
    middles = 0.5 * (line.points[:-1] + line.points[1:])
    beside = outlines.geometries[np.sort(outlines.query(path, predicate="dwithin", distance=near))]
    outline = shapely.line_merge(shapely.multilinestrings(beside))
    shapely.prepare(outline)
    if shapely.dwithin(outline, shapely.points(np.concatenate([line.points, middles])), near).all():
        on, off = path, shapely.LineString()  # as most lines: no band has to be made
    else:
        band = shapely.buffer(outline, near, cap_style="square", quad_segs=2)
        on, off = shapely.intersection(path, band), shapely.difference(path, band)
    closed = bool(np.array_equal(line.points[0], line.points[-1]))
    pieces = parts(on, 4.0 * near)
    ends = [] if closed and shapely.is_empty(off) else [piece[[0, -1]] for piece in pieces]
    return Along(np.concatenate([np.zeros((0, 2)), *ends]), parts(off, 4.0 * near), shapely.length(on))


def parts(path: shapely.Geometry, least: float) -> list[Floats]:
    """The polylines of a path that are longer than ``least``, each (m, 2)."""
    merged = shapely.line_merge(path) if path.geom_type == "MultiLineString" else path
    return [
        shapely.get_coordinates(piece)
        for piece in shapely.get_parts(merged)
        if piece.geom_type == "LineString" and piece.length > least
    ]


def line_of_segments(points: Floats, segments: Ints, lines: Sequence[Line], near: float) -> Ints:
    """(s,) int64: the line that each boundary segment lies on; -1 for none.

    Args:
        points: (p, 2).
        segments: (s, 2), indices into ``points``.
        lines: of the drawing.
        near: the distance within which an end lies on a line.
    """
    found = np.full(len(segments), -1)
    if not lines or not len(segments):
        return found
    paths = np.array([shapely.LineString(line.points) for line in lines])
    ends = points[segments]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    middles = shapely.points(ends.mean(axis=1))
    s, k = shapely.STRtree(paths).query(middles, predicate="dwithin", distance=BULGE * length)
    if not len(s):
        return found
    first, last = (shapely.distance(paths[k], shapely.points(ends[s, e])) for e in (0, 1))
    on = np.maximum(first, last) <= near
    s, k = s[on], k[on]
    off = shapely.distance(paths[k], middles[s])
    # The nearest last, and of equal ones the first: assignments keep what comes last.
    order = np.lexsort([-k, -np.round(off / near), s])
    found[s[order]] = k[order]
    return found


def sides_by_name(segments: Ints, line_of: Ints, lines: Sequence[Line]) -> dict[str, Ints]:
    """(k, 2) segments of each name, in the order in which lines first name them.

    Args:
        segments: (s, 2).
        line_of: see `line_of_segments`.
        lines: of the drawing; those without a name name nothing.
    """
    names = [line.name for line in lines]
    found: dict[str, list[Ints]] = {}
    for k, name in enumerate(names):
        if name and (line_of == k).any():
            found.setdefault(name, []).append(segments[line_of == k])
    return {name: np.concatenate(parts) for name, parts in found.items()}
