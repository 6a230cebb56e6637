"""The changes of connectivity that may help: what each adds to the irregularity, and the best of them in order.

An interior vertex is regular with four elements, one on the boundary with one for every right angle.
"""

from __future__ import annotations

import math

from envs.kernels.jit import inlined, inner
from envs.types import Floats, Ints
from freemesh_ray.finish.halfedges import (
    MOST,
    NONE,
    PINNED,
    QUADS,
    VERTICES,
    Halfedges,
    adjacent,
    after,
    around,
    before,
    collapse,
    merging,
    origin,
    split,
    swap,
)
from freemesh_ray.finish.patch import Patch, inside, is_inner, take_in

SWAP, COLLAPSE, SPLIT = range(3)
# Columns of options.
TOTAL, KIND, HALFEDGE, ARGUMENT = range(4)


@inlined
def boundary_cost(off: float) -> float:
    """What a boundary vertex costs that has so many elements too many; a little is nothing, its angle is as given."""
    return 0.8 * (abs(off) - 0.3) ** 2 if abs(off) > 0.55 else 0.0


@inlined
def irregularity(mesh: Halfedges, vertex: int) -> float:
    """What a vertex costs; 0 when it is regular."""
    off = mesh.degree[vertex] - mesh.ideal[vertex]
    return boundary_cost(off) if mesh.rim[vertex] else off * off


@inlined
def rise(mesh: Halfedges, vertex: int, change: int) -> float:
    """Irregularity added when a vertex gets ``change`` more elements; infinite when it may not."""
    degree = mesh.degree[vertex]
    if degree + change > MOST:
        return math.inf
    if mesh.rim[vertex]:
        off = degree - mesh.ideal[vertex]
        return boundary_cost(off + change) - boundary_cost(off) if degree + change >= 1 else math.inf
    return float(change * (2 * (degree - 4) + change)) if degree + change >= 3 else math.inf


@inlined
def swap_cost(mesh: Halfedges, patch: Patch, h: int, side: int, most: float) -> float:
    """Irregularity that a swap adds; infinite when it is not possible or does not add less than ``most``."""
    g = mesh.opp[h]
    if g == NONE or not inside(patch, g >> 2) or not inside(patch, h >> 2):
        return math.inf
    u, w = origin(mesh, h), origin(mesh, g)
    p = origin(mesh, before(h)) if side else origin(mesh, before(before(h)))
    r = origin(mesh, before(g)) if side else origin(mesh, before(before(g)))
    cost = rise(mesh, u, -1) + rise(mesh, w, -1) + rise(mesh, p, 1) + rise(mesh, r, 1)
    return math.inf if p == r or cost >= most or adjacent(mesh, p, r) else cost


@inlined
def collapse_cost(mesh: Halfedges, patch: Patch, h: int, most: float) -> float:
    """Irregularity that a collapse adds; infinite when it is not possible or does not add less than ``most``."""
    a, b = origin(mesh, h), origin(mesh, after(h))
    c, d = origin(mesh, after(after(h))), origin(mesh, before(h))
    stays, goes = merging(mesh, a, c)
    if mesh.fixed[goes] or not is_inner(patch, goes):
        return math.inf
    merged = rise(mesh, stays, mesh.degree[goes] - 2)
    cost = merged - irregularity(mesh, goes) + rise(mesh, b, -1) + rise(mesh, d, -1)
    if cost >= most:
        return math.inf
    spoke = mesh.out[goes]
    for _ in range(mesh.degree[goes]):
        near, far = origin(mesh, after(spoke)), origin(mesh, after(after(spoke)))
        if near == stays or (far == stays and spoke >> 2 != h >> 2):
            return math.inf
        if near not in (b, d) and adjacent(mesh, stays, near):
            return math.inf
        spoke = around(mesh, spoke)
    return cost


@inlined
def split_cost(mesh: Halfedges, patch: Patch, h: int, k: int, most: float) -> float:
    """Irregularity that a split adds; infinite when it is not possible or does not add less than ``most``."""
    v = origin(mesh, h)
    if mesh.opp[h] == NONE or k >= MOST or not is_inner(patch, v):
        return math.inf
    if mesh.counts[QUADS] + 1 >= len(mesh.quads) or mesh.counts[VERTICES] + 1 >= len(mesh.xy):
        return math.inf
    other = h
    for _ in range(k):
        other = around(mesh, other)
        if other == NONE:
            return math.inf
    if mesh.opp[other] == NONE:
        return math.inf
    ends = rise(mesh, origin(mesh, after(h)), 1) + rise(mesh, origin(mesh, after(other)), 1)
    cost = rise(mesh, v, 1 - k) + ends + (k - 3.0) ** 2
    return cost if cost < most else math.inf


@inlined
def offer(options: Floats, count: int, total: float, kind: int, h: int, argument: int) -> int:
    """Keep a change among the best, in order, unless it is known; how many there are."""
    at = count
    while at > 0 and options[at - 1, TOTAL] >= total:
        at -= 1
        known = options[at, TOTAL] == total and options[at, HALFEDGE] == h
        if known and options[at, KIND] == kind and options[at, ARGUMENT] == argument:
            return count
    at = min(count, len(options) - 1)
    while at > 0 and options[at - 1, TOTAL] > total:
        for column in range(4):
            options[at, column] = options[at - 1, column]
        at -= 1
    options[at, TOTAL], options[at, KIND], options[at, HALFEDGE], options[at, ARGUMENT] = total, kind, h, argument
    return min(count + 1, len(options))


@inlined
def _swaps(mesh: Halfedges, patch: Patch, h: int, side: int, total: float, options: Floats, count: int) -> int:
    """Offer a swap."""
    cost = swap_cost(mesh, patch, h, side, options[-1, TOTAL] - total)
    return offer(options, count, total + cost, SWAP, min(h, mesh.opp[h]), side) if cost < math.inf else count


@inlined
def _collapses(mesh: Halfedges, patch: Patch, h: int, total: float, options: Floats, count: int) -> int:
    """Offer a collapse."""
    cost = collapse_cost(mesh, patch, h, options[-1, TOTAL] - total)
    return offer(options, count, total + cost, COLLAPSE, h & ~2, 0) if cost < math.inf else count


@inlined
def _splits(mesh: Halfedges, patch: Patch, h: int, total: float, options: Floats, count: int) -> int:
    """Offer the splits that begin with a half-edge, if there is one, with two elements at least on either side."""
    most = min(mesh.degree[origin(mesh, h)] - 2, MOST - 1) if h != NONE else 0
    for k in range(2, most + 1):
        cost = split_cost(mesh, patch, h, k, options[-1, TOTAL] - total)
        count = offer(options, count, total + cost, SPLIT, h, k) if cost < math.inf else count
    return count


@inner
def list_options(mesh: Halfedges, patch: Patch, hot: Ints, total: float, limit: float, options: Floats) -> int:
    """Fill the options with the changes that may help a hot vertex; how many there are.

    Args:
        mesh: not changed.
        patch: where changes may be.
        hot: (k,) int64, vertices that a change may start from.
        total: irregularity added so far.
        limit: after the change less irregularity than this must have been added.
        options: (width, 4) float64, overwritten: irregularity added after it, kind, half-edge, argument.
    """
    count = 0
    options[-1, TOTAL] = limit
    for v in hot:
        if mesh.degree[v] in (0, PINNED) or irregularity(mesh, v) == 0.0:
            continue
        too_many = mesh.degree[v] > mesh.ideal[v]
        spoke = mesh.out[v]
        for _ in range(mesh.degree[v]):
            ahead = after(spoke)
            for side in range(2):
                edge = spoke if too_many else (ahead if side == 1 else after(ahead))
                count = _swaps(mesh, patch, edge, side, total, options, count)
            count = _collapses(mesh, patch, ahead if too_many else spoke, total, options, count)
            count = _splits(mesh, patch, spoke if too_many else mesh.opp[spoke], total, options, count)
            spoke = around(mesh, spoke)
    return count


@inlined
def heat(hot: Ints, count: int, vertex: int) -> int:
    """Add a vertex to the hot ones if there is room; how many there are."""
    for i in range(count):
        if hot[i] == vertex:
            return count
    if count == len(hot):
        return count
    hot[count] = vertex
    return count + 1


@inner
def make(mesh: Halfedges, patch: Patch, kind: int, h: int, argument: int, hot: Ints, count: int) -> int:
    """Make a change, and all vertices it touches hot; how many hot ones there are.

    Args:
        mesh: changed.
        patch: takes in what a split adds.
        kind: SWAP, COLLAPSE or SPLIT.
        h: its half-edge.
        argument: the side of a swap, the number of elements of a split.
        hot: (room,) int64.
        count: of hot vertices before.
    """
    if kind == SWAP:
        first, second = h & ~3, mesh.opp[h] & ~3
        swap(mesh, h, argument)
        for c in range(4):
            count = heat(hot, count, origin(mesh, first + c))
            count = heat(hot, count, origin(mesh, second + c))
    elif kind == COLLAPSE:
        b, d = origin(mesh, after(h)), origin(mesh, before(h))
        count = heat(hot, count, collapse(mesh, h))
        count = heat(hot, count, b)
        count = heat(hot, count, d)
    else:
        quad = mesh.counts[QUADS]
        take_in(patch, split(mesh, h, argument), quad)
        for c in range(4):
            count = heat(hot, count, origin(mesh, 4 * quad + c))
    return count
