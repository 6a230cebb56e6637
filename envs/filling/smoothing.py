"""Moves the new points of a filling to where their elements are best."""

from __future__ import annotations

import math

import numpy as np

from envs.filling.fitness import cost_of
from envs.kernels.jit import compiled, inlined
from envs.types import Floats, Ints

#: Directions in which a point looks for a better place, and its first step as a share of its shortest edge.
DIRECTIONS = 8
FIRST_STEP = 0.25
#: A point whose step fell below this share of its first one rests; so do all after this many rounds.
LEAST_STEP = 1e-3
ROUNDS = 60


@inlined
def star_cost(points: Floats, quads: Ints, star: Ints) -> float:
    """Cost of the quadrilaterals named in ``star``."""
    total = 0.0
    for q in star:
        total += cost_of(points, quads[q, 0], quads[q, 1], quads[q, 2], quads[q, 3])
    return total


def smooth(points: Floats, quads: Ints, first: int, start: Ints, stars: Ints) -> None:
    """Move the points from ``first`` on, in place, downhill in the cost of the elements around each of them.

    A pattern search: each point tries a few directions, takes the best of what is better than
    where it is, and halves its step when nothing is. An element that is strictly convex stays so.

    Args:
        points: (p, 2) float64.
        quads: (m, 4) int64, all strictly convex.
        first: the points before it stay.
        start, stars: the quadrilaterals around point v are ``stars[start[v] : start[v + 1]]``.
    """
    _smooth(points, quads, first, start, stars, np.zeros(len(points)), np.zeros(len(points)))


@compiled
def _smooth(points: Floats, quads: Ints, first: int, start: Ints, stars: Ints, step: Floats, least: Floats) -> None:
    """Smooth, with (p,) float64 memory for the points' steps and the least ones that count."""
    for v in range(first, len(points)):
        step[v] = math.inf
        for q in stars[start[v] : start[v + 1]]:
            for k in range(4):
                if quads[q, k] == v:
                    for w in (quads[q, (k + 1) % 4], quads[q, (k + 3) % 4]):
                        step[v] = min(step[v], math.hypot(points[w, 0] - points[v, 0], points[w, 1] - points[v, 1]))
        step[v] *= FIRST_STEP
        least[v] = LEAST_STEP * step[v]
    for turn in range(ROUNDS):
        resting = True
        for v in range(first, len(points)):
            if step[v] <= least[v]:
                continue
            resting = False
            star = stars[start[v] : start[v + 1]]
            x, y = points[v, 0], points[v, 1]
            best, best_x, best_y = star_cost(points, quads, star), x, y
            before = best
            for k in range(DIRECTIONS):
                angle = 2.0 * math.pi * (k + 0.5 * (turn % 2)) / DIRECTIONS
                points[v, 0], points[v, 1] = x + step[v] * math.cos(angle), y + step[v] * math.sin(angle)
                cost = star_cost(points, quads, star)
                if cost < best:
                    best, best_x, best_y = cost, points[v, 0], points[v, 1]
            points[v, 0], points[v, 1] = best_x, best_y
            step[v] *= 1.5 if best < 0.99 * before else 0.5
        if resting:
            return


def stars_of(quads: Ints, count: int) -> tuple[Ints, Ints]:
    """The quadrilaterals around each of ``count`` points, as ``start`` (count + 1,) and ``stars`` of :func:`smooth`."""
    order = np.argsort(quads.ravel(), kind="stable")
    start = np.searchsorted(quads.ravel()[order], np.arange(count + 1))
    return start.astype(np.int64), (order // 4).astype(np.int64)
