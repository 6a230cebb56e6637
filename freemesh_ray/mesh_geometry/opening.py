r"""A mesh cut open along some of its edges: a vertex between two cuts becomes one for each of its sides.

::

    o---o---o---o---o        o---o---o---o---o       c   a cut; both of its sides are boundary now. Its tips, around
    |   |   |   |   |        |   |   |   |   |           which the elements stay joined, are not doubled.
    o---c===c===c---o   ->   o---c<=====>c---o
    |   |   |   |   |        |   |   |   |   |
    o---o---o---o---o        o---o---o---o---o
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from envs.mesh import sides
from envs.types import Ints


@dataclass(frozen=True)
class Opening:
    """Elements after their mesh was cut open.

    Attributes:
        quads: (m, 4) int64, over vertices of which the new ones come last.
        origin: (n + c,) int64, which vertex each one was; the first n are their own.
    """

    quads: Ints
    origin: Ints


def opened(quads: Ints, vertices: int, edges: Ints) -> Opening:
    """Cut a mesh open.

    Args:
        quads: (m, 4) int64, of a valid mesh.
        vertices: n, how many there are.
        edges: (k, 2) int64, edges between two elements each, in either direction.
    """
    from scipy.sparse import coo_array  # a quarter of a second that meshes without lines need not wait
    from scipy.sparse.csgraph import connected_components

    on_cut = np.zeros(vertices, dtype=np.bool_)
    on_cut[edges] = True
    ends = sides(quads).reshape(-1, 2)
    keys = ends[:, 0] * vertices + ends[:, 1]
    cut = np.isin(np.sort(ends, axis=1) @ [vertices, 1], np.sort(edges, axis=1) @ [vertices, 1])
    order = np.argsort(keys)
    at = np.minimum(np.searchsorted(keys[order], ends[:, 1] * vertices + ends[:, 0]), len(keys) - 1)
    other = order[at]
    joined = np.flatnonzero((keys[other] == ends[:, 1] * vertices + ends[:, 0]) & ~cut)
    # Across an edge that is not cut: the corner here at its start, and the one there at its end, are of one vertex.
    behind = other[joined]
    far = behind - behind % 4 + (behind + 1) % 4
    wanted = on_cut[ends[joined, 0]]
    near, far = joined[wanted], far[wanted]
    graph = coo_array((np.ones(len(near), dtype=np.int8), (near, far)), shape=(len(ends), len(ends)))
    _, part = connected_components(graph, directed=False)
    corner = np.flatnonzero(on_cut[quads.ravel()])
    _, first, which = np.unique(part[corner], return_index=True, return_inverse=True)
    vertex = quads.ravel()[corner[first]]
    number = np.empty(len(first), dtype=np.int64)
    taken = np.zeros(vertices, dtype=np.bool_)
    origin = [np.arange(vertices)]
    added = 0
    for i in np.argsort(first, kind="stable").tolist():
        v = int(vertex[i])
        number[i] = vertices + added if taken[v] else v
        if taken[v]:
            origin.append(np.array([v]))
            added += 1
        taken[v] = True
    flat = quads.ravel().copy()
    flat[corner] = number[which.ravel()]
    return Opening(flat.reshape(-1, 4), np.concatenate(origin))
