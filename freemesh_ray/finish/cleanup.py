"""Topological clean-up: short sequences of swaps, collapses and splits that make vertices regular.

An interior vertex is regular with four elements, one on the boundary with one for every right angle. Around each
irregular vertex a depth-first search tries sequences of up to ``DEPTH`` changes, those first that leave the least
irregularity. A sequence that lessens it is tried out: the vertices around are smoothed, and it stays when the elements
there are on the whole no poorer than before and the poorest is not poorer either. Otherwise everything is taken back.

    ball    the elements around the vertices up to RINGS edges from the seed; changes stay inside it, its rim as it is
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from envs.kernels.compiled import compiled, inlined
from envs.quality import eta_or_bent
from envs.types import Floats, Ints
from freemesh_ray.finish.halfedges import (
    LOGGED,
    MOST,
    MOVED,
    NONE,
    QUADS,
    VERTICES,
    Halfedges,
    adjacent,
    after,
    around,
    before,
    collapse,
    commit,
    origin,
    split,
    swap,
    undo,
)
from freemesh_ray.finish.smoother import FLOOR, merit, smooth

#: Changes in one sequence, at most.
DEPTH = 3
#: Changes tried at each depth.
WIDTH = (10, 6, 4)
#: Irregularity that a sequence may add on its way.
SLACK = 3.0
#: Sequences tried out around one vertex, at most.
TRIALS = 3
RINGS = 2
#: Rounds of rough smoothing before a sequence is judged for the first time, and of smoothing before the second.
ROUGH, SWEEPS = 3, 6

_SWAP, _COLLAPSE, _SPLIT = range(3)
# Entries of Search.counts.
_INNER, _BALL, _HOT, STAMP, TRIED, KEPT = range(6)


class Search(NamedTuple):
    """Working memory of the clean-up.

    Attributes:
        inner: (64,) int64, vertices inside the ball.
        ball: (256,) int64, its elements.
        hot: (64,) int64, vertices that the next change may start from.
        place: (64, 2) float64, where the inner vertices were.
        vertex_stamp, quad_stamp: (V,), (M,) int64, equal to the stamp inside the ball.
        options: (DEPTH, 16, 4) float64, [irregularity after it, kind, half-edge, argument] of the changes to try.
        counts: (6,) int64.
        changed: (M,) int64, for each element how many sequences had been kept when it was last in the ball of one.
        failed: (V,) int64, for each vertex how many had been kept when the search around it last found nothing.
        step, star: see smoother.workspace.
    """

    inner: Ints
    ball: Ints
    hot: Ints
    place: Floats
    vertex_stamp: Ints
    quad_stamp: Ints
    options: Floats
    counts: Ints
    changed: Ints
    failed: Ints
    step: Floats
    star: Floats


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
def swap_cost(mesh: Halfedges, search: Search, h: int, side: int) -> float:
    """Irregularity that a swap adds, infinite when it is not possible."""
    g = mesh.opp[h]
    stamp = search.counts[STAMP]
    if g == NONE or search.quad_stamp[g >> 2] != stamp or search.quad_stamp[h >> 2] != stamp:
        return math.inf
    u, w = origin(mesh, h), origin(mesh, g)
    p = origin(mesh, before(h)) if side else origin(mesh, before(before(h)))
    r = origin(mesh, before(g)) if side else origin(mesh, before(before(g)))
    cost = rise(mesh, u, -1) + rise(mesh, w, -1) + rise(mesh, p, 1) + rise(mesh, r, 1)
    return math.inf if p == r or cost > SLACK or adjacent(mesh, p, r) else cost


@inlined
def collapse_cost(mesh: Halfedges, search: Search, h: int) -> float:
    """Irregularity that a collapse adds, infinite when it is not possible."""
    a, b = origin(mesh, h), origin(mesh, after(h))
    c, d = origin(mesh, after(after(h))), origin(mesh, before(h))
    stays, goes = (c, a) if mesh.fixed[c] else (a, c)
    if mesh.fixed[goes] or search.vertex_stamp[goes] != search.counts[STAMP]:
        return math.inf
    merged = rise(mesh, stays, mesh.degree[goes] - 2)
    cost = merged - irregularity(mesh, goes, 0) + rise(mesh, b, -1) + rise(mesh, d, -1)
    if cost > SLACK:
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
def split_cost(mesh: Halfedges, search: Search, h: int, k: int) -> float:
    """Irregularity that a split adds, infinite when it is not possible."""
    v = origin(mesh, h)
    rest = mesh.degree[v] - k
    if mesh.opp[h] == NONE or k < 2 or rest < 2 or search.vertex_stamp[v] != search.counts[STAMP]:
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
    new = (k + 1 - 4.0) ** 2
    return (
        rise(mesh, v, 1 - k) + rise(mesh, origin(mesh, after(h)), 1) + rise(mesh, origin(mesh, after(other)), 1) + new
    )


@inlined
def offer(search: Search, depth: int, count: int, total: float, kind: int, h: int, argument: int) -> int:
    """Keep a change among the best of this depth, in order; how many there are."""
    options = search.options[depth]
    width = WIDTH[depth]
    if total > SLACK or (count == width and total >= options[width - 1, 0]):
        return count
    at = min(count, width - 1)
    while at > 0 and options[at - 1, 0] > total:
        options[at] = options[at - 1]
        at -= 1
    options[at, 0], options[at, 1], options[at, 2], options[at, 3] = total, kind, h, argument
    return min(count + 1, width)


@compiled
def list_options(mesh: Halfedges, search: Search, depth: int, total: float, all_vertices: bool) -> int:
    """Fill the options of this depth with the changes that may help a hot vertex; how many there are."""
    count = 0
    for i in range(search.counts[_HOT]):
        v = search.hot[i]
        if mesh.degree[v] == 0:
            continue
        off = mesh.degree[v] - mesh.ideal[v]
        regular = irregularity(mesh, v, 0) == 0.0
        if regular and not all_vertices:
            continue
        spoke = mesh.out[v]
        for _ in range(mesh.degree[v]):
            if off > 0.0 or regular:
                for side in range(2):
                    count = offer(
                        search, depth, count, total + swap_cost(mesh, search, spoke, side), _SWAP, spoke, side
                    )
                h = after(spoke)
                count = offer(search, depth, count, total + collapse_cost(mesh, search, h), _COLLAPSE, h, 0)
                for k in range(2, mesh.degree[v] - 1):
                    count = offer(search, depth, count, total + split_cost(mesh, search, spoke, k), _SPLIT, spoke, k)
            if off < 0.0 or regular:
                h = after(spoke)
                count = offer(search, depth, count, total + swap_cost(mesh, search, h, 1), _SWAP, h, 1)
                h = after(h)
                count = offer(search, depth, count, total + swap_cost(mesh, search, h, 0), _SWAP, h, 0)
                count = offer(search, depth, count, total + collapse_cost(mesh, search, spoke), _COLLAPSE, spoke, 0)
                h = mesh.opp[spoke]
                if h != NONE:
                    for k in range(2, mesh.degree[origin(mesh, h)] - 1):
                        count = offer(search, depth, count, total + split_cost(mesh, search, h, k), _SPLIT, h, k)
            spoke = around(mesh, spoke)
    return count


@inlined
def heat(search: Search, vertex: int) -> None:
    """Let the next change start from a vertex."""
    for i in range(search.counts[_HOT]):
        if search.hot[i] == vertex:
            return
    if search.counts[_HOT] < len(search.hot):
        search.hot[search.counts[_HOT]] = vertex
        search.counts[_HOT] += 1


@compiled
def take(mesh: Halfedges, search: Search, kind: int, h: int, argument: int) -> None:
    """Make a change, and all vertices it touches hot."""
    if kind == _SWAP:
        g = mesh.opp[h]
        first, second = h & ~3, g & ~3
        swap(mesh, h, argument)
        for c in range(4):
            heat(search, origin(mesh, first + c))
            heat(search, origin(mesh, second + c))
    elif kind == _COLLAPSE:
        b, d = origin(mesh, after(h)), origin(mesh, before(h))
        heat(search, collapse(mesh, h))
        heat(search, b)
        heat(search, d)
    else:
        quad = mesh.counts[QUADS]
        new = split(mesh, h, argument)
        search.vertex_stamp[new] = search.quad_stamp[quad] = search.counts[STAMP]
        for c in range(4):
            heat(search, origin(mesh, 4 * quad + c))


@compiled
def surround(mesh: Halfedges, search: Search, seed: int) -> int:
    """Gather the ball around a vertex; how many sequences had been kept when anything in it last changed."""
    newest = 0
    search.counts[STAMP] += 1
    stamp = search.counts[STAMP]
    search.inner[0], search.vertex_stamp[seed] = seed, stamp
    inner, ball, begin = 1, 0, 0
    for ring in range(RINGS + 1):
        end = inner
        for i in range(begin, end):
            v = search.inner[i]
            spoke = mesh.out[v]
            for _ in range(mesh.degree[v]):
                quad = spoke >> 2
                if search.quad_stamp[quad] != stamp and ball < len(search.ball):
                    search.quad_stamp[quad], search.ball[ball] = stamp, quad
                    newest = max(newest, search.changed[quad])
                    ball += 1
                for w in (origin(mesh, after(spoke)), origin(mesh, before(spoke))):
                    if ring < RINGS and search.vertex_stamp[w] != stamp and inner < len(search.inner) - DEPTH:
                        search.vertex_stamp[w], search.inner[inner] = stamp, w
                        inner += 1
                spoke = around(mesh, spoke)
        begin = end
    search.counts[_INNER], search.counts[_BALL] = inner, ball
    for i in range(inner):
        search.place[i, 0], search.place[i, 1] = mesh.xy[search.inner[i], 0], mesh.xy[search.inner[i], 1]
    return newest


@compiled
def judge(mesh: Halfedges, search: Search, quads_before: int) -> tuple[float, float]:
    """Mean merit and least eta of the elements in the ball, those added since ``quads_before`` among them."""
    total, least, count = 0.0, 1.0, 0
    for i in range(search.counts[_BALL] + mesh.counts[QUADS] - quads_before):
        quad = search.ball[i] if i < search.counts[_BALL] else quads_before + i - search.counts[_BALL]
        a = mesh.quads[quad, 0]
        if a == NONE:
            continue
        b, c, d = mesh.quads[quad, 1], mesh.quads[quad, 2], mesh.quads[quad, 3]
        xy = mesh.xy
        eta = eta_or_bent(xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1], xy[d, 0], xy[d, 1])
        total, least, count = total + merit(eta), min(least, eta), count + 1
    return total / max(1, count), least


@compiled
def settle(mesh: Halfedges, search: Search, vertices_before: int, sweeps: int, roughly: bool) -> None:
    """Smooth the interior vertices inside the ball."""
    n = 0
    movable = np.empty(len(search.inner) + DEPTH, dtype=np.int64)
    for i in range(search.counts[_INNER]):
        v = search.inner[i]
        if not mesh.fixed[v] and mesh.degree[v] > 0:
            movable[n] = v
            n += 1
    for v in range(vertices_before, mesh.counts[VERTICES]):
        if mesh.degree[v] > 0:
            movable[n] = v
            n += 1
    smooth(mesh, movable, n, sweeps, roughly, search.step, search.star)


@compiled
def put_back(mesh: Halfedges, search: Search) -> None:
    """The inner vertices to where they were."""
    for i in range(search.counts[_INNER]):
        v = search.inner[i]
        mesh.xy[v, 0], mesh.xy[v, 1] = search.place[i, 0], search.place[i, 1]


@compiled
def keep(mesh: Halfedges, search: Search, quads_before: int) -> None:
    """Make the changes final, and note where they were."""
    search.counts[KEPT] += 1
    for i in range(search.counts[_BALL]):
        search.changed[search.ball[i]] = search.counts[KEPT]
    search.changed[quads_before : mesh.counts[QUADS]] = search.counts[KEPT]
    commit(mesh)


@compiled
def improve(mesh: Halfedges, search: Search, seed: int, goal: float, gain: float, all_vertices: bool) -> bool:
    """Search around a vertex for a sequence that lessens irregularity by ``goal``; whether one was kept.

    Args:
        mesh: changed when one is.
        search: working memory.
        seed: the vertex.
        goal: irregularity must change by less than this.
        gain: the mean merit around must rise by at least this.
        all_vertices: let changes start from regular vertices, too.
    """
    if surround(mesh, search, seed) < search.failed[seed]:
        return False
    vertices, quads = mesh.counts[VERTICES], mesh.counts[QUADS]
    mean, least = judge(mesh, search, quads)
    totals = np.zeros(DEPTH + 1)
    logged = np.zeros(DEPTH + 1, dtype=np.int64)
    moved = np.zeros(DEPTH + 1, dtype=np.int64)
    hot = np.zeros(DEPTH + 1, dtype=np.int64)
    count, at = np.zeros(DEPTH, dtype=np.int64), np.zeros(DEPTH, dtype=np.int64)
    commit(mesh)
    search.counts[_HOT] = 0
    heat(search, seed)
    depth, trials = 0, 0
    hot[0] = 1
    count[0] = list_options(mesh, search, 0, 0.0, all_vertices)
    while depth >= 0:
        undo(mesh, logged[depth], moved[depth])
        search.counts[_HOT] = hot[depth]
        if at[depth] == count[depth] or trials == TRIALS:
            depth -= 1
            continue
        option = search.options[depth, at[depth]]
        at[depth] += 1
        total = option[0]
        take(mesh, search, int(option[1]), int(option[2]), int(option[3]))
        if total < goal:
            trials += 1
            search.counts[TRIED] += 1
            settle(mesh, search, vertices, ROUGH, True)
            now, poorest = judge(mesh, search, quads)
            if poorest > 0.0 and now > mean - 0.05:
                settle(mesh, search, vertices, SWEEPS, False)
                now, poorest = judge(mesh, search, quads)
            if poorest >= min(least, FLOOR) and poorest > 0.0 and now >= mean + gain:
                keep(mesh, search, quads)
                return True
            put_back(mesh, search)
        if depth + 1 < DEPTH:
            depth += 1
            totals[depth], logged[depth], moved[depth] = total, mesh.counts[LOGGED], mesh.counts[MOVED]
            hot[depth], at[depth] = search.counts[_HOT], 0
            count[depth] = list_options(mesh, search, depth, total, all_vertices)
    search.failed[seed] = search.counts[KEPT] + 1
    return False


@compiled
def clean(mesh: Halfedges, search: Search, passes: int, gain: float) -> int:
    """Go over all irregular vertices until nothing more is kept, ``passes`` times at most; sequences kept."""
    kept = 0
    for _ in range(passes):
        before_pass = kept
        v = 0
        while v < mesh.counts[VERTICES]:
            if mesh.degree[v] > 0 and irregularity(mesh, v, 0) > 0.0 and improve(mesh, search, v, -0.5, gain, False):
                kept += 1
            v += 1
        if kept == before_pass:
            break
    return kept


def workspace(mesh: Halfedges, step: Floats, star: Floats) -> Search:
    """Room for a search in this mesh."""
    return Search(
        inner=np.zeros(64, dtype=np.int64),
        ball=np.zeros(256, dtype=np.int64),
        hot=np.zeros(64, dtype=np.int64),
        place=np.zeros((64, 2)),
        vertex_stamp=np.zeros(len(mesh.xy), dtype=np.int64),
        quad_stamp=np.zeros(len(mesh.quads), dtype=np.int64),
        options=np.zeros((DEPTH, 16, 4)),
        counts=np.zeros(6, dtype=np.int64),
        changed=np.zeros(len(mesh.quads), dtype=np.int64),
        failed=np.zeros(len(mesh.xy), dtype=np.int64),
        step=step,
        star=star,
    )
