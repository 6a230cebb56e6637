"""The regions of a mesh: every element in one of them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from envs.types import Ints
from freemesh_ray.export.finite_elements import Region
from freemesh_ray.export.names import free

#: What elements without a name are called.
DOMAIN = "domain"


def partition(groups: Mapping[str, Ints], count: int) -> tuple[Region, ...]:
    """The regions that names are given for, (k,) int64 elements each, and one of the elements that are left.

    An element that two names are given for is of the first one's region.
    """
    left = np.ones(count, dtype=bool)
    found = []
    for name, members in groups.items():
        mine = np.unique(members)
        mine = mine[left[mine]]
        left[mine] = False
        if len(mine):
            found.append(Region(name, mine))
    if left.any():
        found.append(Region(free(DOMAIN, {region.name for region in found}), np.flatnonzero(left)))
    return tuple(found)
