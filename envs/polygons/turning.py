"""How far polylines turn, in radians, positive to the left.

The one door to the compiled geometry: what imports from here is compiled anew only when this file changes.
"""

from __future__ import annotations

import numpy as np

from envs.kernels.geometry import signed_angles
from envs.types import Floats

__all__ = ["bends", "signed_angles", "turns"]


def turns(ring: Floats) -> Floats:
    """(n,) the turn at each vertex of an (n, 2) ring, in [-pi, pi]."""
    ahead = np.roll(ring, -1, axis=0) - ring
    return signed_angles(np.roll(ahead, 1, axis=0), ahead)


def bends(points: Floats) -> Floats:
    """(k - 2,) the turn at each inner vertex of an open (k, 2) polyline, in [-pi, pi]."""
    steps = np.diff(points, axis=0)
    return signed_angles(steps[:-1], steps[1:])
