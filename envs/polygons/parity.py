"""Even totals: a mesh of quadrilaterals needs an even number of boundary vertices, in every polygon.

One more vertex on a chain flips the parity of the polygons that use it. Where a polygon has a boundary of its own that
is enough; where all of it is shared, the change is passed on from neighbour to neighbour until it reaches the outside
or another odd polygon.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence

import numpy as np

from envs.polygons.rings import FIX_PARITY
from envs.types import DomainError, Floats

#: What lies beyond a chain that one polygon uses.
OUTSIDE = -1


def made_even(users: Sequence[Sequence[int]], costs: Floats, odd: Sequence[int]) -> set[int] | None:
    """Runs that get one more vertex each, so that every polygon is even.

    Args:
        users: for each chain the polygons that use it, a polygon twice when it walks the chain in both directions.
        costs: (chains,) positive, what one more vertex distorts.
        odd: the polygons with an odd total.

    Returns:
        Indices of chains, each polygon's cheapest way to the outside or to another odd one; None if there is no way.
    """
    beside: dict[int, list[tuple[int, int]]] = {}
    for chain, polygons in enumerate(users):
        once = [p for p in polygons if polygons.count(p) % 2]
        if len(once) in (1, 2):
            a, b = once if len(once) == 2 else (once[0], OUTSIDE)
            beside.setdefault(a, []).append((chain, b))
            beside.setdefault(b, []).append((chain, a))
    chosen: set[int] = set()
    waiting = set(odd)
    while waiting:
        start = min(waiting)
        waiting.remove(start)
        way = cheapest_way(beside, costs, start, waiting | {OUTSIDE})
        if way is None:
            return None
        goal, chains = way
        waiting.discard(goal)
        # A chain on two ways flips back.
        chosen ^= set(chains)
    return chosen


def cheapest_way(
    beside: dict[int, list[tuple[int, int]]], costs: Floats, start: int, goals: set[int]
) -> tuple[int, list[int]] | None:
    """The nearest goal and the chains to cross on the way to it (Dijkstra)."""
    came: dict[int, tuple[int, int]] = {}
    done: set[int] = set()
    queue: list[tuple[float, int, int, int]] = [(0.0, start, -1, start)]
    while queue:
        cost, polygon, chain, before = heapq.heappop(queue)
        if polygon in done:
            continue
        done.add(polygon)
        came[polygon] = (chain, before)
        if polygon in goals:
            chains, goal = [], polygon
            while polygon != start:
                chain, polygon = came[polygon]
                chains.append(chain)
            return goal, chains
        for chain, other in beside.get(polygon, ()):
            if other not in done:
                heapq.heappush(queue, (cost + float(costs[chain]), other, chain, polygon))
    return None


def with_even_count(rings: list[Floats], source: str, fix_parity: bool) -> list[Floats]:
    """The rings, with an even total of vertices.

    Args:
        rings: each (n, 2).
        source: the name that messages begin with.
        fix_parity: split the longest segment at its midpoint when the total is odd.

    Raises:
        DomainError: an odd total without ``fix_parity``.
    """
    total = sum(len(ring) for ring in rings)
    if total % 2 == 0:
        return rings
    if not fix_parity:
        raise DomainError(odd_message(source, total))
    lengths = [np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1) for ring in rings]
    r = int(np.argmax([length.max() for length in lengths]))
    i = int(np.argmax(lengths[r]))
    middle = 0.5 * (rings[r][i] + rings[r][(i + 1) % len(rings[r])])
    return [*rings[:r], np.insert(rings[r], i + 1, middle, axis=0), *rings[r + 1 :]]


def odd_message(source: str, total: int) -> str:
    """The line that explains an odd ring and offers the fix."""
    return (
        f"{source}: {total} boundary vertices in all, an odd number, so no mesh of quadrilaterals alone exists; "
        f"use {FIX_PARITY}, which splits the longest segment, or add or remove one vertex"
    )
