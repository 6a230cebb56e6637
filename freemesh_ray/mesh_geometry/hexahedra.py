"""Hexahedra: their faces and edges, in the order that Abaqus, VTK and Nastran have in common.

::

          7-------6        corners   0 1 2 3 counter-clockwise seen from above, 4 5 6 7 above them
         /|      /|        edges     01 12 23 30 below, 45 56 67 74 above, 04 15 26 37 upright; their middles are the
        4-------5 |                  nodes 8 to 19
        | 3-----|-2        faces     below, above, then over 01 12 23 30; corners counter-clockwise seen from outside
        |/      |/
        0-------1
"""

from __future__ import annotations

import numpy as np

from envs.types import Floats, Ints

FACES = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
EDGES = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]])

#: The corner at the other end of each of a corner's three edges, which make a right-handed frame in this order.
AROUND = np.array([[1, 3, 4], [2, 0, 5], [3, 1, 6], [0, 2, 7], [7, 5, 0], [4, 6, 1], [5, 7, 2], [6, 4, 3]])


def faces_of(hexes: Ints) -> Ints:
    """(m, 6, 4) int64: the corners of the faces of hexahedra of 8 or 20 nodes."""
    return hexes[:, FACES]


def corner_jacobians(nodes: Floats, hexes: Ints) -> Floats:
    """(m, 8) float64: the triple product of the three edges that leave each corner; positive in a valid hexahedron."""
    points = nodes[hexes[:, :8]]
    return np.asarray(np.linalg.det(points[:, AROUND] - points[:, :, None]))


def volumes(nodes: Floats, hexes: Ints) -> Floats:
    """(m,) float64: the volume between the corners, the faces bilinear; exact, and middles are passed over."""
    points = nodes[hexes[:, :8]]
    # The divergence theorem: a third of the flux of x through the faces. Through a bilinear face it is the mean of that
    # through both of its triangulations.
    a, b, c, d = np.moveaxis((points - points.mean(axis=1, keepdims=True))[:, FACES], 2, 0)
    twelve = sum((first * np.cross(second, third)).sum(axis=-1) for first, second, third in
                 ((a, b, c), (a, c, d), (a, b, d), (b, c, d)))  # fmt: skip
    return np.asarray(np.sum(twelve, axis=1) / 12.0)


def with_middles(nodes: Floats, hexes: Ints, edges: Ints, middles: Floats) -> tuple[Floats, Ints, Ints]:
    """Nodes in the middles of the edges, behind the corners.

    Args:
        nodes: (n, 3) corners.
        hexes: (m, 8).
        edges: (k, 2) edges, each once, whose middles are not halfway.
        middles: (k, 3) where these are.

    Returns:
        All nodes, (m, 20) hexahedra, and the edges (e, 2), lower number first, in the order of their middles.
    """
    base = len(nodes)
    every = keys_of(hexes[:, EDGES], base)
    keys, which = np.unique(every, return_inverse=True)
    ends = np.stack(np.divmod(keys, base), axis=1)
    halfway = 0.5 * (nodes[ends[:, 0]] + nodes[ends[:, 1]])
    halfway[np.searchsorted(keys, keys_of(edges, base))] = middles
    return np.concatenate([nodes, halfway]), np.hstack([hexes, base + which.reshape(-1, 12)]), ends


def keys_of(edges: Ints, base: int) -> Ints:
    """(..., 2) ends below base -> (...,) int64: one number for an edge in either direction."""
    return np.asarray(edges.min(axis=-1) * base + edges.max(axis=-1))
