"""Narrow places of a domain: where two sides of the boundary face each other across the inside.

From places along the boundary a ray goes inwards, across the domain, to what it meets first. That is a gap when it
faces the ray: the two sides are parallel within ``FACING``. Beside a corner two sides meet at an angle; unless it is
smaller than that, there is none.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from envs.polygons.rings import signed_area
from envs.types import RELATIVE_TOLERANCE, Floats

#: The two sides of a gap are parallel within this angle (radians).
FACING = np.radians(15.0)

#: Elements wanted across a gap.
ACROSS = 3

#: Rays are this many edge lengths apart, or the smallest size.
APART = 1 / 16

#: Rays at most; from a longer boundary they go further apart.
MOST_RAYS = 200_000


def gaps(polygons: Sequence[Sequence[Floats]], edge_length: float, least: float) -> Floats:
    """Sizes that gaps ask for.

    Args:
        polygons: for each its rings, each (n, 2), the outer one first.
        edge_length: gaps of at least ``ACROSS`` times this are none.
        least: the smallest size that is wanted anywhere.

    Returns:
        (m, 3) float64: places on the boundary, and a share ``ACROSS`` of the gap's width there.
    """
    found = [_gaps_of(rings, edge_length, least) for rings in polygons]
    return np.concatenate([np.zeros((0, 3)), *found])


def _gaps_of(rings: Sequence[Floats], edge_length: float, least: float) -> Floats:
    """The gaps of one polygon."""
    # Every ring with the inside to its left.
    walked = [ring if (signed_area(ring) > 0) == (r == 0) else ring[::-1] for r, ring in enumerate(rings)]
    starts = np.concatenate(walked)
    steps = np.concatenate([np.roll(ring, -1, axis=0) for ring in walked]) - starts
    lengths = np.linalg.norm(steps, axis=1)
    apart = max(APART * edge_length, least, lengths.sum() / MOST_RAYS)
    counts = np.maximum(1, np.ceil(lengths / apart)).astype(np.int64)
    side = np.repeat(np.arange(len(starts)), counts)
    share = (np.arange(len(side)) - np.repeat(np.cumsum(counts) - counts, counts) + 0.5) / counts[side]
    origins = starts[side] + share[:, None] * steps[side]
    headings = steps / lengths[:, None]
    inwards = np.stack([-headings[:, 1], headings[:, 0]], axis=1)[side]
    reach = ACROSS * edge_length
    tolerance = RELATIVE_TOLERANCE * float(np.ptp(starts, axis=0).max())
    sides = shapely.linestrings(np.stack([starts, starts + steps], axis=1))
    rays = shapely.linestrings(np.stack([origins, origins + reach * inwards], axis=1))
    ray, met = shapely.STRtree(sides).query(rays, predicate="intersects")
    others = met != side[ray]
    ray, met = ray[others], met[others]
    # Along the ray: origin + t inwards = start + u step, so t = cross(start - origin, step) / cross(inwards, step).
    cross = inwards[ray, 0] * steps[met, 1] - inwards[ray, 1] * steps[met, 0]
    to = starts[met] - origins[ray]
    with np.errstate(divide="ignore", invalid="ignore"):
        width = (to[:, 0] * steps[met, 1] - to[:, 1] * steps[met, 0]) / cross
    valid = np.isfinite(width) & (width > tolerance)
    ray, met, width = ray[valid], met[valid], width[valid]
    order = np.lexsort([width, ray])
    ray, met, width = ray[order], met[order], width[order]
    first = np.append(True, ray[1:] != ray[:-1])[: len(ray)]
    ray, met, width = ray[first], met[first], width[first]
    facing = (headings[side[ray]] * headings[met]).sum(axis=1) <= -np.cos(FACING)
    ray, width = ray[facing], width[facing]
    return np.column_stack([origins[ray], width / ACROSS])
