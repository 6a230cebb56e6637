"""All interior vertices at once: L-BFGS on a smooth stand-in for the element quality.

eta is made of least and largest lengths and angles. Moving one vertex at a time gets stuck where two of them are equal;
moving all of them along a smooth function does not. The stand-in has the same form with the least and largest of four
numbers replaced by their means of order -P and P (the largest exceeds its stand-in by at most 4^(1/P), 9 %):

    min(x)  ->  (mean x^-P)^(-1/P)         max(x)  ->  (mean x^P)^(1/P)

What is minimised is the sum over the elements of

    1 - eta + WEIGHT max(0, WEAK - eta)^2

Vertices move in units of the mean length of their edges, so that fine and coarse parts of a mesh are alike.
Nocedal, Wright, Numerical Optimization, 2nd ed., algorithm 7.4; backtracking until the sum falls (Armijo).
"""

from __future__ import annotations

import math

import numpy as np

from envs.kernels.compiled import compiled, inlined
from envs.types import Floats, Ints

#: Below this an element counts as poor, and how much.
WEAK, WEIGHT = 0.72, 8.0
#: Steps remembered.
HISTORY = 8
#: Share of the predicted fall that a step must bring.
ARMIJO = 1e-4
#: The search ends when a step lowers the sum by less than this share.
LEAST_FALL = 2e-5
#: The first step moves no vertex by more than this, in its own unit.
FIRST_STEP = 0.05
#: Halvings of a step, at most.
HALVINGS = 6


@inlined
def power_16(x: float) -> float:
    """x^16: the order of the means is P = 16."""
    x *= x
    x *= x
    x *= x
    return x * x


@inlined
def root_16(x: float) -> float:
    """x^(1/16), x > 0."""
    return math.sqrt(math.sqrt(math.sqrt(math.sqrt(x))))


@compiled
def cost(xy: Floats, quads: Ints, gradient: Floats) -> float:
    """The sum that is minimised, and its gradient by every vertex.

    With u = P_i+1 - P_i and v = P_i-1 - P_i, the angle at corner i is the turn from u to v; a direction's angle has the
    gradient (-u_y, u_x) / |u|^2.

    Args:
        xy: (n, 2) float64.
        quads: (m, 4) int64.
        gradient: (n, 2) float64, overwritten.
    """
    gradient[:] = 0.0
    total = 0.0
    ex, ey, length2 = np.empty(4), np.empty(4), np.empty(4)
    angle, by_length, by_angle = np.empty(4), np.empty(4), np.empty(4)
    for q in range(len(quads)):
        for i in range(4):
            a, b = quads[q, i], quads[q, (i + 1) & 3]
            ex[i], ey[i] = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
            length2[i] = ex[i] * ex[i] + ey[i] * ey[i]
        for i in range(4):
            j = (i + 3) & 3
            turn = math.atan2(ex[j] * ey[i] - ey[j] * ex[i], -(ex[j] * ex[i] + ey[j] * ey[i]))
            angle[i] = turn if turn > 0.0 else turn + 2.0 * math.pi
        least2 = min(min(length2[0], length2[1]), min(length2[2], length2[3]))
        low = min(min(angle[0], angle[1]), min(angle[2], angle[3]))
        high = max(max(angle[0], angle[1]), max(angle[2], angle[3]))
        if least2 <= 0.0 or low <= 0.0:
            return math.inf
        lengths = lows = highs = 0.0
        for i in range(4):
            by_length[i] = power_16(least2 / length2[i])
            lengths += by_length[i]
            lows += power_16(low / angle[i])
            highs += power_16(angle[i] / high)
        # d log of the soft least (largest) angle over d angle, both together.
        for i in range(4):
            by_length[i] /= lengths
            by_angle[i] = (power_16(low / angle[i]) / lows - power_16(angle[i] / high) / highs) / angle[i]
        a, b, c, d = quads[q, 0], quads[q, 1], quads[q, 2], quads[q, 3]
        px, py, rx, ry = xy[c, 0] - xy[a, 0], xy[c, 1] - xy[a, 1], xy[d, 0] - xy[b, 0], xy[d, 1] - xy[b, 1]
        p2, r2 = px * px + py * py, rx * rx + ry * ry
        longest2 = max(p2, r2)
        by_p, by_r = power_16(p2 / longest2), power_16(r2 / longest2)
        both = by_p + by_r
        soft_lengths = least2 / root_16(0.25 * lengths) / (longest2 * root_16(0.5 * both))
        soft_angles = low / root_16(0.25 * lows) / (high * root_16(0.25 * highs))
        eta = math.sqrt(math.sqrt(2.0 * soft_lengths) * soft_angles)
        gap = max(0.0, WEAK - eta)
        total += 1.0 - eta + WEIGHT * gap * gap
        # d cost / d log eta; log eta = (log lengths) / 4 + (log angles) / 2.
        slope = -eta * (1.0 + 2.0 * WEIGHT * gap)
        for i in range(4):
            j = (i + 3) & 3
            here, ahead, behind = quads[q, i], quads[q, (i + 1) & 3], quads[q, j]
            s = 0.5 * slope * by_length[i] / length2[i]
            gradient[ahead, 0] += s * ex[i]
            gradient[ahead, 1] += s * ey[i]
            gradient[here, 0] -= s * ex[i]
            gradient[here, 1] -= s * ey[i]
            s = 0.5 * slope * by_angle[i]
            ux, uy = -s * ey[i] / length2[i], s * ex[i] / length2[i]
            vx, vy = s * ey[j] / length2[j], -s * ex[j] / length2[j]
            gradient[ahead, 0] -= ux
            gradient[ahead, 1] -= uy
            gradient[behind, 0] += vx
            gradient[behind, 1] += vy
            gradient[here, 0] += ux - vx
            gradient[here, 1] += uy - vy
        s, t = -0.5 * slope * by_p / (both * p2), -0.5 * slope * by_r / (both * r2)
        gradient[c, 0] += s * px
        gradient[c, 1] += s * py
        gradient[a, 0] -= s * px
        gradient[a, 1] -= s * py
        gradient[d, 0] += t * rx
        gradient[d, 1] += t * ry
        gradient[b, 0] -= t * rx
        gradient[b, 1] -= t * ry
    return total


@compiled
def units(xy: Floats, quads: Ints, free: np.ndarray) -> Floats:
    """(n,) float64: the mean length of the edges at each free vertex, 0 at the others."""
    unit, count = np.zeros(len(xy)), np.zeros(len(xy))
    for q in range(len(quads)):
        for i in range(4):
            a, b = quads[q, i], quads[q, (i + 1) & 3]
            length = math.hypot(xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1])
            unit[a] += length
            unit[b] += length
            count[a] += 1.0
            count[b] += 1.0
    for v in range(len(xy)):
        unit[v] = unit[v] / count[v] if free[v] and count[v] > 0.0 else 0.0
    return unit


@inlined
def dot(a: Floats, b: Floats) -> float:
    """The inner product of two (n, 2) arrays."""
    total = 0.0
    for i in range(len(a)):
        total += a[i, 0] * b[i, 0] + a[i, 1] * b[i, 1]
    return total


@compiled
def descend(xy: Floats, quads: Ints, free: np.ndarray, iterations: int) -> int:
    """Move the free vertices to where the cost is least.

    Args:
        xy: (n, 2) float64, changed in place; the cost never rises.
        quads: (m, 4) int64.
        free: (n,) bool, vertices that may move.
        iterations: at most.

    Returns:
        How often the cost was worked out.
    """
    n = len(xy)
    unit = units(xy, quads, free)
    raw, gradient, new_gradient = np.empty((n, 2)), np.zeros((n, 2)), np.zeros((n, 2))
    direction, start = np.zeros((n, 2)), np.empty((n, 2))
    steps, changes = np.zeros((HISTORY, n, 2)), np.zeros((HISTORY, n, 2))
    curvature, share = np.zeros(HISTORY), np.zeros(HISTORY)
    known = newest = 0
    value = cost(xy, quads, raw)
    evaluations = 1
    for v in range(n):
        gradient[v, 0], gradient[v, 1] = unit[v] * raw[v, 0], unit[v] * raw[v, 1]
    for _ in range(iterations):
        direction[:] = gradient
        for back in range(known):
            k = (newest - 1 - back) % HISTORY
            share[k] = dot(steps[k], direction) / curvature[k]
            for v in range(n):
                direction[v, 0] -= share[k] * changes[k, v, 0]
                direction[v, 1] -= share[k] * changes[k, v, 1]
        if known > 0:
            k = (newest - 1) % HISTORY
            scale = curvature[k] / dot(changes[k], changes[k])
        else:
            largest = 0.0
            for v in range(n):
                largest = max(largest, math.hypot(gradient[v, 0], gradient[v, 1]))
            if largest == 0.0:
                break
            scale = FIRST_STEP / largest
        for v in range(n):
            direction[v, 0] *= scale
            direction[v, 1] *= scale
        for forth in range(known):
            k = (newest - known + forth) % HISTORY
            more = share[k] - dot(changes[k], direction) / curvature[k]
            for v in range(n):
                direction[v, 0] += more * steps[k, v, 0]
                direction[v, 1] += more * steps[k, v, 1]
        fall = dot(gradient, direction)
        if fall <= 0.0:
            break
        start[:] = xy
        length, new_value = 1.0, math.inf
        for _ in range(HALVINGS):
            for v in range(n):
                xy[v, 0] = start[v, 0] - length * unit[v] * direction[v, 0]
                xy[v, 1] = start[v, 1] - length * unit[v] * direction[v, 1]
            new_value = cost(xy, quads, raw)
            evaluations += 1
            if new_value <= value - ARMIJO * length * fall:
                break
            length *= 0.5
        if not new_value < value:
            xy[:] = start
            break
        k = newest % HISTORY
        for v in range(n):
            new_gradient[v, 0], new_gradient[v, 1] = unit[v] * raw[v, 0], unit[v] * raw[v, 1]
            for axis in range(2):
                steps[k, v, axis] = -length * direction[v, axis]
                changes[k, v, axis] = new_gradient[v, axis] - gradient[v, axis]
        curvature[k] = dot(steps[k], changes[k])
        if curvature[k] > 1e-12 * dot(changes[k], changes[k]):
            newest += 1
            known = min(known + 1, HISTORY)
        gradient[:] = new_gradient
        settled = value - new_value < LEAST_FALL * value
        value = new_value
        if settled:
            break
    return evaluations
