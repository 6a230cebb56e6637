"""The changes of connectivity that may help: what each adds to the irregularity, and the best of them in order.

An interior vertex is regular with four elements, one on the boundary with one for every right angle.
"""

from __future__ import annotations

import math

from envs.kernels.compiled import compiled, inlined
from envs.types import Floats, Ints
from freemesh_ray.finish.halfedges import (
    MOST,
    NONE,
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
def irregularity(mesh: Halfedges, vertex: int, change: int) -> float:
    """What a vertex with ``change`` more elements costs; 0 when it is regular."""
    off = mesh.degree[vertex] + change - mesh.ideal[vertex]
    if not mesh.fixed[vertex]:
        return off * off
    return 0.8 * (abs(off) - 0.3) ** 2 if abs(off) > 0.55 else 0.0


@inlined
def rise(mesh: Halfedges, vertex: int, change: int) -> float:
    """Irregularity added when a vertex gets ``change`` more elements; infinite when it may not."""
    degree = mesh.degree[vertex] + change
    if degree < (1 if mesh.fixed[vertex] else 3) or degree > MOST - 1:
        return math.inf
    return irregularity(mesh, vertex, change) - irregularity(mesh, vertex, 0)


@inlined
def swap_cost(mesh: Halfedges, patch: Patch, h: int, side: int, most: float) -> float:
    """Irregularity that a swap adds; infinite when it is not possible or adds more than ``most``."""
    g = mesh.opp[h]
    if g == NONE or not inside(patch, g >> 2) or not inside(patch, h >> 2):
        return math.inf
    u, w = origin(mesh, h), origin(mesh, g)
    p = origin(mesh, before(h)) if side else origin(mesh, before(before(h)))
    r = origin(mesh, before(g)) if side else origin(mesh, before(before(g)))
    cost = rise(mesh, u, -1) + rise(mesh, w, -1) + rise(mesh, p, 1) + rise(mesh, r, 1)
    return math.inf if p == r or cost > most or adjacent(mesh, p, r) else cost


@inlined
def collapse_cost(mesh: Halfedges, patch: Patch, h: int, most: float) -> float:
    """Irregularity that a collapse adds; infinite when it is not possible or adds more than ``most``."""
    a, b = origin(mesh, h), origin(mesh, after(h))
    c, d = origin(mesh, after(after(h))), origin(mesh, before(h))
    stays, goes = merging(mesh, a, c)
    if mesh.fixed[goes] or not is_inner(patch, goes):
        return math.inf
    merged = rise(mesh, stays, mesh.degree[goes] - 2)
    cost = merged - irregularity(mesh, goes, 0) + rise(mesh, b, -1) + rise(mesh, d, -1)
    if cost > most:
        return math.inf
    spoke = mesh.out[goes]
    for _ in range(mesh.degree[goes]):
        near, far = origin(mesh, after(spoke)), origin(mesh, after(after(spoke)))
        if near == stays or (far == stays and spoke >> 2 != h >> 2):
            return math.inf
        if near not in (b, d) and adjacent(mesh, near, stays):
            return math.inf
        spoke = around(mesh, spoke)
    return cost


@inlined
def split_cost(mesh: Halfedges, patch: Patch, h: int, k: int, most: float) -> float:
    """Irregularity that a split adds; infinite when it is not possible or adds more than ``most``."""
    v = origin(mesh, h)
    if mesh.opp[h] == NONE or k < 2 or mesh.degree[v] - k < 2 or not is_inner(patch, v):
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
    return cost if cost <= most else math.inf


@inlined
def offer(options: Floats, count: int, total: float, kind: int, h: int, argument: int) -> int:
    """Keep a change among the best, in order; how many there are."""
    width = len(options)
    if total == math.inf or (count == width and total >= options[width - 1, TOTAL]):
        return count
    at = min(count, width - 1)
    while at > 0 and options[at - 1, TOTAL] > total:
        options[at] = options[at - 1]
        at -= 1
    options[at, TOTAL], options[at, KIND], options[at, HALFEDGE], options[at, ARGUMENT] = total, kind, h, argument
    return min(count + 1, width)


@compiled
def list_options(
    mesh: Halfedges, patch: Patch, hot: Ints, total: float, limit: float, regular_too: bool, options: Floats
) -> int:
    """Fill the options with the changes that may help a hot vertex; how many there are.

    Args:
        mesh: not changed.
        patch: where changes may be.
        hot: (k,) int64, vertices that a change may start from.
        total: irregularity added so far.
        limit: irregularity that may have been added after the change.
        regular_too: whether changes may start from regular vertices.
        options: (width, 4) float64, overwritten: irregularity added after it, kind, half-edge, argument.
    """
    count = 0
    most = limit - total
    for v in hot:
        if mesh.degree[v] == 0:
            continue
        off = mesh.degree[v] - mesh.ideal[v]
        regular = irregularity(mesh, v, 0) == 0.0
        if regular and not regular_too:
            continue
        spoke = mesh.out[v]
        for _ in range(mesh.degree[v]):
            if off > 0.0 or regular:
                for side in range(2):
                    cost = swap_cost(mesh, patch, spoke, side, most)
                    count = offer(options, count, total + cost, SWAP, spoke, side)
                h = after(spoke)
                count = offer(options, count, total + collapse_cost(mesh, patch, h, most), COLLAPSE, h, 0)
                for k in range(2, mesh.degree[v] - 1):
                    cost = split_cost(mesh, patch, spoke, k, most)
                    count = offer(options, count, total + cost, SPLIT, spoke, k)
            if off < 0.0 or regular:
                h = after(spoke)
                count = offer(options, count, total + swap_cost(mesh, patch, h, 1, most), SWAP, h, 1)
                h = after(h)
                count = offer(options, count, total + swap_cost(mesh, patch, h, 0, most), SWAP, h, 0)
                count = offer(options, count, total + collapse_cost(mesh, patch, spoke, most), COLLAPSE, spoke, 0)
                h = mesh.opp[spoke]
                if h != NONE:
                    for k in range(2, mesh.degree[origin(mesh, h)] - 1):
                        count = offer(options, count, total + split_cost(mesh, patch, h, k, most), SPLIT, h, k)
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


@compiled
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
