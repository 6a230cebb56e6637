"""Nodes of elements of a higher order whose sides are all straight.

What puts them on curves has the same arguments and the same numbering, and takes this one's place.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from envs.mesh import Mesh, sides
from envs.types import Floats, Ints


class HighOrder(NamedTuple):
    """A mesh's nodes, (n, 2) float64: the vertices, those on edges, those inside; its elements, (m, (k + 1)^2) int64.

    An element's nodes are row by row, the first row along its first side.
    """

    nodes: Floats
    elements: Ints


def high_order(mesh: Mesh, order: int) -> HighOrder:
    """The nodes and elements of an order k >= 1; edges are in the order of their ends, the lower vertex first."""
    k, m, n = order, len(mesh.quads), len(mesh.vertices)
    ends = sides(mesh.quads)
    edges, edge_of = np.unique(np.sort(ends, axis=-1).reshape(-1, 2), axis=0, return_inverse=True)
    number = n + edge_of.reshape(m, 4, 1) * (k - 1) + np.arange(k - 1)
    walked = np.where((ends[..., 0] > ends[..., 1])[..., None], number[..., ::-1], number)
    grid = np.empty((m, k + 1, k + 1), dtype=np.int64)
    grid[:, 0, 0], grid[:, 0, k], grid[:, k, k], grid[:, k, 0] = mesh.quads.T
    grid[:, 0, 1:k], grid[:, 1:k, k] = walked[:, 0], walked[:, 1]
    grid[:, k, 1:k], grid[:, 1:k, 0] = walked[:, 2, ::-1], walked[:, 3, ::-1]
    grid[:, 1:k, 1:k] = n + len(edges) * (k - 1) + np.arange(m * (k - 1) ** 2).reshape(m, k - 1, k - 1)
    t = np.arange(1, k)[:, None] / k
    first, last = mesh.vertices[edges].transpose(1, 0, 2)[:, :, None]
    along = (1 - t) * first + t * last
    a, b, c, d = mesh.vertices[mesh.quads].transpose(1, 0, 2)[:, :, None, None]
    across = t[:, None]
    inside = (1 - across) * ((1 - t) * a + t * b) + across * ((1 - t) * d + t * c)
    return HighOrder(np.concatenate([mesh.vertices, along.reshape(-1, 2), inside.reshape(-1, 2)]), grid.reshape(m, -1))
