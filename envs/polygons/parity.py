"""Even totals: a mesh of quadrilaterals needs an even number of boundary vertices, in every polygon.

One more vertex on a run flips the parity of the polygons that use it. Where a polygon has a boundary of its own that is
enough; where all of it is shared, the change is passed on from neighbour to neighbour until it reaches the outside or
another odd polygon.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence

from envs.types import Floats

#: What lies beyond a run that one polygon uses.
OUTSIDE = -1


def made_even(users: Sequence[Sequence[int]], costs: Floats, odd: Sequence[int]) -> set[int] | None:
    """Runs that get one more vertex each, so that every polygon is even.

    Args:
        users: for each run the polygons that use it, a polygon twice when it walks the run in both directions.
        costs: (runs,) positive, what one more vertex distorts.
        odd: the polygons with an odd total.

    Returns:
        Indices of runs, each polygon's cheapest way to the outside or to another odd one; None if there is no way.
    """
    beside: dict[int, list[tuple[int, int]]] = {}
    for run, polygons in enumerate(users):
        once = [p for p in polygons if polygons.count(p) % 2]
        if len(once) in (1, 2):
            a, b = once if len(once) == 2 else (once[0], OUTSIDE)
            beside.setdefault(a, []).append((run, b))
            beside.setdefault(b, []).append((run, a))
    chosen: set[int] = set()
    waiting = set(odd)
    while waiting:
        start = min(waiting)
        waiting.remove(start)
        way = cheapest_way(beside, costs, start, waiting | {OUTSIDE})
        if way is None:
            return None
        goal, runs = way
        waiting.discard(goal)
        # A run on two ways flips back.
        chosen ^= set(runs)
    return chosen


def cheapest_way(
    beside: dict[int, list[tuple[int, int]]], costs: Floats, start: int, goals: set[int]
) -> tuple[int, list[int]] | None:
    """The nearest goal and the runs to cross on the way to it (Dijkstra)."""
    came: dict[int, tuple[int, int]] = {}
    done: set[int] = set()
    queue: list[tuple[float, int, int, int]] = [(0.0, start, -1, start)]
    while queue:
        cost, polygon, run, before = heapq.heappop(queue)
        if polygon in done:
            continue
        done.add(polygon)
        came[polygon] = (run, before)
        if polygon in goals:
            runs, goal = [], polygon
            while polygon != start:
                run, polygon = came[polygon]
                runs.append(run)
            return goal, runs
        for run, other in beside.get(polygon, ()):
            if other not in done:
                heapq.heappush(queue, (cost + float(costs[run]), other, run, polygon))
    return None
