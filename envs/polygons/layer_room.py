"""How high boundary layers may be: a third of the room in front of a side, and no steeper than a slope along it."""

from __future__ import annotations

import numpy as np
import shapely

from envs.types import Floats

#: Rows take this share of the way to what lies opposite at most.
SHARE = 1.0 / 3.0

#: How much the height of the rows may change over a distance along the side.
SLOPE = 0.3


def room(origins: Floats, ways: Floats, height: float, segments: Floats, touching: float) -> Floats:
    """(p,) float64 in (0, 1]: the share of a height that there is room for.

    Args:
        origins: (p, 2) places on the boundary.
        ways: (p, 2) how far rows lead from there for a height of 1.
        height: of all rows.
        segments: (s, 2, 2) the boundary.
        touching: the distance within which a segment is the one that the place lies on.
    """
    reach = ways * height / SHARE
    rays = shapely.linestrings(np.stack([origins, origins + reach], axis=1))
    ray, hit = shapely.STRtree(shapely.linestrings(segments)).query(rays, predicate="intersects")
    a, along = segments[hit, 0], segments[hit, 1] - segments[hit, 0]
    way, to = reach[ray], a - origins[ray]
    across = way[:, 0] * along[:, 1] - way[:, 1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (to[:, 0] * along[:, 1] - to[:, 1] * along[:, 0]) / across
    beyond = np.isfinite(share) & (share * np.linalg.norm(way, axis=1) > touching)
    found = np.ones(len(origins))
    np.minimum.at(found, ray[beyond], share[beyond])
    return found


def smoothed(shares: Floats, gaps: Floats, height: float, closed: bool) -> Floats:
    """(v,) shares of a height, none above another one by more than ``SLOPE`` allows on the way between them.

    Args:
        shares: (v,) at the vertices of a run.
        gaps: distances from each vertex to the next one, (v,) when the run is closed, else (v - 1,).
        height: of all rows.
        closed: the last vertex is followed by the first.
    """
    found = shares.tolist()
    steps = (SLOPE * gaps / height).tolist()
    count = len(found)
    for _ in range(2 if closed else 1):
        for i in range(len(steps)):
            found[(i + 1) % count] = min(found[(i + 1) % count], found[i] + steps[i])
        for i in range(len(steps) - 1, -1, -1):
            found[i] = min(found[i], found[(i + 1) % count] + steps[i])
    return np.array(found)
