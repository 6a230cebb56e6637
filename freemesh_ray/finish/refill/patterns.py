"""The fillings that a patch may get, and the order in which they are worth a trial.

What a filling costs is the irregular vertices that it leaves on and in the loop: a vertex of the loop inside the domain
is regular with four elements in all, one on the boundary as the clean-up has it. Among fillings that leave as many
those come first whose straight sides are nearest to as long as their elements should be.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from envs.kernels.jit import inlined, inner
from envs.types import Floats
from freemesh_ray.finish.changes import boundary_cost
from freemesh_ray.finish.halfedges import Halfedges
from freemesh_ray.finish.refill.growth import LOOP, REFLEX, SIZE, WORK, Growth, new_mark, outside, target
from freemesh_ray.finish.refill.options import (
    COLUMNS,
    CUT,
    ELEMENTS,
    LEFT,
    RANK,
    RECTANGLE,
    ROOM,
    STAR,
    WORTH,
    in_order,
    keep,
)
from freemesh_ray.finish.refill.ring_filling import (
    CORNER_COUNT,
    CORNERED,
    FLAT_FIRST,
    FLAT_SECOND,
    LENGTH,
    Filling,
    begin,
    row,
    rows_fit,
    spokes_of,
)

#: Options of each kind that are kept: rectangles for each number of rows, stars, cuts.
KEPT = (4, 4, 8)
#: Rows around a rectangle, at most, and over the length of the loop when that is the domain's boundary.
ROWS, ROWS_OF_DOMAIN = 10, 5
#: Elements over those before, at least and at most; of the whole domain.
FEWEST, MOST_ELEMENTS = (0.75, 0.88), (1.3, 1.1)
#: Elements of a whole domain over those before, or over those that its area has room for at the boundary's edge length
#: when they are fewer, at most: rows around a rectangle become narrower where its corners are, so that a round domain
#: has no good ones without more elements.
MOST_OF_DOMAIN = 2.0
#: So many are the first to be tried; and what straight sides count then.
ROUND, STRAIGHT = 1.6, 0.1
#: A cut's edges over its length in edge lengths, at least and at most; the longest loop that is cut.
SHORT, LONG, LONGEST = 0.75, 1.35, 160
#: Places on a loop without corners that a rectangle's corners are tried at, about.
PLACES = 100


class Patterns(NamedTuple):
    """Working memory.

    Attributes:
        flat: (R,) float64, what each vertex of the loop costs with two elements of the filling.
        more: (R,) float64, what it costs more as a corner, with one.
        three: (R,) float64, what it costs more with three; infinite unless it is a reflex corner.
        inner_more: (R,) float64, as ``more`` on the loop inside the rows.
        options: (ROOM, COLUMNS) float64, see `options`.
        before: (1,) float64, what the patch costs as it is.
    """

    flat: Floats
    more: Floats
    three: Floats
    inner_more: Floats
    options: Floats
    before: Floats


def patterns_of(elements: int) -> Patterns:
    """Room for the patterns of patches with so many elements."""
    room = 2 * elements + 16
    return Patterns(
        flat=np.zeros(room), more=np.zeros(room), three=np.zeros(room), inner_more=np.zeros(room),
        options=np.zeros((ROOM, COLUMNS)), before=np.zeros(1),
    )  # fmt: skip


@inner
def assess(mesh: Halfedges, growth: Growth, patterns: Patterns) -> float:
    """Work out what the patch costs and what each vertex of its loop would; the least that a filling can leave.

    The vertices of the loop tell a least number, and where the loop lies inside the domain the index theorem does:
    there the sum of 4 less the valence, over the loop and what is inside it, is the same for all fillings.
    """
    least, total, index, touches, mark = 0.0, 0.0, 0, False, new_mark(growth)
    for i in range(growth.counts[LOOP]):
        v = growth.loop[i]
        growth.vertex_mark[v] = mark
        around = outside(mesh, growth, v)
        if mesh.rim[v]:
            touches = True
            total += boundary_cost(mesh.degree[v] - mesh.ideal[v])
            flat, corner = boundary_cost(around + 2 - mesh.ideal[v]), boundary_cost(around + 1 - mesh.ideal[v])
            three = boundary_cost(around + 3 - mesh.ideal[v]) if target(mesh, growth, v) > REFLEX else math.inf
        else:
            total += 1.0 if mesh.degree[v] != 4 else 0.0
            index += 4 - mesh.degree[v]
            flat, corner, three = 1.0 if around != 2 else 0.0, 1.0 if around != 3 else 0.0, math.inf
        patterns.flat[i], patterns.more[i], patterns.three[i] = flat, corner - flat, three - flat
        least += min(flat, corner, three)
    for i in range(growth.counts[SIZE]):
        for c in range(4):
            v = mesh.quads[growth.members[i], c]
            if growth.vertex_mark[v] != mark:
                growth.vertex_mark[v] = mark
                total += 1.0 if mesh.degree[v] != 4 else 0.0
                index += 4 - mesh.degree[v]
    patterns.before[0] = total
    return least if touches else max(least, float(abs(index)))


@inlined
def _miss(filling: Filling, p: int, q: int, edges: int, h: float) -> float:
    """How far, as a logarithm, the straight way between two places of the loop is from so many edges; squared."""
    a, b, xy = filling.loop[p], filling.loop[q], filling.xy
    length = math.sqrt((xy[b, 0] - xy[a, 0]) ** 2 + (xy[b, 1] - xy[a, 1]) ** 2)
    return math.log(max(1e-9, length / (edges * h))) ** 2


@inner
def _list_rectangles(
    filling: Filling, options: Floats, more: Floats, base: float, most: float, rows: int, made: int,
    low: float, high: float, h: float, by_area: float, first: int,
) -> int:  # fmt: skip
    """Offer the rectangles on the loop, one for each length of their sides; how many options there are in all.

    Args:
        more: what each place costs as a corner, over what it costs otherwise.
        base: what the filling costs without the rectangle's corners.
        most: what it may cost.
        rows: laid so far, and ``made``: elements in them.
        low, high: elements that the filling may have.
        h: length of an edge.
        by_area: what it counts, as a logarithm, that the area inside is not that of so many squares.
        first: options before.
    """
    n, count = filling.counts[LENGTH], first
    half, area = n >> 1, 0.0
    for i in range(n):
        a, b = filling.loop[i], filling.loop[(i + 1) % n]
        area += 0.5 * (filling.xy[a, 0] * filling.xy[b, 1] - filling.xy[b, 0] * filling.xy[a, 1])
    stride = 1 + half // PLACES if rows > 0 and filling.counts[CORNER_COUNT] == 0 else 1
    for a in range(1, half, stride):
        b, elements = half - a, made + a * (half - a)
        if elements < low or elements > high:
            continue
        best = math.inf
        best_left, best_p = 0.0, 0
        for p in range(0, half, stride):
            right, top, end = p + a, p + half, (p + half + a) % n
            left = base + more[p] + more[right] + more[top] + more[end]
            if left > most:
                continue
            miss = _miss(filling, p, right, a, h) + _miss(filling, right, top, b, h)
            miss += _miss(filling, top, end, a, h) + _miss(filling, end, p, b, h)
            rank = WORTH * left + math.sqrt(miss)
            if rank < best:
                best, best_left, best_p = rank, left, p
        if best < math.inf:
            prior = best - WORTH * best_left
            prior += by_area * abs(math.log(max(1e-9, area / (h * h * a * b))))
            numbers = (rows, best_p, a, 0)
            count = keep(options, first, count, KEPT[RECTANGLE], best_left, prior, RECTANGLE, elements, numbers)
    return count


@inner
def _list_star(
    filling: Filling, options: Floats, toggled: int, left: float, prior: float, low: float, high: float,
    first: int, count: int,
) -> int:  # fmt: skip
    """Offer a star with the loop's corners, one place toggled; how many options there are in all."""
    n, corners, sides, role = filling.counts[LENGTH], filling.counts[CORNER_COUNT], 0, filling.role
    begin_at = last = -1
    for i in range(n):
        if (role[i] == 1) == (i != toggled):
            if begin_at == -1:
                begin_at = i
            else:
                filling.lengths[sides] = i - last
                sides += 1
            last = i
            if sides > 5:
                return count
    if begin_at == -1:
        return count
    filling.lengths[sides] = begin_at + n - last
    sides += 1
    if sides not in (3, 5) or corners > 6 or not spokes_of(filling.lengths, sides, filling.before_spoke):
        return count
    elements = 0
    for i in range(sides):
        elements += filling.before_spoke[i] * filling.before_spoke[(i + 1) % sides]
    if elements < low or elements > high:
        return count
    return keep(options, first, count, KEPT[STAR], left, prior, STAR, elements, (toggled, 0, 0, 0))


@inner
def _list_stars(
    filling: Filling, options: Floats, more: Floats, base: float, most: float, low: float, high: float, first: int
) -> int:
    """Offer the stars on the loop, as it is and with a corner more or less."""
    n, corners, count = filling.counts[LENGTH], filling.counts[CORNER_COUNT], first
    if corners in (3, 5) and base + 1.0 <= most:
        count = _list_star(filling, options, -1, base + 1.0, 0.3, low, high, first, count)
    if corners in (2, 4, 6):
        for i in range(n):
            corner = filling.role[i] == 1
            left = base + 1.0 + (-more[i] if corner else more[i])
            if left <= most and (corners != 6 or corner) and (corners != 2 or not corner):
                count = _list_star(filling, options, i, left, 0.5, low, high, first, count)
    return count


@inlined
def _shape_elements(filling: Filling, sides: int) -> int:
    """Elements of a rectangle or star with these side lengths; 0 when there is none."""
    lengths, u = filling.lengths, filling.before_spoke
    if sides == 4:
        return lengths[0] * lengths[1] if lengths[0] == lengths[2] and lengths[1] == lengths[3] else 0
    if not spokes_of(lengths, sides, u):
        return 0
    elements = 0
    for i in range(sides):
        elements += u[i] * u[(i + 1) % sides]
    return elements


@inner
def _side_lengths(filling: Filling, p: int, d: int, edges: int, flat_p: bool, flat_q: bool) -> int:
    """Sides of the piece from place p over d edges of the loop and back over a path; how many, 6 when they are more.

    Both ends of the path are corners, unless they are flat.
    """
    n, sides, last, lengths = filling.counts[LENGTH], 0, 0, filling.lengths
    for step in range(1, d):
        if filling.role[(p + step) % n] == 1:
            if sides == 5:
                return 6
            lengths[sides] = step - last
            sides, last = sides + 1, step
    lengths[sides], lengths[sides + 1] = d - last, edges
    sides += 2
    if flat_q:
        lengths[sides - 2] += lengths[sides - 1]
        sides -= 1
    if flat_p and sides > 1:
        lengths[0] += lengths[sides - 1]
        sides -= 1
    return min(sides, 6)


@inner
def _keep_cuts(
    filling: Filling, options: Floats, left: float, p: int, d: int, at_p: int, at_q: int, low: float, high: float,
    h: float, first: int, count: int,
) -> int:  # fmt: skip
    """Offer the cuts from place p to the one d further on, of all lengths; how many options there are in all."""
    n, xy = filling.counts[LENGTH], filling.xy
    q = (p + d) % n
    a, b = filling.loop[p], filling.loop[q]
    length = math.sqrt((xy[b, 0] - xy[a, 0]) ** 2 + (xy[b, 1] - xy[a, 1]) ** 2) / h
    for edges in range(max(1, int(length * SHORT)), math.ceil(length * LONG) + 1):
        sides = _side_lengths(filling, p, d, edges, at_p == FLAT_FIRST, at_q == FLAT_FIRST)
        here = _shape_elements(filling, sides) if 3 <= sides <= 5 else 0
        if here == 0:
            continue
        sides = _side_lengths(filling, q, n - d, edges, at_q == FLAT_SECOND, at_p == FLAT_SECOND)
        there = _shape_elements(filling, sides) if 3 <= sides <= 5 else 0
        if there == 0 or here + there < low or here + there > high:
            continue
        prior = abs(math.log(max(1e-9, length / edges)))
        numbers = (p, q, edges, 3 * at_p + at_q)
        count = keep(options, first, count, KEPT[CUT], left, prior, CUT, here + there, numbers)
    return count


@inner
def _list_cuts(
    filling: Filling, options: Floats, three: Floats, base: float, most: float, low: float, high: float, h: float,
    first: int,
) -> int:  # fmt: skip
    """Offer the cuts between flat places of the loop into rectangles and stars; how many options there are in all."""
    n, corners, count = filling.counts[LENGTH], filling.counts[CORNER_COUNT], first
    if n > LONGEST:
        return count
    if 2 <= corners <= 6 and base + 1.0 <= most:
        for p in range(n):
            if filling.role[p] == 1:
                continue
            ends = 2
            for d in range(1, n):
                q = (p + d) % n
                if filling.role[q] == 1:
                    ends += 1
                    if ends > 5:
                        break
                    continue
                others = corners + 4 - ends
                if ends < 3 or others < 3 or others > 5 or ends > others or (ends == others and (q < p or ends == 4)):
                    continue
                left = base + (ends != 4) + (others != 4)
                if left <= most:
                    count = _keep_cuts(filling, options, left, p, d, CORNERED, CORNERED, low, high, h, first, count)
    for p in range(n):
        if three[p] == math.inf or filling.role[p] == 1:
            continue
        between = 0
        for d in range(1, n):
            q = (p + d) % n
            if filling.role[q] == 1:
                between += 1
                continue
            for at_p in (FLAT_FIRST, FLAT_SECOND):
                for at_q in range(3):
                    if at_q != CORNERED and three[q] == math.inf:
                        continue
                    ends = between + 2 - (at_p == FLAT_FIRST) - (at_q == FLAT_FIRST)
                    others = corners - between + 2 - (at_p == FLAT_SECOND) - (at_q == FLAT_SECOND)
                    if ends < 3 or ends > 5 or others < 3 or others > 5:
                        continue
                    left = base + three[p] + (ends != 4) + (others != 4) + (three[q] if at_q != CORNERED else 0.0)
                    if left <= most:
                        count = _keep_cuts(filling, options, left, p, d, at_p, at_q, low, high, h, first, count)
    return count


@inner
def list_patterns(
    mesh: Halfedges, growth: Growth, filling: Filling, patterns: Patterns, most: float, whole: bool
) -> int:
    """Fill ``patterns.options``, the best first, with the fillings of a disc that leave at most ``most``; how many.

    Args:
        mesh, growth: not changed; the patch is assessed.
        filling: overwritten.
        patterns: as ``assess`` left it.
        most: what irregular vertices may cost.
        whole: whether the patch is the whole domain.
    """
    n, size = growth.counts[LOOP], growth.counts[SIZE]
    if n & 1 or n < 4 or not begin(mesh, growth, filling):
        return 0
    low = FEWEST[1 if whole else 0] * size - 2.0
    high = MOST_ELEMENTS[1 if whole else 0] * size + 2.0
    base, h, area, options, xy = 0.0, 0.0, 0.0, patterns.options, filling.xy
    for i in range(n):
        x1, y1, x2, y2 = xy[i, 0], xy[i, 1], xy[(i + 1) % n, 0], xy[(i + 1) % n, 1]
        base += patterns.flat[i]
        h += math.sqrt((x2 - x1) ** 2 + (y2 - y1) ** 2) / n
        area += 0.5 * (x1 * y2 - x2 * y1)
        filling.role[i] = 0
    wanted = min(area / (h * h), float(size))
    growth.counts[WORK] += n + (n * n >> 4)
    count = _list_rectangles(filling, options, patterns.more, base, most, 0, 0, low, high, h, 0.0, 0)
    for k in range(filling.counts[CORNER_COUNT]):
        base += patterns.more[filling.corners[k]]
        filling.role[filling.corners[k]] = 1
    count = _list_stars(filling, options, patterns.more, base, most, low, high, count)
    count = _list_cuts(filling, options, patterns.three, base, most, low, high, h, count)
    corners, made = filling.counts[CORNER_COUNT], 0
    if base > most:
        return in_order(options, count)
    if whole:
        high = max(high, MOST_OF_DOMAIN * wanted)
    for rows in range(1, (n // ROWS_OF_DOMAIN if whole else ROWS) + 1):
        if not rows_fit(filling) or made > high:
            break
        made += filling.counts[LENGTH] - corners
        row(filling, h)
        inside = filling.counts[LENGTH]
        if made + inside * inside / 16.0 < low:
            continue
        for i in range(inside):
            patterns.inner_more[i] = 1.0
        for k in range(corners):
            patterns.inner_more[filling.corners[k]] = -1.0
        growth.counts[WORK] += inside * inside >> 5
        begun = count
        count = _list_rectangles(
            filling, options, patterns.inner_more, base + corners, most, rows, made, low, high, h,
            0.0 if whole else 1.0, count,
        )  # fmt: skip
        for option in range(begun, count if whole else begun):
            worth = WORTH * options[option, LEFT]
            finer = abs(math.log(options[option, ELEMENTS] / (ROUND * wanted)))
            options[option, RANK] = worth + finer + STRAIGHT * (options[option, RANK] - worth)
    return in_order(options, count)
