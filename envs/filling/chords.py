r"""The best filling of a ring by chords: dynamic programming over the stretches of the ring.

A chord i - j (i < j) closes the stretch i, i + 1, .. j of the ring to a ring of its own. That is even when j - i is
odd; otherwise the chord gets one point m near its middle, at one of a few places::

        b . . . . .
       /           .      The block next to the chord has its other corners i < a < b < .. < j on the stretch. Its
      /             j     other sides are edges of the ring, or chords of shorter stretches:
     a             /
      \           m           cost of i .. j  =  cost of the block  +  costs of i .. a, a .. b, ..
       \         /
        \       /         A block of 4 vertices is an element; one of 6 is cut into two elements by a chord between
         . . . i          its vertices, or into three by spokes from a point inside.

Where all elements are strictly convex and counter-clockwise, the filling covers every point as often as the ring winds
around it: once inside, never outside. So nothing overlaps, and no chord has to be checked against the ring.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from envs.filling.fitness import DUBIOUS, cost_of
from envs.kernels.jit import compiled, inlined, inner
from envs.types import Floats, Ints

#: Places of a chord's point: beside the middle, by these shares of the chord's length.
ASIDE = (-0.2, -0.05, 0.0, 0.05, 0.2)
PLACES = 5

#: Ways of cutting a block of 6: a chord from vertex 0, 1 or 2, or spokes to the even or odd vertices.
CHORDS = 3
WAYS = 5


@compiled
def chord_point(xy: Floats, i: int, j: int, place: int) -> tuple[float, float]:
    """Where the point of chord i - j lies at a place in 0 .. PLACES - 1."""
    aside = ASIDE[place]
    dx, dy = xy[j, 0] - xy[i, 0], xy[j, 1] - xy[i, 1]
    return xy[i, 0] + 0.5 * dx - aside * dy, xy[i, 1] + 0.5 * dy + aside * dx


@inlined
def block_cost(block: Floats, size: int) -> tuple[float, int]:
    """The least cost of a block, and the way it is cut (0 for one of 4 vertices).

    Args:
        block: (7, 2) float64, the first ``size`` rows the vertices; the row after six receives the point inside.
        size: 4 or 6.
    """
    if size == 4:
        return cost_of(block, 0, 1, 2, 3), 0
    best, chosen = math.inf, 0
    for way in range(WAYS):
        if way < CHORDS:
            total = cost_of(block, way, way + 1, way + 2, way + 3)
            if total < best:
                total += cost_of(block, way + 3, (way + 4) % 6, (way + 5) % 6, way)
        else:
            inside(block)
            total, k = 0.0, way - CHORDS
            while k < 6 and total < best:
                total += cost_of(block, 6, k, (k + 1) % 6, (k + 2) % 6)
                k += 2
        if total < best:
            best, chosen = total, way
    return best, chosen


@compiled
def inside(block: Floats) -> None:
    """Put the mean of the six vertices of a block into its last row."""
    x = y = 0.0
    for k in range(6):
        x += block[k, 0] - block[0, 0]
        y += block[k, 1] - block[0, 1]
    block[6, 0], block[6, 1] = block[0, 0] + x / 6.0, block[0, 1] + y / 6.0


class Memory(NamedTuple):
    """Working memory of :func:`best_block`.

    Attributes:
        corner, place, size, option: (7,) int64, by depth: the corner, the place of the point on the side from it,
            the vertices so far, and what is to be tried next.
        partial: (7,) float64, costs of the stretches beyond the sides so far.
        block: (7, 2) float64, its vertices.
    """

    corner: Ints
    place: Ints
    size: Ints
    option: Ints
    partial: Floats
    block: Floats


@inner
def best_block(xy: Floats, cost: Floats, i: int, j: int, own: int, chosen: Ints, memory: Memory) -> float:
    """The least cost of filling the stretch i .. j with the chord's point at place ``own``.

    Args:
        xy: (n, 2) float64.
        cost: (n, n, PLACES) float64, known for all shorter stretches.
        i, j, own: the chord and its place, 0 for a chord without a point.
        chosen: (13,) int64, receives the block next to the chord: [corners, way, corner (6), place of the point on the
            side from each corner to the next (5)].
        memory: overwritten.
    """
    corner, place, size, option = memory.corner, memory.place, memory.size, memory.option
    partial, block = memory.partial, memory.block
    closing = 1 if (j - i) % 2 == 0 else 0
    best = math.inf
    corner[0], size[0], partial[0] = i, 1, 0.0
    block[0, 0], block[0, 1] = xy[i, 0], xy[i, 1]
    # Corners are chosen one after the other; option[depth] runs over the next corner and the place on the side to it.
    depth, option[1] = 1, PLACES * (i + 1)
    while depth > 0:
        a, b, s = corner[depth - 1], option[depth] // PLACES, option[depth] % PLACES
        if b > j:
            depth -= 1
            continue
        option[depth] += 1
        pointed = (b - a) % 2 == 0
        grown = size[depth - 1] + (2 if pointed else 1)
        vertices = grown + closing
        total = partial[depth - 1] + cost[a, b, s]
        if vertices > (6 if b == j else 5) or (depth == 1 and b == j) or total >= best:
            continue
        if pointed:
            block[grown - 2, 0], block[grown - 2, 1] = chord_point(xy, a, b, s)
        corner[depth], place[depth - 1] = b, s
        block[grown - 1, 0], block[grown - 1, 1] = xy[b, 0], xy[b, 1]
        if b < j:
            size[depth], partial[depth] = grown, total
            depth += 1
            option[depth] = PLACES * (b + 1)
            continue
        if closing:
            block[grown, 0], block[grown, 1] = chord_point(xy, i, j, own)
        added, way = block_cost(block, vertices)
        if total + added < best:
            best = total + added
            chosen[0], chosen[1] = depth + 1, way
            for k in range(depth + 1):
                chosen[2 + k] = corner[k]
            for k in range(depth):
                chosen[8 + k] = place[k]
    return best


def stretches(xy: Floats) -> tuple[Floats, Ints]:
    """Costs of all stretches of an (n, 2) ring, and the block next to each one's chord.

    Returns:
        cost: (n, n, PLACES) float64 by chord (i < j) and place, infinite where there is no filling; chords without
            a point have place 0 only.
        chosen: (n, n, PLACES, 13) int64; see :func:`best_block`.
    """
    n = len(xy)
    cost = np.full((n, n, PLACES), math.inf)
    chosen = np.zeros((n, n, PLACES, 13), dtype=np.int64)
    corner, place, size, option = (np.zeros(7, dtype=np.int64) for _ in range(4))
    memory = Memory(corner, place, size, option, partial=np.zeros(7), block=np.zeros((7, 2)))
    _stretches(xy, cost, chosen, memory)
    return cost, chosen


@compiled
def _stretches(xy: Floats, cost: Floats, chosen: Ints, memory: Memory) -> None:
    """Write the costs and the blocks."""
    n = len(xy)
    for i in range(n - 1):
        cost[i, i + 1, 0] = 0.0
    for span in range(2, n):
        for i in range(n - span):
            j = i + span
            for own in range(PLACES if span % 2 == 0 else 1):
                cost[i, j, own] = best_block(xy, cost, i, j, own, chosen[i, j, own], memory)


def by_chords(xy: Floats) -> tuple[Floats, Ints] | None:
    """Fill a ring with the least cost; 20 vertices take milliseconds, 36 some tens of them.

    Args:
        xy: (n, 2) float64, n even.

    Returns:
        (s, 2) float64 new points and (m, 4) int64 quadrilaterals, in which n + i is new point i; None where chords with
        at most one point have no filling that is worth it.
    """
    n = len(xy)
    cost, chosen = stretches(xy)
    if cost[0, n - 1, 0] > DUBIOUS**-4:
        return None
    points: list[tuple[float, float]] = []
    quads: list[tuple[int, int, int, int]] = []
    # Chords whose stretches are still to be filled, with the number of their point, -1 for none.
    waiting = [(0, n - 1, 0, -1)]
    while waiting:
        i, j, own, number = waiting.pop()
        corners, way, *row = chosen[i, j, own].tolist()
        ring = [i]
        for a, b, s in zip(row[: corners - 1], row[1:corners], row[6:], strict=False):
            point = -1
            if (b - a) % 2 == 0:
                point = n + len(points)
                points.append(chord_point(xy, a, b, s))
                ring.append(point)
            ring.append(b)
            if b - a > 1:
                waiting.append((a, b, s, point))
        if number >= 0:
            ring.append(number)
        if len(ring) == 4:
            quads.append((ring[0], ring[1], ring[2], ring[3]))
        elif way < CHORDS:
            turned = ring[way:] + ring[:way]
            quads += [(turned[0], turned[1], turned[2], turned[3]), (turned[3], turned[4], turned[5], turned[0])]
        else:
            turned = ring[way - CHORDS :] + ring[: way - CHORDS]
            block = np.array([xy[v] if v < n else points[v - n] for v in ring] + [(0.0, 0.0)])
            inside(block)
            centre = n + len(points)
            points.append((float(block[6, 0]), float(block[6, 1])))
            quads += [(centre, turned[k], turned[k + 1], turned[(k + 2) % 6]) for k in (0, 2, 4)]
    return np.array(points).reshape(-1, 2), np.array(quads, dtype=np.int64)
