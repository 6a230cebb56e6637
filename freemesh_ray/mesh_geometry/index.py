"""How many irregular nodes a boundary asks for: the index theorem for quadrilateral meshes.

Let q be the elements that a boundary node should have, max(1, its inner angle over 90 degrees, rounded). Euler's
formula then says for every all-quad mesh that has them

    sum over interior nodes of (4 - valence)  =  4 chi - sum over boundary nodes of (2 - q)  =  the index

with chi = 1 - holes. By the sum of a polygon's angles it is the sum of q - angle / 90 degrees, holes or not. A node of
valence 3 counts 1, one of valence 5 counts -1: so many of these, at least, no such mesh can do without; one with other
numbers of elements at the boundary may have fewer.
"""

from __future__ import annotations

import numpy as np

from envs.mesh import sides
from envs.types import Floats, Ints
from freemesh_ray.mesh_geometry.protocol import PlaneMesh


def index(vertices: Floats, segments: Ints) -> int:
    """The sum of (4 - valence) over the interior nodes that a boundary asks for.

    Args:
        vertices: (n, 2) float64.
        segments: (s, 2) int64, the closed boundary, outer rings and holes, the domain on the left of each.
    """
    quarters = inner_quarters(vertices, segments)
    return round(float((ideal_elements(quarters) - quarters).sum()))


def least_irregular(vertices: Floats, segments: Ints) -> int:
    """The least number of interior nodes of valence 3 and 5; arguments as of :func:`index`."""
    return abs(index(vertices, segments))


def ideal_elements(quarters: Floats) -> Floats:
    """The elements, at least 1, that boundary nodes should have whose inner angles, in right angles, are given."""
    return np.maximum(1.0, np.rint(quarters))


def inner_quarters(vertices: Floats, segments: Ints) -> Floats:
    """(s,) float64: the inner angle at the end of each segment, in right angles, (0, 4].

    Where the boundary meets itself, a segment goes on in the one that leaves the least angle between them.
    """
    order = np.argsort(segments[:, 0], kind="stable")
    starts = segments[order, 0]
    first = np.searchsorted(starts, segments[:, 1], side="left")
    count = np.searchsorted(starts, segments[:, 1], side="right") - first
    behind = vertices[segments[:, 0]] - vertices[segments[:, 1]]
    least = np.full(len(segments), np.inf)
    for k in range(int(count.max(initial=0))):
        has = count > k
        following = segments[order[np.minimum(first + k, len(segments) - 1)]]
        ahead = vertices[following[:, 1]] - vertices[following[:, 0]]
        cross = ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0]
        angle = np.arctan2(cross, (ahead * behind).sum(axis=1)) / (0.5 * np.pi)
        angle = np.where(angle > 0.0, angle, angle + 4.0)
        least = np.where(has, np.minimum(least, angle), least)
    return least


def boundary_of(mesh: PlaneMesh) -> Ints:
    """(s, 2) int64: the sides that one element alone has, the mesh on their left."""
    ends = np.concatenate([sides(block).reshape(-1, 2) for block in (mesh.quads, mesh.triangles)]).astype(np.int64)
    base = int(ends.max(initial=0)) + 1
    return ends[~np.isin(ends[:, 0] * base + ends[:, 1], ends[:, 1] * base + ends[:, 0])]
