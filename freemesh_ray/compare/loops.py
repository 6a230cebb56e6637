"""The given boundary of a domain as closed loops, which is how other meshers take it."""

from __future__ import annotations

import numpy as np

from envs.rings import signed_area
from envs.types import Domain, Ints


def loops(domain: Domain) -> list[Ints]:
    """Indices into the domain's points of its outer ring, counter-clockwise, then of its holes, clockwise."""
    following = dict(domain.segments.tolist())
    found = []
    while following:
        first, here = following.popitem()
        loop = [first]
        while here != first:
            loop.append(here)
            here = following.pop(here)
        found.append(np.array(loop, dtype=np.int64))
    return sorted(found, key=lambda loop: -signed_area(domain.points[loop]))
