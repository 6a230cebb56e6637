"""The first places of a filling's vertices: each in the middle of its neighbours (harmonic, uniform weights).

The equations are solved by conjugate gradients from where the filling put its vertices.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from envs.kernels.jit import inner_fused
from envs.types import Floats
from freemesh_ray.finish.refill.ring_filling import QUADS, VERTICES, Filling

#: The residual's energy at the end, over that at the start.
PRECISION = 1e-4


class Placement(NamedTuple):
    """Working memory for N vertices.

    Attributes:
        sides: (N,) float64, sides of elements at each vertex.
        residual, direction, product: (N, 2) float64.
    """

    sides: Floats
    residual: Floats
    direction: Floats
    product: Floats


def placement_of(filling: Filling) -> Placement:
    """Room for any filling."""
    n = len(filling.xy)
    return Placement(np.zeros(n), np.zeros((n, 2)), np.zeros((n, 2)), np.zeros((n, 2)))


@inner_fused
def _multiply(filling: Filling, sides: Floats, given: int, of: Floats, product: Floats) -> None:
    """The Laplacian of positions or directions ``of``, those of given vertices included where they are not zero."""
    quads = filling.quads
    for v in range(given, filling.counts[VERTICES]):
        product[v, 0], product[v, 1] = sides[v] * of[v, 0], sides[v] * of[v, 1]
    for q in range(filling.counts[QUADS]):
        a, b, c, d = quads[q, 0], quads[q, 1], quads[q, 2], quads[q, 3]
        x1, y1, x2, y2 = of[b, 0] + of[d, 0], of[b, 1] + of[d, 1], of[a, 0] + of[c, 0], of[a, 1] + of[c, 1]
        if a >= given:
            product[a, 0], product[a, 1] = product[a, 0] - x1, product[a, 1] - y1
        if c >= given:
            product[c, 0], product[c, 1] = product[c, 0] - x1, product[c, 1] - y1
        if b >= given:
            product[b, 0], product[b, 1] = product[b, 0] - x2, product[b, 1] - y2
        if d >= given:
            product[d, 0], product[d, 1] = product[d, 0] - x2, product[d, 1] - y2


@inner_fused
def place(filling: Filling, placement: Placement, given: int, steps: int) -> int:
    """Move all vertices but the first ``given``, in so many steps at most; how many it took."""
    n, xy, sides = filling.counts[VERTICES], filling.xy, placement.sides
    residual, direction, product = placement.residual, placement.direction, placement.product
    for v in range(n):
        sides[v] = 0.0
    for q in range(filling.counts[QUADS]):
        for corner in range(4):
            sides[filling.quads[q, corner]] += 2.0
    for v in range(given):
        direction[v, 0] = direction[v, 1] = 0.0
    _multiply(filling, sides, given, xy, product)
    energy = 0.0
    for v in range(given, n):
        for axis in range(2):
            residual[v, axis] = -product[v, axis]
            direction[v, axis] = residual[v, axis] / sides[v]
            energy += residual[v, axis] * direction[v, axis]
    enough = PRECISION * energy
    for step in range(steps):
        if energy <= enough:
            return step
        _multiply(filling, sides, given, direction, product)
        curvature = 0.0
        for v in range(given, n):
            curvature += direction[v, 0] * product[v, 0] + direction[v, 1] * product[v, 1]
        if curvature <= 0.0:
            return step
        share, following = energy / curvature, 0.0
        for v in range(given, n):
            for axis in range(2):
                xy[v, axis] += share * direction[v, axis]
                residual[v, axis] -= share * product[v, axis]
                following += residual[v, axis] * residual[v, axis] / sides[v]
        turn, energy = following / energy, following
        for v in range(given, n):
            for axis in range(2):
                direction[v, axis] = residual[v, axis] / sides[v] + turn * direction[v, axis]
    return steps
