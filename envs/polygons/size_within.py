"""A size as a function of place that is asked inside a domain alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from envs.polygons.size_cells import Size
from envs.types import Floats


def within(size: Size, polygons: Sequence[Sequence[Floats]]) -> Size:
    """The size whose value outside of polygons is that at their nearest place.

    Args:
        size: need not know of any place outside.
        polygons: for each its rings, each (n, 2), the outer one first; valid.
    """
    shape = shapely.union_all([shapely.Polygon(rings[0], rings[1:]) for rings in polygons])
    outline = shape.boundary
    shapely.prepare([shape, outline])

    def asked(places: Floats) -> Floats:
        outside = np.flatnonzero(~shapely.intersects_xy(shape, places))
        if len(outside):
            ways = shapely.shortest_line(outline, shapely.points(places[outside]))
            places = places.copy()
            places[outside] = shapely.get_coordinates(ways).reshape(-1, 2, 2)[:, 0]
        return size(places)

    return asked
