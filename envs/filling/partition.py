r"""A long ring cut into shorter even ones along diagonals of its triangulation.

Where an odd number of the ring's edges lies on each side of a diagonal, both sides are even rings as they are;
elsewhere a point in the middle of the diagonal makes them even::

    o---o---o---o---o---o        o---o---o---o---o---o
    |       |           |        |        \          |
    |   6   |     8     |        |    8    m    8    |
    |       |           |        |          \        |
    o---o---o---o---o---o        o---o---o---o---o---o
"""

from __future__ import annotations

import numpy as np

from envs.types import Floats, Ints

#: A piece is cut off as soon as it has this many triangles where no new point is needed, and later where one is.
EVEN_PIECE = 12
ODD_PIECE = 16


def partition(xy: Floats, triangles: Ints, across: Ints) -> tuple[Floats, list[Ints]]:
    """Cut a ring into pieces of about 14 to 36 vertices.

    Args:
        xy: (n, 2) float64, n even.
        triangles: (n - 2, 3) int64 places in the ring, counter-clockwise.
        across: (n - 2, 3) int64 the triangle across the side from corner k to corner k + 1, -1 for none.

    Returns:
        (n + s, 2) float64 points, the ring's first, s <= n / 15, and the pieces, each (k,) int64 indices into the
        points, k even, counter-clockwise.
    """
    order, parent = dual_tree(across)
    cuts: dict[tuple[int, int], int | None] = {}
    middles: list[Floats] = []
    weight = np.ones(len(triangles), dtype=np.int64)
    for t in reversed(order[1:]):
        above, even = parent[t], weight[t] % 2 == 0
        if weight[t] < (EVEN_PIECE if even else ODD_PIECE):
            weight[above] += weight[t]
            continue
        a, b = np.roll(triangles[t], -across[t].tolist().index(above))[:2].tolist()
        cuts[a, b] = cuts[b, a] = None if even else len(xy) + len(middles)
        if not even:
            middles.append(xy[a] + 0.5 * (xy[b] - xy[a]))
            weight[above] += 1
    return np.concatenate([xy, np.reshape(middles, (-1, 2))]), pieces(triangles, across, order, parent, cuts)


def pieces(
    triangles: Ints, across: Ints, order: list[int], parent: list[int], cuts: dict[tuple[int, int], int | None]
) -> list[Ints]:
    """The rings around the pieces of the tree between cuts, given by their directed edges and the points on them."""
    piece: dict[int, int] = {}
    ahead: list[dict[int, int]] = []
    for t in order:
        corners = triangles[t].tolist()
        edges = list(zip(corners, corners[1:] + corners[:1], across[t].tolist(), strict=True))
        if parent[t] < 0 or any(u == parent[t] and (a, b) in cuts for a, b, u in edges):
            piece[t] = len(ahead)
            ahead.append({})
        else:
            piece[t] = piece[parent[t]]
        step = ahead[piece[t]]
        for a, b, u in edges:
            if u < 0 or (a, b) in cuts:
                middle = cuts.get((a, b))
                step[a] = b if middle is None else middle
                if middle is not None:
                    step[middle] = b
    return [walk(step) for step in ahead]


def walk(step: dict[int, int]) -> Ints:
    """The closed walk that takes each vertex to the next; (k,) int64."""
    ring = [next(iter(step))]
    while (following := step[ring[-1]]) != ring[0]:
        ring.append(following)
    return np.array(ring, dtype=np.int64)


def dual_tree(across: Ints) -> tuple[list[int], list[int]]:
    """Triangles in an order in which each comes after its parent, and each one's parent, -1 for the first."""
    order, parent = [0], [-1] * len(across)
    # The list grows while it is walked.
    for t in order:
        for u in across[t].tolist():
            if u >= 0 and u != parent[t]:
                parent[u] = t
                order.append(u)
    return order, parent
