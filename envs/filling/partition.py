r"""A long ring cut into short even ones along diagonals of its triangulation.

Between the ends of a diagonal i - j lie |i - j| edges of the ring. Where that is odd, both sides are even rings as they
are; elsewhere a point in the middle of the diagonal makes them even:

    o---o---o---j---o---o        o---o---o---j---o---o
    |          |        |        |          |        |
    |   4      |   4    |        |          m        |
    |          |        |        |          |        |
    o---o---o--i----o---o        o----o-----i----o---o
"""

from __future__ import annotations

import numpy as np

from envs.types import Floats, Ints

#: A piece is cut off as soon as it has this many triangles, where no new point is needed; later where one is.
EVEN_PIECE = 6
ODD_PIECE = 9


def partition(xy: Floats, triangles: Ints, across: Ints) -> tuple[Floats, list[Ints]]:
    """Cut a ring into pieces of about ten vertices.

    Args:
        xy: (n, 2) float64, n even.
        triangles: (n - 2, 3) int64 places in the ring.
        across: (n - 2, 3) int64 the triangle across each side.

    Returns:
        (n + s, 2) float64 points, the ring's first, and the pieces, each (k,) int64 indices into them, k even.
    """
    order, parent = dual_tree(across)
    weight = np.ones(len(triangles), dtype=np.int64)
    piece = np.full(len(triangles), -1, dtype=np.int64)
    # Diagonals that are cut, as directed edges of a triangle, with the point between them, -1 for none.
    cuts: dict[tuple[int, int], int] = {}
    middles: list[Floats] = []
    for t in reversed(order[1:]):
        even = weight[t] % 2 == 0
        k = across[t].tolist().index(parent[t])
        a, b = int(triangles[t, k]), int(triangles[t, (k + 1) % 3])
        if weight[t] >= (EVEN_PIECE if even else ODD_PIECE):
            middle = -1
            if not even:
                middle = len(xy) + len(middles)
                middles.append(xy[a] + 0.5 * (xy[b] - xy[a]))
                weight[parent[t]] += 1
            cuts[a, b] = cuts[b, a] = middle
        else:
            weight[parent[t]] += weight[t]
    ahead: list[dict[int, int]] = []
    for t in order:
        corners = triangles[t].tolist()
        for k in range(3):
            u, edge = across[t, k], (corners[k], corners[(k + 1) % 3])
            if u >= 0 and u == parent[t]:
                piece[t] = len(ahead) if edge in cuts else piece[u]
        if piece[t] < 0:
            piece[t] = 0
        if piece[t] == len(ahead):
            ahead.append({})
        for k in range(3):
            edge = (corners[k], corners[(k + 1) % 3])
            middle = cuts.get(edge, -1)
            if middle >= 0:
                ahead[piece[t]] |= {edge[0]: middle, middle: edge[1]}
            elif across[t, k] < 0 or edge in cuts:
                ahead[piece[t]][edge[0]] = edge[1]
    return np.concatenate([xy, np.array(middles).reshape(-1, 2)]), [walk(step) for step in ahead]


def walk(step: dict[int, int]) -> Ints:
    """The closed walk that takes each vertex to the next."""
    ring = [next(iter(step))]
    while (following := step[ring[-1]]) != ring[0]:
        ring.append(following)
    return np.array(ring, dtype=np.int64)


def dual_tree(across: Ints) -> tuple[list[int], Ints]:
    """Triangles in an order in which each comes after its parent, and each one's parent, -1 for the first."""
    order, parent = [0], np.full(len(across), -1, dtype=np.int64)
    for t in order:
        for u in across[t].tolist():
            if u >= 0 and u != parent[t]:
                parent[u] = t
                order.append(u)
    return order, parent
