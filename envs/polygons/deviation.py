"""How far a split outline is from the given one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from envs.types import RELATIVE_TOLERANCE, Floats


def deviation(given: Sequence[Floats], split: Sequence[Floats]) -> float:
    """The largest distance of a given vertex from the split rings, in their units; 0 within the tolerance.

    The split vertices lie on the given outline, so that nothing of either is further from the other.

    Args:
        given, split: rings, each (n, 2).
    """
    starts = np.concatenate(list(split))
    ends = np.concatenate([np.roll(ring, -1, axis=0) for ring in split])
    tree = shapely.STRtree(shapely.linestrings(np.stack([starts, ends], axis=1)))
    points = np.concatenate(list(given))
    _, distance = tree.query_nearest(shapely.points(points), return_distance=True, all_matches=False)
    largest = float(distance.max())
    return largest if largest > RELATIVE_TOLERANCE * float(np.hypot(*np.ptp(points, axis=0))) else 0.0


def bulges(points: Floats, along: Floats, at: Floats) -> Floats:
    """(p,) how far a chain lies off each piece, over the piece's length.

    Args:
        points: (k, 2) the chain's.
        along: (k,) their distances along it.
        at: (p + 1,) distances at which pieces begin and end.
    """
    ends = np.stack([np.interp(at, along, points[:, axis]) for axis in (0, 1)], axis=1)
    piece = np.clip(np.searchsorted(at, along, side="right") - 1, 0, len(at) - 2)
    chord = (ends[1:] - ends[:-1])[piece]
    length = np.maximum(np.linalg.norm(chord, axis=1), np.finfo(np.float64).tiny)
    off = points - ends[piece]
    share = np.clip((off * chord).sum(axis=1) / length**2, 0.0, 1.0)
    found = np.zeros(len(at) - 1)
    np.maximum.at(found, piece, np.linalg.norm(off - share[:, None] * chord, axis=1) / length)
    return found
