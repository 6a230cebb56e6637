"""Sizes on triangles: linear on each, and known nowhere else."""

from __future__ import annotations

import numpy as np
import shapely

from envs.errors import UserError
from envs.types import Floats, Ints


class Triangles:
    """A size as a function of place, from values at the corners of triangles.

    Args:
        points: (p, 2) float64.
        corners: (t, 3) int64 rows of ``points``.
        values: (p,) the sizes; those of corners are positive.
        source: the name that messages begin with.

    Raises:
        UserError: a value of a corner that is no size, or triangles without area.
    """

    def __init__(self, points: Floats, corners: Ints, values: Floats, source: str) -> None:
        used = np.unique(corners)
        check_values(points[used], values[used], source)
        a, b, c = (points[corners[:, i]] for i in range(3))
        area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        kept = area != 0.0
        if not kept.any():
            raise UserError(f"{source}: no triangles with an area; give sizes on triangles in the x, y plane")
        self.corner, self.values, self.area = np.stack([a, b, c], axis=1)[kept], values[corners[kept]], area[kept]
        self.tree = shapely.STRtree(shapely.polygons(self.corner))
        self.source = source

    def __call__(self, places: Floats) -> Floats:
        """(m,) sizes at (m, 2) places; one beside the triangles, within the size there, has that of the nearest.

        Raises:
            UserError: a place further away.
        """
        (_, nearest), distance = self.tree.query_nearest(
            shapely.points(places), return_distance=True, all_matches=False
        )
        a, b, c = np.moveaxis(self.corner[nearest], 1, 0)
        p, area = places, self.area[nearest]
        # Shares of the corners: areas opposite to them over the whole.
        u = ((b - p)[:, 0] * (c - p)[:, 1] - (b - p)[:, 1] * (c - p)[:, 0]) / area
        v = ((c - p)[:, 0] * (a - p)[:, 1] - (c - p)[:, 1] * (a - p)[:, 0]) / area
        share = np.clip(np.stack([u, v, 1.0 - u - v], axis=1), 0.0, 1.0)
        found = (share * self.values[nearest]).sum(axis=1) / share.sum(axis=1)
        far = np.flatnonzero(distance > found)
        if len(far):
            worst = far[distance[far].argmax()]
            x, y = places[worst]
            raise UserError(
                f"{self.source}: does not cover the domain: no size at ({x:g}, {y:g}), the nearest is "
                f"{distance[worst]:.3g} away; give sizes all over the domain, in its units"
            )
        return np.asarray(found, dtype=np.float64)


def check_values(points: Floats, values: Floats, source: str) -> None:
    """Refuse sizes that are none.

    Args:
        points: (m, 2) their places.
        values: (m,).
        source: the name that messages begin with.

    Raises:
        UserError: the first one that is no positive number, with its place.
    """
    wrong = np.flatnonzero(~(np.isfinite(points).all(axis=1) & np.isfinite(values) & (values > 0.0)))
    if len(wrong):
        x, y = points[wrong[0]]
        raise UserError(f"{source}: size {values[wrong[0]]:g} at ({x:g}, {y:g}); give positive numbers")
