"""A guarded smoother: every interior vertex goes where the elements around it are best.

A vertex moves only when the merit of its elements rises and the poorest of them does not become poorer than it was (or
than ``FLOOR``, when it was better). So the least element quality never falls, elements stay strictly convex, and a
boundary vertex never moves at all. The merit of an element counts poor quality more than twice:

    merit(eta) = eta - STRICT max(0, WEAK - eta)

Around an interior vertex v with neighbours r_i and far corners o_i, element i is v, r_i, o_i, r_i+1. Only v moves, so
the angle at o_i, the edges at o_i and the diagonal r_i r_i+1 are worked out once for many places of v:

        o_1---r_1---o_0
         |     |     |
        r_2----v----r_0
         |     |     |
        o_2---r_3---o_3
"""

from __future__ import annotations

import math

import numpy as np

from envs.kernels.compiled import compiled, inlined
from envs.types import Floats, Ints
from freemesh_ray.finish.halfedges import MOST, Halfedges, after, around, origin

#: Below this an element counts as poor.
WEAK = 0.65
#: How much more poor quality counts.
STRICT = 1.0
#: The poorest element around a vertex may become poorer only as long as it is better than this.
FLOOR = 0.5
#: First and last step of the search around a vertex, over the mean length of its edges.
STEP, LAST_STEP = 0.2, 0.003

HALF_SQRT_3 = 0.5 * math.sqrt(3.0)

# Rows of a star: neighbour, far corner, and what does not change while v moves.
_RX, _RY, _OX, _OY, _CROSS, _SLOPE, _OR2, _NEXT_OR2, _DIAGONAL2 = range(9)
_ROWS = 9


@inlined
def merit(eta: float) -> float:
    """What the search maximises, for one element."""
    return eta if eta >= WEAK else eta - STRICT * (WEAK - eta)


@inlined
def gather(mesh: Halfedges, vertex: int, star: Floats) -> int:
    """Fill the star of an interior vertex; how many elements it has."""
    xy = mesh.xy
    h = mesh.out[vertex]
    k = mesh.degree[vertex]
    for i in range(k):
        r, o = origin(mesh, after(h)), origin(mesh, after(after(h)))
        star[_RX, i], star[_RY, i], star[_OX, i], star[_OY, i] = xy[r, 0], xy[r, 1], xy[o, 0], xy[o, 1]
        h = around(mesh, h)
    star[_RX, k], star[_RY, k] = star[_RX, 0], star[_RY, 0]
    for i in range(k):
        bx, by, dx, dy = star[_RX, i], star[_RY, i], star[_RX, i + 1], star[_RY, i + 1]
        ux, uy, wx, wy = bx - star[_OX, i], by - star[_OY, i], dx - star[_OX, i], dy - star[_OY, i]
        cross, dot = wx * uy - wy * ux, wx * ux + wy * uy
        star[_OR2, i], star[_NEXT_OR2, i] = ux * ux + uy * uy, wx * wx + wy * wy
        star[_CROSS, i], star[_SLOPE, i] = cross, dot / (abs(dot) + abs(cross))
        star[_DIAGONAL2, i] = (dx - bx) ** 2 + (dy - by) ** 2
    return k


@inlined
def rate(star: Floats, k: int, x: float, y: float) -> tuple[float, float]:
    """Merit of the star's elements, added up, and the least eta, with the vertex at (x, y).

    A bent element counts as -1 and less, the more bent the less, so that the search finds the way out.
    """
    total, least = 0.0, 1.0
    bx, by = star[_RX, 0] - x, star[_RY, 0] - y
    b2 = bx * bx + by * by
    for i in range(k):
        dx, dy = star[_RX, i + 1] - x, star[_RY, i + 1] - y
        d2 = dx * dx + dy * dy
        cx, cy = star[_OX, i] - x, star[_OY, i] - y
        bcx, bcy, cdx, cdy = cx - bx, cy - by, dx - cx, dy - cy
        cross_a, cross_b, cross_d = bx * dy - by * dx, bx * bcy - by * bcx, cdy * dx - cdx * dy
        longest2 = max(cx * cx + cy * cy, star[_DIAGONAL2, i])
        most_bent = min(min(cross_a, cross_b), min(star[_CROSS, i], cross_d))
        if most_bent <= 0.0:
            eta = -1.0 + most_bent / longest2
        else:
            dot_a, dot_b, dot_d = bx * dx + by * dy, -(bx * bcx + by * bcy), cdx * dx + cdy * dy
            slope_a = dot_a / (abs(dot_a) + cross_a)
            slope_b = dot_b / (abs(dot_b) + cross_b)
            slope_d = dot_d / (abs(dot_d) + cross_d)
            high = max(max(slope_a, slope_b), max(star[_SLOPE, i], slope_d))
            low = min(min(slope_a, slope_b), min(star[_SLOPE, i], slope_d))
            q_angle = math.atan2(1.0 - abs(high), high) / math.atan2(1.0 - abs(low), low)
            shortest2 = min(min(b2, d2), min(star[_OR2, i], star[_NEXT_OR2, i]))
            eta = math.sqrt(math.sqrt(2.0 * shortest2 / longest2) * q_angle)
        total += merit(eta)
        least = min(least, eta)
        bx, by, b2 = dx, dy, d2
    return total, least


@inlined
def middles(star: Floats, k: int) -> tuple[float, float, float, float]:
    """Two places worth trying: the mean of the neighbours, and the mean of the parallelograms' fourth corners."""
    x = y = ox = oy = 0.0
    for i in range(k):
        x, y, ox, oy = x + star[_RX, i], y + star[_RY, i], ox + star[_OX, i], oy + star[_OY, i]
    return x / k, y / k, (2.0 * x - ox) / k, (2.0 * y - oy) / k


@compiled
def smooth(mesh: Halfedges, chosen: Ints, count: int, sweeps: int, roughly: bool, step: Floats, star: Floats) -> None:
    """Move the interior vertices ``chosen[:count]``, each in turn, up to ``sweeps`` times.

    A compass search: six directions, turned a little in every sweep; the step is halved where none is better, and a
    vertex rests when its step is small, until a neighbour moves.

    Args:
        mesh: positions change.
        chosen: (n,) int64, interior vertices.
        count: how many of them.
        sweeps: at most.
        roughly: try only the two places in the middle of the star, in every sweep; otherwise in the first two.
        step: (V,) float64, working memory; the step of each vertex, 0 where it rests or may not move.
        star: (9, most elements around a vertex + 1) float64, working memory.
    """
    xy = mesh.xy
    for i in range(count):
        step[chosen[i]] = STEP
    for sweep in range(sweeps):
        awake = 0
        ux, uy = math.cos(0.7 * sweep), math.sin(0.7 * sweep)
        for i in range(count):
            vertex = chosen[i]
            if step[vertex] < LAST_STEP:
                continue
            awake += 1
            k = gather(mesh, vertex, star)
            x, y = xy[vertex, 0], xy[vertex, 1]
            best, least = rate(star, k, x, y)
            guard = min(least, FLOOR)
            length = 0.0
            for j in range(k):
                length += math.hypot(star[_RX, j] - x, star[_RY, j] - y)
            length /= k
            found_x, found_y, found = x, y, best
            if roughly or sweep < 2:
                ax, ay, bx, by = middles(star, k)
                value, worst = rate(star, k, ax, ay)
                if value > found and worst >= guard:
                    found_x, found_y, found = ax, ay, value
                value, worst = rate(star, k, bx, by)
                if value > found and worst >= guard:
                    found_x, found_y, found = bx, by, value
            reach = step[vertex] * length
            dx, dy = reach * ux, reach * uy
            stuck = True
            for _ in range(0 if roughly else 6):
                value, worst = rate(star, k, found_x + dx, found_y + dy)
                if value > found + 1e-7 and worst >= guard:
                    found_x, found_y, found = found_x + dx, found_y + dy, value
                    stuck = False
                dx, dy = 0.5 * dx - HALF_SQRT_3 * dy, HALF_SQRT_3 * dx + 0.5 * dy
            if stuck:
                step[vertex] *= 0.5
            if found > best:
                xy[vertex, 0], xy[vertex, 1] = found_x, found_y
                wake(mesh, vertex, step, math.hypot(found_x - x, found_y - y) / length)
        if awake == 0:
            break
    for i in range(count):
        step[chosen[i]] = 0.0


@inlined
def wake(mesh: Halfedges, vertex: int, step: Floats, moved: float) -> None:
    """Let the vertices around one that moved search again, if it moved by much; ``moved`` over the mean length."""
    if moved < 2.0 * LAST_STEP:
        return
    h = mesh.out[vertex]
    for _ in range(mesh.degree[vertex]):
        for neighbour in (origin(mesh, after(h)), origin(mesh, after(after(h)))):
            if 0.0 < step[neighbour] < LAST_STEP:
                step[neighbour] = 2.0 * LAST_STEP
        h = around(mesh, h)


def workspace(mesh: Halfedges) -> tuple[Floats, Floats]:
    """The working memory of ``smooth``: step and star."""
    most = max(MOST, int(mesh.degree.max()))  # what is given may have more than the clean-up makes
    return np.zeros(len(mesh.xy)), np.zeros((_ROWS, most + 1))
