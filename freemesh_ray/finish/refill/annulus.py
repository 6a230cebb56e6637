"""A patch around a hole of the domain is filled by rows, where the loops at its ends are or become equally long.

    rows outside, until the loop is as long as the hole's: each corner makes it two shorter at every row
    -> rows around the hole -> one more between the two

Places around the hole are counted counter-clockwise, from its first vertex on.
"""

from __future__ import annotations

import math

from envs.kernels.jit import inlined, inner
from freemesh_ray.finish.halfedges import Halfedges
from freemesh_ray.finish.refill.growth import LOOP, OUTER, SIZE, WORK, Growth
from freemesh_ray.finish.refill.options import RINGS, in_order, keep
from freemesh_ray.finish.refill.patterns import FEWEST, MOST_ELEMENTS, MOST_OF_DOMAIN, ROWS, ROWS_OF_DOMAIN, Patterns
from freemesh_ray.finish.refill.ring_filling import (
    CORNER_COUNT,
    HOLE,
    LENGTH,
    QUADS,
    Filling,
    begin,
    beside,
    edge_length,
    quad,
    row,
    rows_fit,
)

#: Options that are kept.
KEPT = 4
#: Places around that tell where the loop is best joined to the hole's.
SAMPLES = 16


@inlined
def around_hole(filling: Filling, place: int) -> int:
    """The vertex at a place around the hole."""
    n = filling.counts[HOLE]
    return filling.hole[(n - place % n) % n]


@inner
def row_around_hole(filling: Filling, h: float) -> None:
    """Lay a row of elements, about h wide, around the hole, which is then as much larger."""
    n, hole, partner = filling.counts[HOLE], filling.hole, filling.partner
    for i in range(n):
        partner[i] = beside(filling, hole[(i + n - 1) % n], hole[i], hole[(i + 1) % n], h)
    for i in range(n):
        after = (i + 1) % n
        quad(filling, hole[i], hole[after], partner[after], partner[i])
    for i in range(n):
        hole[i] = partner[i]


@inner
def last_row(filling: Filling, offset: int) -> None:
    """Fill between loops that are equally long; the loop's first place lies opposite that place around the hole."""
    n, loop = filling.counts[LENGTH], filling.loop
    for i in range(n):
        ahead = around_hole(filling, offset + i + 1)
        quad(filling, loop[i], loop[(i + 1) % n], ahead, around_hole(filling, offset + i))


@inner
def rings(filling: Filling, outside: int, inside: int, offset: int) -> None:
    """Fill by so many rows along the loop, so many around the hole, and one between."""
    h = edge_length(filling, filling.loop, filling.counts[LENGTH])
    for _ in range(outside):
        row(filling, h)
    h = edge_length(filling, filling.hole, filling.counts[HOLE])
    for _ in range(inside):
        row_around_hole(filling, h)
    last_row(filling, offset)


@inlined
def _enclosed(filling: Filling) -> float:
    """The area between the loop and the hole."""
    n, m, xy, area = filling.counts[LENGTH], filling.counts[HOLE], filling.xy, 0.0
    for i in range(n + m):
        a = filling.loop[i] if i < n else filling.hole[i - n]
        b = filling.loop[(i + 1) % n] if i < n else filling.hole[(i - n + 1) % m]
        area += 0.5 * (xy[a, 0] * xy[b, 1] - xy[b, 0] * xy[a, 1])
    return area


@inner
def opposite(filling: Filling) -> int:
    """The place around the hole, as long as the loop, that the loop's first one is best joined to."""
    n, best, offset, xy = filling.counts[LENGTH], math.inf, 0, filling.xy
    step = 1 + n // SAMPLES
    for k in range(n):
        total = 0.0
        for i in range(0, n, step):
            a, b = filling.loop[i], around_hole(filling, k + i)
            total += (xy[b, 0] - xy[a, 0]) ** 2 + (xy[b, 1] - xy[a, 1]) ** 2
        if total < best:
            best, offset = total, k
    return offset


@inner
def outside(filling: Filling, most: int, elements: float) -> int:
    """Lay rows along the loop, so many at most, until it is as long as the hole's; how many, -1 if it never is.

    Args:
        filling: begun.
        most: rows.
        elements: that the filling may have.
    """
    h = edge_length(filling, filling.loop, filling.counts[LENGTH])
    for rows in range(most + 1):
        if filling.counts[LENGTH] == filling.counts[HOLE]:
            return rows
        if filling.counts[LENGTH] < filling.counts[HOLE] or filling.counts[CORNER_COUNT] == 0 or not rows_fit(filling):
            break
        if filling.counts[QUADS] + filling.counts[LENGTH] > elements:
            break
        row(filling, h)
    return -1


@inner
def list_rings(mesh: Halfedges, growth: Growth, filling: Filling, patterns: Patterns, most: float, whole: bool) -> int:
    """Fill ``patterns.options``, the best first, with the fillings of a patch with a hole; how many there are.

    The arguments are those of `list_patterns`.
    """
    n, m, size, left = growth.counts[OUTER], growth.counts[LOOP] - growth.counts[OUTER], growth.counts[SIZE], 0.0
    growth.counts[WORK] += n + m
    if not begin(mesh, growth, filling):
        return 0
    for i in range(n + m):
        left += patterns.flat[i]
    if n > m:  # corners are those of the rows outside, and have five elements where these end
        for k in range(filling.counts[CORNER_COUNT]):
            left += 1.0 + patterns.more[filling.corners[k]]
    if left > most:
        return 0
    wanted = _enclosed(filling)
    wanted /= edge_length(filling, filling.loop, n) * edge_length(filling, filling.hole, m)
    low, high = FEWEST[1 if whole else 0] * size - 2.0, MOST_ELEMENTS[1 if whole else 0] * size + 2.0
    if whole:
        high = max(high, min(MOST_OF_DOMAIN * size, MOST_ELEMENTS[1] * wanted))
    rows = outside(filling, n // ROWS_OF_DOMAIN if whole else ROWS, high)
    if rows < 0:
        return 0
    offset, made, count = opposite(filling), filling.counts[QUADS], 0
    best = max(0, round((wanted - made) / m) - 1)
    for inside in range(max(0, best - 1), best + 2):
        elements = made + m * (inside + 1)
        if low <= elements <= high:
            prior = abs(math.log(elements / wanted))
            numbers = (rows, inside, offset, 0)
            count = keep(patterns.options, 0, count, KEPT, left, prior, RINGS, elements, numbers)
    return in_order(patterns.options, count)
