"""A patch that grows: a disc of elements, or a ring of them around a hole of the domain, and the loops at its ends.

A vertex of the loop has elements of the patch and, unless the domain ends there, others outside. Inside the domain a
vertex with a single element outside would be a reflex corner of the patch: that element is pulled in. So are those in
a hole of the patch, unless it is the domain's, and around a vertex where the patch touches itself. Where that leads
beyond the domain's boundary, past the limit, or to more reflex corners of the domain than may be, the patch stays as it
was.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from envs.kernels.jit import inlined, inner
from envs.types import Ints
from freemesh_ray.finish.halfedges import MOST_GIVEN, NONE, PINNED, Halfedges, after, around, origin

#: A vertex of the domain's boundary with more room than this, in right angles, is a reflex corner, which should have
#: three elements; one with more than that has no filling.
REFLEX, MOST_ROOM = 2.55, 3.55
#: Reflex corners of the domain that a patch's outer loop may reach, at most.
REFLEX_CORNERS = 2
#: Rounds in which holes and pinches are filled, at most.
ROUNDS = 6

# Entries of Growth.counts.
SIZE, LOOP, MARK, WORK, OUTER = range(5)


class Growth(NamedTuple):
    """Working memory.

    Attributes:
        inside: (M,) bool, the elements of the patch.
        uses: (V,) int64, elements of the patch around each vertex.
        members: (M,) int64, the elements of the patch, in the order they came.
        stack: (S,) int64, elements to take in.
        loop, rim: (8 M,) int64, vertices around the patch, counter-clockwise, and the half-edges that leave them; then
            those around the hole in it, clockwise.
        vertex_mark: (V,) int64, the mark of the last walk that met a vertex.
        edge_mark: (4 M,) int64, the same for half-edges.
        counts: (5,) int64: elements of the patch; vertices of all loops; the last mark; work done, in elements seen;
            vertices of the outer loop.
    """

    inside: np.ndarray
    uses: Ints
    members: Ints
    stack: Ints
    loop: Ints
    rim: Ints
    vertex_mark: Ints
    edge_mark: Ints
    counts: Ints


def growth_of(mesh: Halfedges) -> Growth:
    """Room for any patch of a mesh."""
    n, m = len(mesh.xy), len(mesh.quads)
    return Growth(
        inside=np.zeros(m, dtype=np.bool_),
        uses=np.zeros(n, dtype=np.int64),
        members=np.zeros(m, dtype=np.int64),
        stack=np.zeros(8 * m + 4 * MOST_GIVEN, dtype=np.int64),
        loop=np.zeros(8 * m, dtype=np.int64),
        rim=np.zeros(8 * m, dtype=np.int64),
        vertex_mark=np.zeros(n, dtype=np.int64),
        edge_mark=np.zeros(4 * m, dtype=np.int64),
        counts=np.zeros(5, dtype=np.int64),
    )


@inlined
def new_mark(growth: Growth) -> int:
    """A mark that no vertex or half-edge has."""
    growth.counts[MARK] += 1
    return growth.counts[MARK]


@inlined
def outside(mesh: Halfedges, growth: Growth, vertex: int) -> int:
    """How many elements around a vertex do not belong to the patch."""
    return mesh.degree[vertex] - growth.uses[vertex]


@inlined
def target(mesh: Halfedges, growth: Growth, vertex: int) -> float:
    """How many elements the patch should have at a vertex of its loop; a float on the domain's boundary."""
    return mesh.ideal[vertex] - outside(mesh, growth, vertex)


@inner
def push_fan(mesh: Halfedges, growth: Growth, vertex: int, stacked: int) -> int:
    """Stack the elements around a vertex that are outside; how many are stacked, -1 when there is no room."""
    if mesh.degree[vertex] > MOST_GIVEN or stacked + MOST_GIVEN >= len(growth.stack):
        return -1
    spoke = mesh.out[vertex]
    for _ in range(mesh.degree[vertex]):
        if not growth.inside[spoke >> 2]:
            growth.stack[stacked] = spoke >> 2
            stacked += 1
        spoke = around(mesh, spoke)
    return stacked


@inner
def shrink(mesh: Halfedges, growth: Growth, size: int) -> None:
    """Take the last elements out again, down to a size."""
    for i in range(size, growth.counts[SIZE]):
        quad = growth.members[i]
        growth.inside[quad] = False
        for corner in range(4):
            growth.uses[mesh.quads[quad, corner]] -= 1
    growth.counts[SIZE] = size


@inner
def _take_in(mesh: Halfedges, growth: Growth, stacked: int, limit: int) -> bool:
    """Take in what is stacked, and what that pulls in; False when the domain or the limit ends it."""
    while stacked > 0:
        stacked -= 1
        quad = growth.stack[stacked]
        if growth.inside[quad]:
            continue
        if growth.counts[SIZE] >= limit:
            return False
        growth.inside[quad] = True
        growth.members[growth.counts[SIZE]] = quad
        growth.counts[SIZE] += 1
        growth.counts[WORK] += 1
        for corner in range(4):
            growth.uses[mesh.quads[quad, corner]] += 1
        for corner in range(4):
            v = mesh.quads[quad, corner]
            if mesh.degree[v] == PINNED:
                return False
            if mesh.fixed[v]:
                if target(mesh, growth, v) > MOST_ROOM:
                    return False
            elif outside(mesh, growth, v) == 1:
                stacked = push_fan(mesh, growth, v, stacked)
                if stacked < 0:
                    return False
    return True


@inlined
def on_rim(mesh: Halfedges, growth: Growth, h: int) -> bool:
    """Whether the patch ends at a half-edge of one of its elements."""
    g = mesh.opp[h]
    return g == NONE or not growth.inside[g >> 2]


@inlined
def following(growth: Growth, i: int) -> int:
    """The place after one on the loops."""
    outer = growth.counts[OUTER]
    if i < outer:
        return i + 1 if i + 1 < outer else 0
    return i + 1 if i + 1 < growth.counts[LOOP] else outer


@inner
def _walk(mesh: Halfedges, growth: Growth, start: int, n: int, most: int) -> int:
    """Walk along a loop of the rim, which is put at place n; where the next would be, ``most`` at most."""
    h = start
    while n < most:
        growth.loop[n], growth.rim[n] = origin(mesh, h), h
        n += 1
        h = after(h)
        while not on_rim(mesh, growth, h):
            h = after(mesh.opp[h])
        if h == start:
            break
    return n


@inner
def _signed_area(mesh: Halfedges, growth: Growth, begin: int, end: int) -> float:
    """Twice the area that a loop of the rim goes around, from place to place; below 0 around a hole."""
    area = 0.0
    for i in range(begin, end):
        a, b = growth.loop[i], growth.loop[i + 1 if i + 1 < end else begin]
        area += mesh.xy[a, 0] * mesh.xy[b, 1] - mesh.xy[b, 0] * mesh.xy[a, 1]
    return area


@inner
def _walk_hole(mesh: Halfedges, growth: Growth, total: int) -> bool:
    """After one of two loops, walk along the other; False unless they are all, and one is a hole of the domain."""
    mark, n, start = new_mark(growth), growth.counts[LOOP], NONE
    for i in range(n):
        growth.edge_mark[growth.rim[i]] = mark
    for i in range(growth.counts[SIZE]):
        for corner in range(4):
            h = 4 * growth.members[i] + corner
            if start == NONE and growth.edge_mark[h] != mark and on_rim(mesh, growth, h):
                start = h
    if _walk(mesh, growth, start, n, total) != total:
        return False
    if _signed_area(mesh, growth, 0, n) < 0.0:
        for i in range(n):  # the hole came first: it goes behind, by way of the end
            growth.loop[total + i], growth.rim[total + i] = growth.loop[i], growth.rim[i]
        for i in range(total):
            growth.loop[i], growth.rim[i] = growth.loop[n + i], growth.rim[n + i]
        n = total - n
        growth.counts[LOOP] = growth.counts[OUTER] = n
    for i in range(n, total):
        if mesh.opp[growth.rim[i]] != NONE:
            return False
    if _signed_area(mesh, growth, n, total) > 0.0:
        return False
    growth.counts[LOOP], growth.counts[OUTER] = total, n
    return True


@inner
def trace(mesh: Halfedges, growth: Growth) -> bool:
    """Walk around the patch, and around the hole of the domain in it; False, after one loop, if there are others."""
    total, start = 0, NONE
    for i in range(growth.counts[SIZE]):
        for corner in range(4):
            h = 4 * growth.members[i] + corner
            if on_rim(mesh, growth, h):
                total += 1
                if start == NONE:
                    start = h
    growth.counts[WORK] += growth.counts[SIZE] >> 2
    growth.counts[LOOP] = growth.counts[OUTER] = 0
    if start == NONE:
        return True
    growth.counts[LOOP] = growth.counts[OUTER] = _walk(mesh, growth, start, 0, total)
    return growth.counts[LOOP] == total or _walk_hole(mesh, growth, total)


@inner
def _stack_holes(mesh: Halfedges, growth: Growth) -> int:
    """Stack what lies across all loops but the outer one; how many, -1 when the domain ends there."""
    mark, n = new_mark(growth), growth.counts[LOOP]
    for i in range(n):
        growth.edge_mark[growth.rim[i]] = mark
    area, stacked = _signed_area(mesh, growth, 0, n), 0
    for i in range(growth.counts[SIZE]):
        for corner in range(4):
            h = 4 * growth.members[i] + corner
            if on_rim(mesh, growth, h) and (growth.edge_mark[h] == mark) == (area < 0.0):
                if mesh.opp[h] == NONE or stacked + 1 >= len(growth.stack):
                    return -1
                growth.stack[stacked] = mesh.opp[h] >> 2
                stacked += 1
    return stacked


@inner
def _stack_pinches(mesh: Halfedges, growth: Growth) -> int:
    """Stack what is around vertices that the loop meets twice; how many, -1 when the domain ends there."""
    mark, stacked = new_mark(growth), 0
    for i in range(growth.counts[LOOP]):
        v = growth.loop[i]
        if growth.vertex_mark[v] == mark:
            if mesh.fixed[v]:
                return -1
            stacked = push_fan(mesh, growth, v, stacked)
            if stacked < 0:
                return -1
        growth.vertex_mark[v] = mark
    return stacked


@inner
def reflex_corners(mesh: Halfedges, growth: Growth) -> int:
    """How many vertices of the outer loop are reflex corners of the patch."""
    count = 0
    for i in range(growth.counts[OUTER]):
        count += 1 if target(mesh, growth, growth.loop[i]) > REFLEX else 0
    return count


@inner
def add(mesh: Halfedges, growth: Growth, stacked: int, limit: int) -> bool:
    """Grow by what is stacked and what that pulls in; False, and the patch is as before, when that is not possible.

    Args:
        mesh: not changed.
        growth: the patch; its loops are traced either way.
        stacked: how many elements are stacked; fewer than 0: none, and it is not possible.
        limit: elements that the patch may have.
    """
    size = growth.counts[SIZE]
    for _ in range(ROUNDS):
        if stacked <= 0 or not _take_in(mesh, growth, stacked, limit):
            break
        if not trace(mesh, growth):
            stacked = _stack_holes(mesh, growth)
            continue
        stacked = _stack_pinches(mesh, growth)
        if stacked == 0 and reflex_corners(mesh, growth) > REFLEX_CORNERS:
            break
        if stacked == 0:
            return growth.counts[SIZE] > size
    shrink(mesh, growth, size)
    trace(mesh, growth)
    return False


@inner
def stack_around(mesh: Halfedges, growth: Growth) -> int:
    """Stack all elements outside that touch the patch; how many, -1 when there is no room."""
    stacked = 0
    for i in range(growth.counts[LOOP]):
        stacked = push_fan(mesh, growth, growth.loop[i], stacked)
        if stacked < 0:
            return -1
    return stacked


@inner
def stack_side(mesh: Halfedges, growth: Growth, begin: int, length: int) -> int:
    """Stack the row of elements beyond a side of the outer loop; how many, -1 when the domain ends there."""
    n = growth.counts[OUTER]
    for i in range(length):
        g = mesh.opp[growth.rim[(begin + i) % n]]
        if g == NONE:
            return -1
        growth.stack[i] = g >> 2
    return length
