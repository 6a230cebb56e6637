"""What fillings are compared by: element quality that vanishes at the edge of strict convexity."""

from __future__ import annotations

import math

import numpy as np

from envs.kernels.jit import compiled, inlined, inner
from envs.kernels.orientation import turns_left
from envs.quality import eta_from_angles, inner_angles
from envs.types import Floats, Ints

#: Widest inner angle that costs nothing, in radians. eta itself says nothing about angles that come close to pi.
WIDEST_FREE = 0.9 * np.pi
#: What a strictly convex element is worth at least.
LEAST = 1e-12
#: Elements worth less may owe their strict convexity to rounding; they are taken where there is nothing better.
DUBIOUS = 1e-6


@inlined
def fitness(ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float) -> float:
    """eta_e in (0, 1] of a quadrilateral, less where an angle comes close to pi; 0 unless certainly strictly convex.

    Four left turns, each below pi, are one turn around: the quadrilateral is then simple and counter-clockwise.
    """
    if not (
        turns_left(ax, ay, bx, by, cx, cy)
        and turns_left(bx, by, cx, cy, dx, dy)
        and turns_left(cx, cy, dx, dy, ax, ay)
        and turns_left(dx, dy, ax, ay, bx, by)
    ):
        return 0.0
    alpha, beta, gamma, delta = inner_angles(ax, ay, bx, by, cx, cy, dx, dy)
    eta = eta_from_angles(ax, ay, bx, by, cx, cy, dx, dy, alpha, beta, gamma, delta)
    left = (math.pi - max(max(alpha, beta), max(gamma, delta))) / (math.pi - WIDEST_FREE)
    return max(LEAST, eta * min(1.0, left))


@inlined
def fitness_of(points: Floats, a: int, b: int, c: int, d: int) -> float:
    """:func:`fitness` of the quadrilateral of four of the points."""
    return fitness(
        points[a, 0], points[a, 1], points[b, 0], points[b, 1],
        points[c, 0], points[c, 1], points[d, 0], points[d, 1],
    )  # fmt: skip


@inner
def cost_of(points: Floats, a: int, b: int, c: int, d: int) -> float:
    """What a quadrilateral adds to a filling's cost: fitness^-4, >= 1; infinite unless certainly strictly convex.

    The sum over a filling is governed by its worst elements, and where these are given, by the next ones.
    """
    value = fitness_of(points, a, b, c, d)
    return 1.0 / (value * value * value * value) if value > 0.0 else math.inf


@compiled
def _fitnesses(points: Floats, quads: Ints, out: Floats) -> None:
    for i in range(len(quads)):
        out[i] = fitness_of(points, quads[i, 0], quads[i, 1], quads[i, 2], quads[i, 3])


def fitnesses(points: Floats, quads: Ints) -> Floats:
    """(m,) float64 in [0, 1]: the fitness of each of (m, 4) int64 quadrilaterals; 0 for what is not strictly convex."""
    out = np.empty(len(quads))
    _fitnesses(points, quads, out)
    return out
