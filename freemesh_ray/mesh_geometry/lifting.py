"""Bends of sides, carried into the elements beside and behind them: displacements that are harmonic, vertices fixed."""

from __future__ import annotations

import numpy as np

from envs.types import Floats, Ints
from freemesh_ray.mesh_geometry import lagrange


def lifted(
    nodes: Floats, elements: Ints, quads: Ints, patch: Ints, edge_of: Ints, free: np.ndarray, stations: Floats
) -> Floats:
    """(n, 2) float64: the nodes, those inside the patch's elements and of its free edges moved.

    How far a node lies off its place in the straight-sided element is a displacement. Over the patch each coordinate of
    it solves Laplace's equation, stated over the straight-sided elements: so it dies away over about the length of the
    side that is bent, and thin rows bend together.

    Args:
        nodes: (n, 2) float64.
        elements: (m, (k + 1)^2) int64, tensor-product order.
        quads: (m, 4) int64, their corners.
        patch: (p,) int64, elements.
        edge_of: (m, 4) int64, the edges of their sides.
        free: (e,) bool, edges whose nodes may move, of elements in the patch alone.
        stations: (k + 1,) of the nodes along a side, in [0, 1].
    """
    from scipy.sparse import coo_matrix  # half a second that straight meshes need not wait
    from scipy.sparse.linalg import spsolve

    k = len(stations) - 1
    mine = elements[patch]
    straight = straight_nodes(nodes[quads[patch]], stations)
    numbers, inverse = np.unique(mine, return_inverse=True)
    local: Ints = inverse.reshape(mine.shape)
    home = np.empty((len(numbers), 2))
    home[local] = straight
    moves = np.zeros((len(patch), k + 1, k + 1), dtype=bool)
    moves[:, 1:k, 1:k] = True
    on = free[edge_of[patch]]
    moves[:, 0, 1:k] |= on[:, 0, None]
    moves[:, 1:k, k] |= on[:, 1, None]
    moves[:, k, 1:k] |= on[:, 2, None]
    moves[:, 1:k, 0] |= on[:, 3, None]
    loose = np.zeros(len(numbers), dtype=bool)
    loose[local[moves.reshape(len(patch), -1)]] = True
    stiffness = stiffness_of(straight, stations)
    count = (k + 1) ** 2
    rows, columns = np.repeat(local, count, axis=1), np.tile(local, (1, count))
    whole = coo_matrix((stiffness.ravel(), (rows.ravel(), columns.ravel())), shape=(len(numbers), len(numbers))).tocsr()
    off = nodes[numbers] - home
    inner = whole[loose]
    solution = spsolve(inner[:, loose].tocsc(), -(inner[:, ~loose] @ off[~loose]))
    moved = nodes.copy()
    moved[numbers[loose]] = home[loose] + solution.reshape(-1, 2)
    return moved


def straight_nodes(corners: Floats, stations: Floats) -> Floats:
    """(p, (k + 1)^2, 2): the nodes of straight-sided elements, (p, 4, 2) corners of each."""
    x, y = (part.ravel()[:, None] for part in np.meshgrid(stations, stations))
    a, b, c, d = corners[:, None].transpose(2, 0, 1, 3)
    return (1 - y) * ((1 - x) * a + x * b) + y * ((1 - x) * d + x * c)


def stiffness_of(straight: Floats, stations: Floats) -> Floats:
    """(p, q, q): integrals of grad u . grad v over elements, (p, q, 2) nodes of each, q = (k + 1)^2."""
    points, weights = lagrange.gauss(len(stations))
    value, slope = lagrange.values(stations, points), lagrange.derivatives(stations, points)
    along = np.einsum("pi,qj->qpji", slope, value).reshape(len(points) ** 2, -1)
    across = np.einsum("pi,qj->qpji", value, slope).reshape(len(points) ** 2, -1)
    weight = np.outer(weights, weights).ravel()
    first = np.einsum("gn,pnc->pgc", along, straight)
    second = np.einsum("gn,pnc->pgc", across, straight)
    area = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    # Rows of the inverse Jacobian.
    x = (second[..., 1, None] * along - first[..., 1, None] * across) / area[..., None]
    y = (first[..., 0, None] * across - second[..., 0, None] * along) / area[..., None]
    scale = weight * area
    return np.einsum("pg,pgn,pgm->pnm", scale, x, x, optimize=True) + np.einsum(
        "pg,pgn,pgm->pnm", scale, y, y, optimize=True
    )
