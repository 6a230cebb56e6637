"""Lines and points as a file states them, checked before they are anything."""

from __future__ import annotations

import numpy as np

from envs.polygons.rings import check_coordinates, place
from envs.types import DomainError, Floats


def check_line(points: Floats, source: str, what: str) -> None:
    """Refuse (k, 2) points that are no line.

    Args:
        points: k >= 1.
        source: the name that messages begin with.
        what: what messages call it.

    Raises:
        DomainError: coordinates that are no places, or one place alone.
    """
    check_coordinates(points, source, lambda i: f"{what}, point {i}")
    if not np.any(points[1:] != points[:1]):
        raise DomainError(f"{source}: {what} at {place(points[0])} has no length; give it two places, or remove it")
