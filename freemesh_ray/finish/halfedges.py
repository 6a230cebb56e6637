r"""A quadrilateral mesh as half-edges, and the three changes of its connectivity, each of which can be taken back.

Half-edge h = 4 q + c runs from corner c of element q to the next corner, the element on its left; ``opp[h]`` is the
half-edge back on the other side, ``NONE`` on the boundary.

    swap               w---a        w---a          the edge u-w becomes another diagonal
                      /|   |       / \  |          of the hexagon around it
                     d |   b  ->  d   \ b
                      \|  /        \   \|
                       c-u          c---u   ...

    collapse           b             b             an element vanishes: two opposite
                      / \            |             corners a, c become one
                     a   c    ->     a
                      \ /            |
                       d             d

    split              the way back: a vertex becomes two, with a new element between them
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from envs.kernels.jit import compiled, inlined, inner
from envs.types import Floats, Ints

NONE = -1
#: Elements around a vertex, at most, that a change may make.
MOST = 8
#: Given vertices with more elements are left alone, and so are those where the boundary meets itself: such a vertex
#: is given this degree, which no change may alter.
MOST_GIVEN, PINNED = 32, 1 << 20
#: Entries of the log that one change makes, at most.
LOG = 64
# Entries of Halfedges.counts.
QUADS, VERTICES, LOGGED, SIGNATURE = range(4)
# What a log entry restores.
_QUAD, _OPP, _OUT, _DEGREE, _COUNT = range(5)


class Halfedges(NamedTuple):
    """Working memory with room for more elements and vertices than there are.

    Attributes:
        xy: (V, 2) float64, positions; domain units.
        quads: (M, 4) int64, corners, counter-clockwise; a dead element's first is NONE.
        opp: (4 M,) int64, the half-edge on the other side.
        out: (V,) int64, a half-edge that leaves the vertex; on the boundary the one that has it to its right.
        degree: (V,) int64, elements around the vertex; 0 when it is dead, PINNED when it is left alone.
        ideal: (V,) float64, elements that would make right angles: 4 inside, the angle over pi/2 on the boundary.
        fixed: (V,) bool, stays where it is: on the boundary, or held inside.
        rim: (V,) bool, on the boundary.
        log: (L, 3) int64, [array, index, former value] of every change since the last ``commit``.
        counts: (4,) int64, [elements and vertices in use, dead ones included; entries of the log; signature: a number
            that is the same after the same changes in another order].
    """

    xy: Floats
    quads: Ints
    opp: Ints
    out: Ints
    degree: Ints
    ideal: Floats
    fixed: np.ndarray
    rim: np.ndarray
    log: Ints
    counts: Ints


@inlined
def after(h: int) -> int:
    """The next half-edge of the same element."""
    return (h & ~3) | ((h + 1) & 3)


@inlined
def before(h: int) -> int:
    """The previous half-edge of the same element."""
    return (h & ~3) | ((h + 3) & 3)


@inlined
def origin(mesh: Halfedges, h: int) -> int:
    """The vertex that a half-edge leaves."""
    return mesh.quads[h >> 2, h & 3]


@inlined
def around(mesh: Halfedges, h: int) -> int:
    """The next half-edge counter-clockwise that leaves the same vertex, NONE beyond the boundary."""
    return mesh.opp[before(h)]


@inlined
def _note(mesh: Halfedges, array: int, index: int, value: int) -> None:
    at = mesh.counts[LOGGED]
    mesh.log[at, 0], mesh.log[at, 1], mesh.log[at, 2] = array, index, value
    mesh.counts[LOGGED] = at + 1


@inlined
def _set_corner(mesh: Halfedges, h: int, vertex: int) -> None:
    _note(mesh, _QUAD, h, mesh.quads[h >> 2, h & 3])
    mesh.quads[h >> 2, h & 3] = vertex


@inlined
def _set_opp(mesh: Halfedges, h: int, other: int) -> None:
    _note(mesh, _OPP, h, mesh.opp[h])
    mesh.opp[h] = other


@inlined
def _set_out(mesh: Halfedges, vertex: int, h: int) -> None:
    _note(mesh, _OUT, vertex, mesh.out[vertex])
    mesh.out[vertex] = h


@inlined
def _set_degree(mesh: Halfedges, vertex: int, degree: int) -> None:
    """Set a degree, and keep the sum of degree times a scrambled vertex number up to date."""
    scrambled = (vertex * 0x9E3779B1) & 0x7FFFFFFF
    scrambled = ((scrambled ^ (scrambled >> 15)) * 0x45D9F3B) & 0x7FFFFFFF
    mesh.counts[SIGNATURE] += (degree - mesh.degree[vertex]) * (scrambled ^ (scrambled >> 16))
    mesh.degree[vertex] = degree


@inlined
def _add_degree(mesh: Halfedges, vertex: int, change: int) -> None:
    _note(mesh, _DEGREE, vertex, mesh.degree[vertex])
    _set_degree(mesh, vertex, mesh.degree[vertex] + change)


@inlined
def _join(mesh: Halfedges, h: int, other: int) -> None:
    """Make two half-edges, one of which may be NONE, each other's opposite."""
    if h != NONE:
        _set_opp(mesh, h, other)
    if other != NONE:
        _set_opp(mesh, other, h)


@inner
def commit(mesh: Halfedges) -> None:
    """Keep all changes."""
    mesh.counts[LOGGED] = 0


@inner
def undo(mesh: Halfedges, logged: int) -> None:
    """Take back all changes after so many entries of the log."""
    for at in range(mesh.counts[LOGGED] - 1, logged - 1, -1):
        array, index, value = mesh.log[at, 0], mesh.log[at, 1], mesh.log[at, 2]
        if array == _QUAD:
            mesh.quads[index >> 2, index & 3] = value
        elif array == _OPP:
            mesh.opp[index] = value
        elif array == _OUT:
            mesh.out[index] = value
        elif array == _DEGREE:
            _set_degree(mesh, index, value)
        else:
            mesh.counts[index] = value
    mesh.counts[LOGGED] = logged


@inlined
def adjacent(mesh: Halfedges, u: int, w: int) -> bool:
    """Whether an edge joins two vertices, of which the first is not pinned."""
    h = start = mesh.out[u]
    while True:
        if origin(mesh, after(h)) == w or origin(mesh, before(h)) == w:
            return True
        h = around(mesh, h)
        if h in (NONE, start):
            return False


@inner
def swap(mesh: Halfedges, h: int, side: int) -> None:
    """Turn the inner edge h in its hexagon: to the diagonal through the far end of ``after(h)`` (0) or the other (1).

    With h from u to w and the elements u w a b and w u c d: the new edge is a-c (0) or b-d (1).
    """
    g = mesh.opp[h]
    # The hexagon's sides w a b u c d, from w on, with what lies beyond them.
    sides = (after(h), after(after(h)), before(h), after(g), after(after(g)), before(g))
    corner = (
        origin(mesh, sides[0]), origin(mesh, sides[1]), origin(mesh, sides[2]),
        origin(mesh, sides[3]), origin(mesh, sides[4]), origin(mesh, sides[5]),
    )  # fmt: skip
    beyond = (
        mesh.opp[sides[0]], mesh.opp[sides[1]], mesh.opp[sides[2]],
        mesh.opp[sides[3]], mesh.opp[sides[4]], mesh.opp[sides[5]],
    )  # fmt: skip
    first, second = h & ~3, g & ~3
    begin = 1 if side == 0 else 2
    for j in range(6):
        i = (begin + j) % 6
        new = first + j if j < 3 else second + j - 3
        _set_corner(mesh, new, corner[i])
        _set_opp(mesh, new, beyond[i])
        if beyond[i] != NONE:
            _set_opp(mesh, beyond[i], new)
        if beyond[i] == NONE or not mesh.rim[corner[i]]:
            _set_out(mesh, corner[i], new)
    _set_corner(mesh, first + 3, corner[(begin + 3) % 6])
    _set_corner(mesh, second + 3, corner[begin])
    _join(mesh, first + 3, second + 3)
    _add_degree(mesh, corner[0], -1)
    _add_degree(mesh, corner[3], -1)
    _add_degree(mesh, corner[begin], 1)
    _add_degree(mesh, corner[(begin + 3) % 6], 1)


@inlined
def merging(mesh: Halfedges, a: int, c: int) -> tuple[int, int]:
    """Which of two merging vertices stays, and which goes: never the one on the boundary."""
    return (c, a) if mesh.fixed[c] or (c < a and not mesh.fixed[a]) else (a, c)


@inner
def collapse(mesh: Halfedges, h: int) -> int:
    """Merge the origin of h with the opposite corner of its element, which vanishes; the vertex that stays."""
    ab, bc, cd, da = h, after(h), after(after(h)), before(h)
    a, b, c, d = origin(mesh, ab), origin(mesh, bc), origin(mesh, cd), origin(mesh, da)
    ba, cb, dc, ad = mesh.opp[ab], mesh.opp[bc], mesh.opp[cd], mesh.opp[da]
    stays, goes = merging(mesh, a, c)
    spoke = mesh.out[goes]
    for _ in range(mesh.degree[goes]):
        following = around(mesh, spoke)
        _set_corner(mesh, spoke, stays)
        spoke = following
    _set_corner(mesh, h & ~3, NONE)
    _join(mesh, ba, cb)
    _join(mesh, dc, ad)
    if not mesh.rim[stays] or mesh.out[stays] == ab:
        _set_out(mesh, stays, cb)
    elif mesh.out[stays] == cd:
        _set_out(mesh, stays, ad)
    if mesh.out[b] == bc:
        _set_out(mesh, b, ba)
    if mesh.out[d] == da:
        _set_out(mesh, d, dc)
    _add_degree(mesh, stays, mesh.degree[goes] - 2)
    _add_degree(mesh, goes, -mesh.degree[goes])
    _add_degree(mesh, b, -1)
    _add_degree(mesh, d, -1)
    return stays


@inner
def split(mesh: Halfedges, h: int, k: int) -> int:
    """Open the vertex v that h leaves: the k elements from h on, counter-clockwise, move to a new vertex.

    With p the end of h and r that of the half-edge k further on, the new element is v p new r. No half-edge of the
    two may lie on the boundary.

    Returns:
        The new vertex, a little towards the elements it has.
    """
    v, p, clockwise = origin(mesh, h), origin(mesh, after(h)), mesh.opp[h]
    new, quad = mesh.counts[VERTICES], mesh.counts[QUADS]
    _note(mesh, _COUNT, VERTICES, new)
    _note(mesh, _COUNT, QUADS, quad)
    mesh.counts[VERTICES], mesh.counts[QUADS] = new + 1, quad + 1
    x = y = 0.0
    last = spoke = h
    for _ in range(k):
        last, following = spoke, around(mesh, spoke)
        _set_corner(mesh, spoke, new)
        far = origin(mesh, after(after(spoke)))
        x, y = x + mesh.xy[far, 0] / k, y + mesh.xy[far, 1] / k
        spoke = following
    r = origin(mesh, after(spoke))
    base = 4 * quad
    for j, vertex in enumerate((v, p, new, r)):
        _set_corner(mesh, base + j, vertex)
    _join(mesh, base, clockwise)
    _join(mesh, base + 1, h)
    _join(mesh, base + 2, before(last))
    _join(mesh, base + 3, spoke)
    mesh.fixed[new], mesh.rim[new], mesh.ideal[new] = False, False, 4.0
    _set_out(mesh, new, h)
    if not mesh.rim[v]:
        _set_out(mesh, v, base)
    _add_degree(mesh, new, k + 1 - mesh.degree[new])
    _add_degree(mesh, v, 1 - k)
    _add_degree(mesh, p, 1)
    _add_degree(mesh, r, 1)
    x, y = x - mesh.xy[v, 0], y - mesh.xy[v, 1]
    mesh.xy[new, 0], mesh.xy[new, 1] = mesh.xy[v, 0] + 0.3 * x, mesh.xy[v, 1] + 0.3 * y
    return new


@compiled
def _link(quads: Ints, opp: Ints, out: Ints, degree: Ints, first: Ints, chain: Ints) -> None:
    """Find opposite half-edges; ``first`` and ``chain`` list the half-edges that leave each vertex."""
    for h in range(4 * len(quads)):
        v = quads[h >> 2, h & 3]
        chain[h], first[v] = first[v], h
        degree[v] += 1
    for h in range(4 * len(quads)):
        u, w = quads[h >> 2, h & 3], quads[h >> 2, (h + 1) & 3]
        opp[h] = NONE
        g = first[w]
        while g != NONE:
            if quads[g >> 2, (g + 1) & 3] == u:
                opp[h] = g
                break
            g = chain[g]
    for v in range(len(first)):
        out[v] = first[v]
        g = first[v]
        while g != NONE:
            if opp[g] == NONE:
                out[v] = g
            g = chain[g]


def build(vertices: Floats, quads: Ints, fixed: np.ndarray, rim: np.ndarray, room: float = 0.5) -> Halfedges:
    """Half-edges of a valid mesh.

    Args:
        vertices: (n, 2) float64.
        quads: (m, 4) int64, counter-clockwise.
        fixed: (n,) bool, vertices that stay where they are.
        rim: (n,) bool, vertices of the boundary, which are among those.
        room: share of elements and vertices that may be added.
    """
    n, m = len(vertices), len(quads)
    spare = int(room * m) + 64
    mesh = Halfedges(
        xy=np.zeros((n + spare, 2)),
        quads=np.full((m + spare, 4), NONE, dtype=np.int64),
        opp=np.full(4 * (m + spare), NONE, dtype=np.int64),
        out=np.full(n + spare, NONE, dtype=np.int64),
        degree=np.zeros(n + spare, dtype=np.int64),
        ideal=np.full(n + spare, 4.0),
        fixed=np.zeros(n + spare, dtype=np.bool_),
        rim=np.zeros(n + spare, dtype=np.bool_),
        log=np.zeros((16 * LOG, 3), dtype=np.int64),
        counts=np.array([m, n, 0, 0], dtype=np.int64),
    )
    mesh.xy[:n], mesh.quads[:m], mesh.fixed[:n], mesh.rim[:n] = vertices, quads, fixed, rim
    first, chain = np.full(n, NONE, dtype=np.int64), np.empty(4 * m, dtype=np.int64)
    _link(mesh.quads[:m], mesh.opp, mesh.out, mesh.degree, first, chain)
    corner = vertices[quads]
    ahead, behind = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
    turn = np.arctan2(ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0], (ahead * behind).sum(axis=-1))
    total = np.bincount(quads.ravel(), np.abs(turn).ravel(), minlength=n)
    mesh.ideal[:n][rim] = np.maximum(1.0, total[rim] / (0.5 * np.pi))
    ends = np.bincount(quads.ravel()[mesh.opp[: 4 * m] == NONE], minlength=n)
    mesh.degree[:n][(ends > 1) | (mesh.degree[:n] > MOST_GIVEN)] = PINNED
    return mesh


def compact(mesh: Halfedges, kept: int) -> tuple[Floats, Ints]:
    """(n, 2) vertices and (m, 4) quads without the dead ones; the first ``kept`` vertices stay in place."""
    quads = mesh.quads[: mesh.counts[QUADS]]
    quads = quads[quads[:, 0] != NONE]
    alive = mesh.degree[: mesh.counts[VERTICES]] > 0
    alive[:kept] = True
    return mesh.xy[: len(alive)][alive], (np.cumsum(alive) - 1)[quads]
