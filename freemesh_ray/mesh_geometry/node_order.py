"""The order in which others number the nodes of an element of (k + 1)^2 nodes.

Both begin with the corners, counter-clockwise, and go on with the nodes inside the sides, side by side.
"""

from __future__ import annotations

import numpy as np

from envs.types import Ints


def gmsh(order: int) -> Ints:
    """((k + 1)^2,) int64: places in tensor-product order of Gmsh's nodes.

    Every side is walked on round the element; the nodes inside are an element of order k - 2, numbered likewise.
    """
    grid = np.arange((order + 1) ** 2).reshape(order + 1, order + 1)
    rounds = []
    while len(grid) > 1:
        inner = slice(1, -1)
        sides = [grid[0, inner], grid[inner, -1], grid[-1, inner][::-1], grid[inner, 0][::-1]]
        rounds += [grid[[0, 0, -1, -1], [0, -1, -1, 0]], *sides]
        grid = grid[inner, inner]
    return np.concatenate([*rounds, grid.ravel()])


def vtk(order: int) -> Ints:
    """((k + 1)^2,) int64: places in tensor-product order of the nodes of VTK's Lagrange quadrilateral.

    Opposite sides are walked in the same direction; the nodes inside come row by row.
    """
    grid = np.arange((order + 1) ** 2).reshape(order + 1, order + 1)
    inner = slice(1, -1)
    sides = [grid[0, inner], grid[inner, -1], grid[-1, inner], grid[inner, 0]]
    return np.concatenate([grid[[0, 0, -1, -1], [0, -1, -1, 0]], *sides, grid[inner, inner].ravel()])
