"""Sizes where lines end, or nodes are to sit, close to a boundary or to another line: elements have to fit between."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from envs.polygons.faces import Face
from envs.polygons.rings import extent
from envs.types import RELATIVE_TOLERANCE, Floats


def close_sizes(faces: Sequence[Face], edge_length: float) -> Floats:
    """(m, 3) float64: x, y and the distance to what is nearest, of places and tips of lines closer than an edge length.

    Args:
        faces: see `faces.divided`.
        edge_length: the largest size that is wanted.
    """
    rows = [np.zeros((0, 3))]
    for face in faces:
        starts = np.concatenate(face.rings)
        ends = np.concatenate([np.roll(ring, -1, axis=0) for ring in face.rings])
        before = np.concatenate([np.roll(ring, 1, axis=0) for ring in face.rings])
        asked = np.concatenate([starts[(ends == before).all(axis=1)], face.places])
        if not len(asked):
            continue
        sides = shapely.linestrings(np.stack([starts, ends], axis=1))
        points = shapely.points(asked)
        place, side = shapely.STRtree(sides).query(points, predicate="dwithin", distance=edge_length)
        distance = shapely.distance(points[place], sides[side])
        apart = distance > RELATIVE_TOLERANCE * extent(starts)
        nearest = np.full(len(asked), np.inf)
        np.minimum.at(nearest, place[apart], distance[apart])
        close = nearest < edge_length
        rows.append(np.column_stack([asked[close], nearest[close]]))
    return np.concatenate(rows)
