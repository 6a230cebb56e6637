"""What a patch is filled with: rows along its loop, rectangles, stars, and cuts into two of those.

Vertices are numbered from 0: those of the loop first, counter-clockwise, then those around the hole in the patch, if
it has one, clockwise, then the new ones. Each gets a first place. Fillings around a hole: `annulus`.

    rows           one element deep all round; a corner of the loop stays a corner of the loop inside
    rectangle      four corners on an even loop, opposite sides equally long: a x b elements, no irregular vertex
    star           three or five corners: as many rectangles around one irregular vertex
    cut            a path from one vertex of the loop to another, and a rectangle or a star on either side; where it
                   ends in a reflex corner, one of the two may go straight on there, which gives that three elements
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from envs.kernels.jit import inlined, inner
from envs.types import Floats, Ints
from freemesh_ray.finish.halfedges import Halfedges
from freemesh_ray.finish.refill.growth import LOOP, OUTER, Growth, target

#: Corners of a loop, at most; a patch with more is not filled.
CORNERS = 64
#: A vertex of the loop that should have fewer elements of the patch than this is a corner.
CORNER = 1.5
#: A new row is not further away than this many times the edge length, however sharp the loop turns.
OFFSET = 3.3

# Rows of Filling.sides, each from left to right or upwards.
_BOTTOM, _RIGHT, _TOP, _LEFT = range(4)
#: What a cut may be at its ends; see `cut`.
CORNERED, FLAT_FIRST, FLAT_SECOND = range(3)
# Entries of Filling.counts.
QUADS, VERTICES, LENGTH, CORNER_COUNT, HOLE = range(5)


class Filling(NamedTuple):
    """Working memory.

    Attributes:
        xy: (N, 2) float64, where the vertices are.
        quads: (Q, 4) int64, counter-clockwise.
        loop, next_loop: (R,) int64, the vertices around what is still empty.
        hole: (R,) int64, the vertices around the hole in it, with what is empty on their left, too.
        corners, next_corners: (CORNERS,) int64, where on the loop its corners are, in order.
        role, partner: (R,) int64, of each vertex of the loop: whether it is a corner; the vertex beside it inside.
        sides: (4, R) int64, the vertices on the sides of a rectangle.
        spokes: (5, R) int64, those from a star's sides to its middle.
        piece: (R,) int64, the vertices around one side of a cut.
        piece_corners: (8,) int64, where its corners are.
        lengths, before_spoke: (8,) int64, of each side of a star: its elements; those before its spoke.
        counts: (5,) int64: elements, vertices, vertices of the loop, corners, vertices around the hole.
    """

    xy: Floats
    quads: Ints
    loop: Ints
    next_loop: Ints
    hole: Ints
    corners: Ints
    next_corners: Ints
    role: Ints
    partner: Ints
    sides: Ints
    spokes: Ints
    piece: Ints
    piece_corners: Ints
    lengths: Ints
    before_spoke: Ints
    counts: Ints


def filling_of(elements: int) -> Filling:
    """Room for so many elements."""
    room = 2 * elements + 16

    def ints(*shape: int) -> Ints:
        return np.zeros(shape, dtype=np.int64)

    return Filling(
        xy=np.zeros((2 * room, 2)), quads=ints(elements, 4), loop=ints(room), next_loop=ints(room), hole=ints(room),
        corners=ints(CORNERS), next_corners=ints(CORNERS), role=ints(room), partner=ints(room), sides=ints(4, room),
        spokes=ints(5, room), piece=ints(room), piece_corners=ints(8), lengths=ints(8), before_spoke=ints(8),
        counts=ints(5),
    )  # fmt: skip


@inner
def begin(mesh: Halfedges, growth: Growth, filling: Filling) -> bool:
    """Begin with the loops around a patch; False when the outer one has too many corners."""
    n, outer, corners = growth.counts[LOOP], growth.counts[OUTER], 0
    for i in range(n):
        v = growth.loop[i]
        filling.xy[i, 0], filling.xy[i, 1] = mesh.xy[v, 0], mesh.xy[v, 1]
        if i >= outer:
            filling.hole[i - outer] = i
            continue
        filling.loop[i] = i
        if target(mesh, growth, v) < CORNER:
            if corners == CORNERS:
                return False
            filling.corners[corners] = i
            corners += 1
    filling.counts[QUADS], filling.counts[VERTICES] = 0, n
    filling.counts[LENGTH], filling.counts[CORNER_COUNT], filling.counts[HOLE] = outer, corners, n - outer
    return True


@inner
def edge_length(filling: Filling, loop: Ints, n: int) -> float:
    """The mean length of the edges of a loop of n vertices."""
    total, xy = 0.0, filling.xy
    for i in range(n):
        a, b = loop[i], loop[(i + 1) % n]
        total += math.sqrt((xy[b, 0] - xy[a, 0]) ** 2 + (xy[b, 1] - xy[a, 1]) ** 2)
    return total / n


@inlined
def quad(filling: Filling, a: int, b: int, c: int, d: int) -> None:
    at = filling.counts[QUADS]
    filling.quads[at, 0], filling.quads[at, 1], filling.quads[at, 2], filling.quads[at, 3] = a, b, c, d
    filling.counts[QUADS] = at + 1


@inlined
def _vertex(filling: Filling, x: float, y: float) -> int:
    at = filling.counts[VERTICES]
    filling.xy[at, 0], filling.xy[at, 1] = x, y
    filling.counts[VERTICES] = at + 1
    return at


@inner
def rows_fit(filling: Filling) -> bool:
    """Whether a row fits along the loop: its sides are at least three elements long."""
    n, corners = filling.counts[LENGTH], filling.counts[CORNER_COUNT]
    for k in range(corners):
        ahead = filling.corners[(k + 1) % corners] - filling.corners[k]
        if (ahead % n if corners > 1 else n) < 3:
            return False
    return n - 2 * corners >= 4


@inner
def beside(filling: Filling, a: int, v: int, b: int, h: float) -> int:
    """A new vertex inside, h away from vertex v of a loop, between a and b."""
    xy = filling.xy
    x1, y1, x2, y2 = xy[v, 0] - xy[a, 0], xy[v, 1] - xy[a, 1], xy[b, 0] - xy[v, 0], xy[b, 1] - xy[v, 1]
    per1 = 1.0 / max(1e-300, math.sqrt(x1 * x1 + y1 * y1))
    per2 = 1.0 / max(1e-300, math.sqrt(x2 * x2 + y2 * y2))
    nx, ny = -y1 * per1 - y2 * per2, x1 * per1 + x2 * per2
    share = h * min(OFFSET, 1.0 / max(1e-300, math.sqrt(nx * nx + ny * ny)))
    return _vertex(filling, xy[v, 0] + share * nx, xy[v, 1] + share * ny)


@inner
def row(filling: Filling, h: float) -> None:
    """Lay a row of elements, about h wide, along the loop; the loop is then the one inside it."""
    n, corners = filling.counts[LENGTH], filling.counts[CORNER_COUNT]
    loop, role, partner, xy = filling.loop, filling.role, filling.partner, filling.xy
    for i in range(n):
        role[i] = 0
    for k in range(corners):
        role[filling.corners[k]] = 1
    start = filling.corners[0] if corners > 0 else 0
    inside = k = 0
    for step in range(n):
        i = (start + step) % n
        before, after = (i + n - 1) % n, (i + 1) % n
        if role[i] == 1:
            a, v, b = loop[before], loop[i], loop[after]
            partner[i] = _vertex(filling, xy[a, 0] + xy[b, 0] - xy[v, 0], xy[a, 1] + xy[b, 1] - xy[v, 1])
            filling.next_corners[k] = inside
            k += 1
        elif role[before] == 1 or role[after] == 1:
            continue
        else:
            partner[i] = beside(filling, loop[before], loop[i], loop[after], h)
        filling.next_loop[inside] = partner[i]
        inside += 1
    for i in range(n):
        before, after = (i + n - 1) % n, (i + 1) % n
        if role[i] == 0 and role[before] == 1:
            partner[i] = partner[before]
        elif role[i] == 0 and role[after] == 1:
            partner[i] = partner[after]
    for i in range(n):
        before, after = (i + n - 1) % n, (i + 1) % n
        if role[i] == 1:
            quad(filling, loop[i], loop[after], partner[i], loop[before])
        elif role[after] == 0:
            quad(filling, loop[i], loop[after], partner[after], partner[i])
    for i in range(inside):
        loop[i] = filling.next_loop[i]
    for k in range(corners):
        filling.corners[k] = filling.next_corners[k]
    filling.counts[LENGTH] = inside


@inlined
def _node(filling: Filling, first: int, a: int, b: int, i: int, j: int) -> int:
    """The vertex in column i of row j of a rectangle whose vertices inside begin with ``first``."""
    if j == 0:
        return filling.sides[_BOTTOM, i]
    if j == b:
        return filling.sides[_TOP, i]
    if i == 0:
        return filling.sides[_LEFT, j]
    if i == a:
        return filling.sides[_RIGHT, j]
    return first + (j - 1) * (a - 1) + i - 1


@inner
def _grid(filling: Filling, a: int, b: int) -> None:
    """Fill between the four sides; vertices inside blend opposite sides (Coons)."""
    xy, first = filling.xy, filling.counts[VERTICES]
    bottom, right, top, left = filling.sides[0], filling.sides[1], filling.sides[2], filling.sides[3]
    for j in range(1, b):
        t = j / b
        for i in range(1, a):
            s = i / a
            for axis in range(2):
                across = (1.0 - t) * xy[bottom[i], axis] + t * xy[top[i], axis]
                along = (1.0 - s) * xy[left[j], axis] + s * xy[right[j], axis]
                low = (1.0 - s) * xy[bottom[0], axis] + s * xy[bottom[a], axis]
                high = (1.0 - s) * xy[top[0], axis] + s * xy[top[a], axis]
                xy[filling.counts[VERTICES], axis] = across + along - (1.0 - t) * low - t * high
            filling.counts[VERTICES] += 1
    for j in range(b):
        for i in range(a):
            quad(
                filling, _node(filling, first, a, b, i, j), _node(filling, first, a, b, i + 1, j),
                _node(filling, first, a, b, i + 1, j + 1), _node(filling, first, a, b, i, j + 1),
            )  # fmt: skip


@inner
def rectangle(filling: Filling, loop: Ints, n: int, p: int, a: int) -> None:
    """Fill an even loop of n vertices by a rectangle, the first of its sides a elements long from place p on."""
    b = (n >> 1) - a
    for i in range(a + 1):
        filling.sides[_BOTTOM, i] = loop[(p + i) % n]
        filling.sides[_TOP, i] = loop[(p + (n >> 1) + a - i) % n]
    for j in range(b + 1):
        filling.sides[_RIGHT, j] = loop[(p + a + j) % n]
        filling.sides[_LEFT, j] = loop[(p + n - j) % n]
    _grid(filling, a, b)


@inner
def spokes_of(lengths: Ints, n: int, before_spoke: Ints) -> bool:
    """Where on each side of a star its spoke begins: side i is u_i + u_(i+2) long; False when there is no star."""
    for i in range(n):
        total, sign, k = 0, 1, i
        for _ in range(n):
            total += sign * lengths[k]
            sign, k = -sign, (k + 2) % n
        if total <= 1 or total & 1:
            return False
        before_spoke[i] = total >> 1
    return True


@inner
def _star(filling: Filling, loop: Ints, n: int, corners: Ints, count: int) -> None:
    """Fill a loop of n vertices by a star with three or five corners."""
    lengths, u, xy = filling.lengths, filling.before_spoke, filling.xy
    for i in range(count):
        lengths[i] = (corners[(i + 1) % count] - corners[i] + n) % n
    spokes_of(lengths, count, u)
    x = y = 0.0
    for i in range(count):
        start = loop[(corners[i] + u[i]) % n]
        x, y = x + xy[start, 0] / count, y + xy[start, 1] / count
    middle = _vertex(filling, x, y)
    for i in range(count):
        start, length = loop[(corners[i] + u[i]) % n], u[(i + 1) % count]
        filling.spokes[i, 0], filling.spokes[i, length] = start, middle
        for k in range(1, length):
            s = k / length
            filling.spokes[i, k] = _vertex(filling, (1.0 - s) * xy[start, 0] + s * x, (1.0 - s) * xy[start, 1] + s * y)
    for i in range(count):
        last = (i + count - 1) % count
        a, b = u[i], u[(i + 1) % count]
        for k in range(a + 1):
            filling.sides[_BOTTOM, k] = loop[(corners[i] + k) % n]
            filling.sides[_TOP, k] = filling.spokes[last, k]
        for k in range(b + 1):
            filling.sides[_RIGHT, k] = filling.spokes[i, k]
            filling.sides[_LEFT, k] = loop[(corners[i] + n - k) % n]
        _grid(filling, a, b)


@inner
def shape(filling: Filling, loop: Ints, n: int, corners: Ints, count: int) -> None:
    """Fill a loop by a rectangle or a star between its corners."""
    if count == 4:
        rectangle(filling, loop, n, corners[0], corners[1] - corners[0])
    else:
        _star(filling, loop, n, corners, count)


@inner
def toggled_star(filling: Filling, toggled: int) -> None:
    """Fill the loop by a star whose corners are the loop's, but for one place that is added or left out; -1: none."""
    count, found = 0, False
    for k in range(filling.counts[CORNER_COUNT]):
        corner = filling.corners[k]
        if corner == toggled:
            found = True
            continue
        if toggled != -1 and not found and toggled < corner:
            filling.piece_corners[count] = toggled
            count, found = count + 1, True
        filling.piece_corners[count] = corner
        count += 1
    if toggled != -1 and not found:
        filling.piece_corners[count] = toggled
        count += 1
    _star(filling, filling.loop, filling.counts[LENGTH], filling.piece_corners, count)


@inner
def _one_side(filling: Filling, p: int, q: int, path: int, edges: int, forth: bool, flat_p: bool, flat_q: bool) -> None:
    """Fill the side of a cut from place p to place q of the loop; ``path`` is the first of its vertices inside.

    Both ends are corners of it, unless they are flat.
    """
    n, corner = filling.counts[LENGTH], 0
    d = (q - p + n) % n
    for k in range(d + 1):
        filling.piece[k] = filling.loop[(p + k) % n]
    for k in range(edges - 1):
        filling.piece[d + 1 + k] = path + (k if forth else edges - 2 - k)
    if not flat_p:
        filling.piece_corners[0], corner = 0, 1
    for step in range(1, d):
        at = (p + step) % n
        for k in range(filling.counts[CORNER_COUNT]):
            if filling.corners[k] == at:
                filling.piece_corners[corner] = step
                corner += 1
    if not flat_q:
        filling.piece_corners[corner] = d
        corner += 1
    shape(filling, filling.piece, d + edges, filling.piece_corners, corner)


@inner
def cut(filling: Filling, p: int, q: int, edges: int, at_p: int, at_q: int) -> None:
    """Cut the loop by a path of so many edges from place p to place q, and fill either side.

    Args:
        filling: empty but for the loop.
        p, q: places that are no corners of the loop.
        edges: of the path.
        at_p, at_q: whether both sides have a corner there, ``CORNERED``; or the one on the loop from p to q goes
            straight on, ``FLAT_FIRST``; or the other one, ``FLAT_SECOND``.
    """
    first, xy = filling.counts[VERTICES], filling.xy
    start, end = filling.loop[p], filling.loop[q]
    for k in range(1, edges):
        s = k / edges
        _vertex(filling, (1.0 - s) * xy[start, 0] + s * xy[end, 0], (1.0 - s) * xy[start, 1] + s * xy[end, 1])
    _one_side(filling, p, q, first, edges, False, at_p == FLAT_FIRST, at_q == FLAT_FIRST)
    _one_side(filling, q, p, first, edges, True, at_q == FLAT_SECOND, at_p == FLAT_SECOND)
