"""Many vertices at once: L-BFGS on a smooth stand-in for the element quality.

eta is made of least and largest lengths and angles. Moving one vertex at a time gets stuck where two of them are equal;
moving all of them along a smooth function does not. The stand-in has the same form with the least and largest of four
numbers replaced by their means of order -P and P; the largest exceeds its stand-in by 4^(1/P) at most, which is 9 % for
P = 16, and 2 % for P = 64, the sharp stand-in:

    min(x)  ->  (mean x^-P)^(-1/P)         max(x)  ->  (mean x^P)^(1/P)

What is minimised is the sum over the elements of

    1 - eta + WEIGHT gap^2 + STEEP gap^4 + SIZED f^2 / (f + NEAR)      with gap = max(0, WEAK - eta)

where f = r + 1/r - 2, r is the element's area over h^2, and h the edge length wanted at its centroid when the descent
begins: little while edges are within a quarter of h, where f is NEAR, and as f beyond.
Vertices move in units of the mean length of their edges, so that fine and coarse parts of a mesh are alike.
Nocedal, Wright, Numerical Optimization, 2nd ed., algorithm 7.4; backtracking until the sum falls (Armijo).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from envs.kernels.jit import compiled_fused, inlined, inner, inner_fused
from envs.mdp.size_field import SizeField, size_at
from envs.types import Floats, Ints

#: An element counts as poor below this, and how much it does.
WEAK, WEIGHT, STEEP = 0.8, 4.0, 30.0
#: How much it counts that an element has not the size wanted; what f is that counts half; the least r told apart.
SIZED, NEAR, SMALLEST = 0.1, 0.2, 0.02
#: Steps remembered.
HISTORY = 5
#: Share of the predicted fall that a step must bring.
ARMIJO = 1e-4
#: The first step moves no vertex by more than this, in its own unit.
FIRST_STEP = 0.05
#: Halvings of a step, at most.
HALVINGS = 6

#: Elements that are worked out together, in vector registers.
LANES = 64
# Rows of the lanes: the corners' coordinates, each overwritten by the derivative by it; the cost; 1 / h^2.
_AX, _AY, _BX, _BY, _CX, _CY, _DX, _DY, _COST, _PER_AREA = range(10)

_QUARTER = 0.25 * math.pi


#: No edge length is wanted anywhere.
NO_SIZES = SizeField(np.full(2, np.inf), np.zeros((2, 4)), np.inf, 0.0)


class Descent(NamedTuple):
    """Working memory for up to n vertices.

    Attributes:
        raw: (n, 2) float64, the gradient by positions.
        unit: (n,) float64, the mean length of the edges at each vertex.
        vectors: (4, 2 n) float64, gradient, new gradient, direction and start.
        steps, changes: (HISTORY, 2 n) float64, differences of positions and of gradients.
        lanes: (10, LANES) float64.
        per_area: (2 n,) float64, 1 / h^2 of each element; 0 where no size is wanted.
        wanted: where h comes from.
        sides: (n,) int64, how many lengths ``unit`` is the mean of.
        history: (2, HISTORY) float64, curvature of each step, and its share of the direction.
    """

    raw: Floats
    unit: Floats
    vectors: Floats
    steps: Floats
    changes: Floats
    lanes: Floats
    per_area: Floats
    wanted: SizeField
    sides: Ints
    history: Floats


def descent(n: int, wanted: SizeField) -> Descent:
    """Room for n vertices, and twice as many elements."""
    return Descent(
        raw=np.empty((n, 2)),
        unit=np.empty(n),
        vectors=np.empty((4, 2 * n)),
        steps=np.empty((HISTORY, 2 * n)),
        changes=np.empty((HISTORY, 2 * n)),
        lanes=np.empty((10, LANES)),
        per_area=np.empty(2 * n),
        wanted=wanted,
        sides=np.empty(n, dtype=np.int64),
        history=np.empty((2, HISTORY)),
    )


@inlined
def power(x: float, sharp: bool) -> float:
    """x^P."""
    x *= x
    x *= x
    x *= x
    x *= x
    return (x * x) * (x * x) if sharp else x


@inlined
def root(x: float, sharp: bool) -> float:
    """x^(1/P)."""
    x = math.sqrt(math.sqrt(math.sqrt(math.sqrt(x))))
    return math.sqrt(math.sqrt(x)) if sharp else x


@inlined
def turn(ux: float, uy: float, vx: float, vy: float) -> float:
    """The angle from u to v, in [0, 2 pi).

    With the inverse tangent on [-1, 1] of Abramowitz, Stegun, Handbook of Mathematical Functions, 4.4.49 (2e-8).
    """
    cross, dot = ux * vy - uy * vx, ux * vx + uy * vy
    t = (abs(cross) - abs(dot)) / (abs(cross) + abs(dot))
    z = t * t
    series = -0.0752896400 + z * (0.0429096138 + z * (-0.0161657367 + z * 0.0028662257))
    series = -0.3333314528 + z * (0.1999355085 + z * (-0.1420889944 + z * (0.1065626393 + z * series)))
    acute = _QUARTER + t + t * z * series
    half = acute if dot >= 0.0 else 4.0 * _QUARTER - acute
    return half if cross >= 0.0 else 8.0 * _QUARTER - half


@inner_fused
def _work_out(lanes: Floats, n: int, sharp: bool) -> None:
    """Cost and derivatives of the elements in the first n lanes.

    The angle at a corner is the turn from the edge u ahead to the edge v behind; a direction's angle has the gradient
    (-u_y, u_x) / |u|^2. A few numbers are those of the logarithm: log eta = (log lengths) / 4 + (log angles) / 2.
    """
    for i in range(n):
        ax, ay, bx, by = lanes[_AX, i], lanes[_AY, i], lanes[_BX, i], lanes[_BY, i]
        cx, cy, dx, dy = lanes[_CX, i], lanes[_CY, i], lanes[_DX, i], lanes[_DY, i]
        abx, aby, bcx, bcy, cdx, cdy, dax, day = bx - ax, by - ay, cx - bx, cy - by, dx - cx, dy - cy, ax - dx, ay - dy
        ab2, bc2, cd2, da2 = abx * abx + aby * aby, bcx * bcx + bcy * bcy, cdx * cdx + cdy * cdy, dax * dax + day * day
        px, py, rx, ry = cx - ax, cy - ay, dx - bx, dy - by
        p2, r2 = px * px + py * py, rx * rx + ry * ry
        alpha, beta = turn(abx, aby, -dax, -day), turn(bcx, bcy, -abx, -aby)
        gamma, delta = turn(cdx, cdy, -bcx, -bcy), turn(dax, day, -cdx, -cdy)
        least2, longest2 = min(min(ab2, bc2), min(cd2, da2)), max(p2, r2)
        low, high = min(min(alpha, beta), min(gamma, delta)), max(max(alpha, beta), max(gamma, delta))
        # Inverses, and the terms of the means over the largest one.
        per_ab2, per_bc2, per_cd2, per_da2 = 1.0 / ab2, 1.0 / bc2, 1.0 / cd2, 1.0 / da2
        per_alpha, per_beta, per_gamma, per_delta = 1.0 / alpha, 1.0 / beta, 1.0 / gamma, 1.0 / delta
        per_high, per_longest2 = 1.0 / high, 1.0 / longest2
        ab, bc = power(least2 * per_ab2, sharp), power(least2 * per_bc2, sharp)
        cd, da = power(least2 * per_cd2, sharp), power(least2 * per_da2, sharp)
        low_a, low_b = power(low * per_alpha, sharp), power(low * per_beta, sharp)
        low_c, low_d = power(low * per_gamma, sharp), power(low * per_delta, sharp)
        high_a, high_b = power(alpha * per_high, sharp), power(beta * per_high, sharp)
        high_c, high_d = power(gamma * per_high, sharp), power(delta * per_high, sharp)
        p, r = power(p2 * per_longest2, sharp), power(r2 * per_longest2, sharp)
        lengths, diagonals = ab + bc + cd + da, p + r
        lows, highs = low_a + low_b + low_c + low_d, high_a + high_b + high_c + high_d
        soft = math.sqrt(0.125 * lengths * diagonals) * (0.0625 * lows * highs)
        eta = math.sqrt(math.sqrt(2.0 * least2 * per_longest2) * low * per_high / root(soft, sharp))
        gap = max(0.0, WEAK - eta)
        value = 1.0 - eta + gap * gap * (WEIGHT + STEEP * gap * gap)
        # The size: the area is half the product of the diagonals.
        per_area = lanes[_PER_AREA, i]
        over = max(SMALLEST, 0.5 * per_area * (px * ry - py * rx))
        sized = SIZED if per_area > 0.0 else 0.0
        off = over + 1.0 / over - 2.0
        near = 1.0 / (off + NEAR)
        value += sized * off * off * near
        push = sized * off * (off + 2.0 * NEAR) * near * near if over > SMALLEST else 0.0
        push *= 0.5 * per_area * (1.0 - 1.0 / (over * over))
        lanes[_COST, i] = value if least2 > 0.0 and low > 0.0 else math.inf
        slope = 0.5 * eta * (1.0 + gap * (2.0 * WEIGHT + 4.0 * STEEP * gap * gap))
        # The derivative by each squared length and angle, over twice its gradient's length.
        s = -slope / lengths
        ab, bc, cd, da = s * ab * per_ab2, s * bc * per_bc2, s * cd * per_cd2, s * da * per_da2
        s, t = -slope / lows, slope / highs
        turn_a, turn_b = (s * low_a + t * high_a) * per_alpha, (s * low_b + t * high_b) * per_beta
        turn_c, turn_d = (s * low_c + t * high_c) * per_gamma, (s * low_d + t * high_d) * per_delta
        s = slope / diagonals
        p, r = s * p / p2, s * r / r2
        # An edge turns the angle at its start back and the one at its end on.
        ab_turn, bc_turn = (turn_b - turn_a) * per_ab2, (turn_c - turn_b) * per_bc2
        cd_turn, da_turn = (turn_d - turn_c) * per_cd2, (turn_a - turn_d) * per_da2
        abx, aby = ab * abx - ab_turn * aby, ab * aby + ab_turn * abx
        bcx, bcy = bc * bcx - bc_turn * bcy, bc * bcy + bc_turn * bcx
        cdx, cdy = cd * cdx - cd_turn * cdy, cd * cdy + cd_turn * cdx
        dax, day = da * dax - da_turn * day, da * day + da_turn * dax
        px, py, rx, ry = p * px + push * ry, p * py - push * rx, r * rx - push * py, r * ry + push * px
        lanes[_AX, i], lanes[_AY, i] = dax - abx - px, day - aby - py
        lanes[_BX, i], lanes[_BY, i] = abx - bcx - rx, aby - bcy - ry
        lanes[_CX, i], lanes[_CY, i] = bcx - cdx + px, bcy - cdy + py
        lanes[_DX, i], lanes[_DY, i] = cdx - dax + rx, cdy - day + ry


@inner
def read_sizes(xy: Floats, quads: Ints, wanted: SizeField, per_area: Floats) -> None:
    """Overwrite ``per_area``, (m,) float64, with 1 / h^2 at the elements' centroids."""
    for q in range(len(quads)):
        x = y = 0.0
        for corner in range(4):
            x, y = x + 0.25 * xy[quads[q, corner], 0], y + 0.25 * xy[quads[q, corner], 1]
        h = size_at(wanted.key, wanted.box, wanted.most, wanted.gradient, x, y)
        per_area[q] = 1.0 / (h * h)


@inner
def cost_of(xy: Floats, quads: Ints, memory: Descent) -> float:
    """The sum that is minimised, of elements where they are; see `descend`."""
    read_sizes(xy, quads, memory.wanted, memory.per_area)
    return cost(xy, quads, memory.per_area[: len(quads)], False, memory.raw[: len(xy)], memory.lanes)


@inner
def cost(xy: Floats, quads: Ints, per_area: Floats, sharp: bool, gradient: Floats, lanes: Floats) -> float:
    """The sum that is minimised, and its gradient by every vertex.

    Args:
        xy: (n, 2) float64.
        quads: (m, 4) int64.
        per_area: (m,) float64, see `Descent`.
        sharp: whether P is 64 rather than 16.
        gradient: (n, 2) float64, overwritten.
        lanes: (10, LANES) float64, working memory.
    """
    gradient[:] = 0.0
    total = 0.0
    for start in range(0, len(quads), LANES):
        n = min(LANES, len(quads) - start)
        for i in range(n):
            for corner in range(4):
                v = quads[start + i, corner]
                lanes[2 * corner, i], lanes[2 * corner + 1, i] = xy[v, 0], xy[v, 1]
            lanes[_PER_AREA, i] = per_area[start + i]
        full = (n + 7) & ~7
        for i in range(n, full):
            for row in range(8):
                lanes[row, i] = lanes[row, n - 1]
            lanes[_PER_AREA, i] = 0.0
        _work_out(lanes, full, sharp)
        for i in range(n):
            total += lanes[_COST, i]
            for corner in range(4):
                v = quads[start + i, corner]
                gradient[v, 0] += lanes[2 * corner, i]
                gradient[v, 1] += lanes[2 * corner + 1, i]
    return total


@inlined
def dot(a: Floats, b: Floats) -> float:
    """The inner product of two vectors whose length is even."""
    even = odd = 0.0
    for i in range(0, len(a), 2):
        even += a[i] * b[i]
        odd += a[i + 1] * b[i + 1]
    return even + odd


@inlined
def add(a: Floats, share: float, b: Floats) -> None:
    """a += share b."""
    for i in range(len(a)):
        a[i] += share * b[i]


@inlined
def measure(xy: Floats, quads: Ints, unit: Floats, sides: Ints) -> None:
    """Overwrite ``unit``, (n,) float64, with the mean length of the elements' sides at each vertex."""
    unit[:], sides[:] = 0.0, 0
    for q in range(len(quads)):
        for i in range(4):
            a, b = quads[q, i], quads[q, (i + 1) & 3]
            length = math.sqrt((xy[b, 0] - xy[a, 0]) ** 2 + (xy[b, 1] - xy[a, 1]) ** 2)
            unit[a] += length
            unit[b] += length
            sides[a] += 2
            sides[b] += 2
    for v in range(len(unit)):
        unit[v] /= max(1, sides[v])


@inlined
def scaled(raw: Floats, unit: Floats, out: Floats) -> None:
    """The gradient by positions in units."""
    for v in range(len(out) >> 1):
        out[2 * v], out[2 * v + 1] = unit[v] * raw[v, 0], unit[v] * raw[v, 1]


@compiled_fused
def descend(
    xy: Floats, quads: Ints, free: int, sharp: bool, iterations: int, least_fall: float, memory: Descent
) -> float:
    """Move the first ``free`` vertices to where the cost is least; the cost, which never rises.

    Args:
        xy: (n, 2) float64, changed in place.
        quads: (m, 4) int64.
        free: how many vertices may move.
        sharp: whether the means are of order 64 rather than 16: closer to eta, and harder to descend.
        iterations: at most.
        least_fall: the descent ends when a step lowers the cost by less than this share.
        memory: with room for n vertices; where h comes from.
    """
    raw, unit = memory.raw[: len(xy)], memory.unit[: len(xy)]
    gradient, new_gradient = memory.vectors[0, : 2 * free], memory.vectors[1, : 2 * free]
    direction, start = memory.vectors[2, : 2 * free], memory.vectors[3, : 2 * free]
    curvature, share = memory.history[0], memory.history[1]
    known = newest = 0
    per_area = memory.per_area[: len(quads)]
    read_sizes(xy, quads, memory.wanted, per_area)
    value = cost(xy, quads, per_area, sharp, raw, memory.lanes)
    if free == 0 or value == math.inf:
        return value
    measure(xy, quads, unit, memory.sides[: len(xy)])
    scaled(raw, unit, gradient)
    for _ in range(iterations):
        for i in range(2 * free):
            direction[i] = gradient[i]
        for back in range(known):
            k = (newest - 1 - back) % HISTORY
            share[k] = dot(memory.steps[k, : 2 * free], direction) / curvature[k]
            add(direction, -share[k], memory.changes[k, : 2 * free])
        if known > 0:
            k = (newest - 1) % HISTORY
            scale = curvature[k] / dot(memory.changes[k, : 2 * free], memory.changes[k, : 2 * free])
        else:
            largest2 = 0.0
            for v in range(free):
                largest2 = max(largest2, gradient[2 * v] ** 2 + gradient[2 * v + 1] ** 2)
            if largest2 == 0.0:
                break
            scale = FIRST_STEP / math.sqrt(largest2)
        for i in range(2 * free):
            direction[i] *= scale
        for forth in range(known):
            k = (newest - known + forth) % HISTORY
            more = share[k] - dot(memory.changes[k, : 2 * free], direction) / curvature[k]
            add(direction, more, memory.steps[k, : 2 * free])
        fall = dot(gradient, direction)
        if fall <= 0.0:
            break
        for v in range(free):
            start[2 * v], start[2 * v + 1] = xy[v, 0], xy[v, 1]
        length, new_value = 1.0, math.inf
        for _ in range(HALVINGS):
            for v in range(free):
                xy[v, 0] = start[2 * v] - length * unit[v] * direction[2 * v]
                xy[v, 1] = start[2 * v + 1] - length * unit[v] * direction[2 * v + 1]
            new_value = cost(xy, quads, per_area, sharp, raw, memory.lanes)
            if new_value <= value - ARMIJO * length * fall:
                break
            length *= 0.5
        if not new_value < value:
            for v in range(free):
                xy[v, 0], xy[v, 1] = start[2 * v], start[2 * v + 1]
            break
        scaled(raw, unit, new_gradient)
        k = newest % HISTORY
        for i in range(2 * free):
            memory.steps[k, i] = -length * direction[i]
            memory.changes[k, i] = new_gradient[i] - gradient[i]
        curvature[k] = dot(memory.steps[k, : 2 * free], memory.changes[k, : 2 * free])
        if curvature[k] > 1e-12 * dot(memory.changes[k, : 2 * free], memory.changes[k, : 2 * free]):
            newest += 1
            known = min(known + 1, HISTORY)
        for i in range(2 * free):
            gradient[i] = new_gradient[i]
        settled = value - new_value < least_fall * value
        value = new_value
        if settled:
            break
    return value


def mean_cost(xy: Floats, quads: Ints, wanted: SizeField) -> float:
    """The mean of what is minimised over elements where they are; infinite where one is inverted."""
    return float(descend(xy, quads, 0, False, 0, 0.0, descent(len(xy), wanted))) / len(quads)
