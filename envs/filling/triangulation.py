r"""A ring cut into triangles by its own diagonals: ears first, then flips that raise the worse of two triangles.

Vertices are named by their place in the ring, so the two sides of a seam stay apart although they are the same points.

    c------b        c------b
    |    / |        | \    |      a flip: of the two diagonals of a strictly convex pair of triangles
    |  /   |   ->   |   \  |      the better one stays
    a------d        a------d
"""

from __future__ import annotations

import math

import numpy as np

from envs.kernels.geometry import distance2_to_segment
from envs.kernels.jit import compiled, inlined
from envs.kernels.orientation import turns_left
from envs.types import Floats, Ints

#: Share by which a flip has to raise the worse triangle, so that rounding cannot flip for ever.
GAIN = 1e-6

#: Distance from a diagonal, as a share of its length, within which another vertex as good as lies on it: points on one
#: line, but for rounding. A ring cut there has pieces without area.
NEAR = 1e-6


@inlined
def triangle_quality(xy: Floats, a: int, b: int, c: int) -> float:
    """Twice the area over the sum of the squared sides, > 0; -1 for a triangle that is not certainly positive."""
    ax, ay, bx, by, cx, cy = xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]
    if not turns_left(ax, ay, bx, by, cx, cy):
        return -1.0
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    return area / ((bx - ax) ** 2 + (by - ay) ** 2 + (cx - bx) ** 2 + (cy - by) ** 2 + (ax - cx) ** 2 + (ay - cy) ** 2)


@inlined
def same(xy: Floats, i: int, j: int) -> bool:
    """Whether two places of the ring are one point."""
    return xy[i, 0] == xy[j, 0] and xy[i, 1] == xy[j, 1]


@inlined
def ear(xy: Floats, following: Ints, a: int, b: int, c: int) -> float:
    """What the ear a, b, c is worth: its quality, and next to nothing where it leaves another vertex all but on a - c.

    -1 where b is no ear: not convex, or another vertex in or on the triangle.
    """
    value = triangle_quality(xy, a, b, c)
    if value <= 0.0:
        return -1.0
    ax, ay, bx, by, cx, cy = xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]
    near2 = NEAR * NEAR * ((cx - ax) ** 2 + (cy - ay) ** 2)
    closest2 = near2
    d = following[c]
    while d != a:
        x, y = xy[d, 0], xy[d, 1]
        if not (same(xy, d, a) or same(xy, d, b) or same(xy, d, c)):
            if not (
                turns_left(bx, by, ax, ay, x, y) or turns_left(cx, cy, bx, by, x, y) or turns_left(ax, ay, cx, cy, x, y)
            ):
                return -1.0
            closest2 = min(closest2, distance2_to_segment(x, y, ax, ay, cx, cy))
        d = following[d]
    return value * math.sqrt(closest2 / near2)


def ears(xy: Floats) -> Ints:
    """The triangles of ear clipping, the best ear first: (n - 2, 3), or fewer where rounding hides the next ear."""
    n = len(xy)
    triangles = np.empty((n - 2, 3), dtype=np.int64)
    following, preceding = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    return triangles[: _ears(xy, triangles, following, preceding, np.empty(n))]


@compiled
def _ears(xy: Floats, triangles: Ints, following: Ints, preceding: Ints, value: Floats) -> int:
    """Write the ears into ``triangles``, (n - 2, 3) int64; how many there are. The rest is (n,) memory."""
    n = len(xy)
    for i in range(n):
        following[i] = i + 1 if i + 1 < n else 0
        preceding[i] = i - 1 if i > 0 else n - 1
    for i in range(n):
        value[i] = ear(xy, following, preceding[i], i, following[i])
    for k in range(n - 2):
        b = 0
        for i in range(1, n):
            if value[i] > value[b]:
                b = i
        if value[b] <= 0.0:
            return k
        a, c = preceding[b], following[b]
        triangles[k, 0], triangles[k, 1], triangles[k, 2] = a, b, c
        following[a], preceding[c] = c, a
        value[b] = -2.0
        value[a] = ear(xy, following, preceding[a], a, c)
        value[c] = ear(xy, following, a, c, following[c])
    return n - 2


def neighbours(triangles: Ints, n: int) -> Ints:
    """(t, 3) int64: the triangle across each side, from corner k to corner k + 1; -1 across the ring's edges."""
    ahead = np.roll(triangles, -1, axis=1)
    key, wanted = (triangles * n + ahead).ravel(), (ahead * n + triangles).ravel()
    order = np.argsort(key)
    found = order[np.minimum(np.searchsorted(key[order], wanted), len(key) - 1)]
    return np.where(key[found] == wanted, found // 3, -1).reshape(-1, 3)


@inlined
def relink(across: Ints, triangle: int, old: int, new: int) -> None:
    """Name the neighbour ``old`` of a triangle ``new``."""
    if triangle >= 0:
        for k in range(3):
            if across[triangle, k] == old:
                across[triangle, k] = new


@compiled
def flip(xy: Floats, triangles: Ints, across: Ints) -> None:
    """Flip diagonals, in place, until no flip raises the worse of its two triangles."""
    flipped = True
    while flipped:
        flipped = False
        for t in range(len(triangles)):
            for k in range(3):
                u = across[t, k]
                if u < t:
                    continue
                a, b, c = triangles[t, k], triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
                m = 0
                while triangles[u, m] != b:
                    m += 1
                d = triangles[u, (m + 2) % 3]
                before = min(triangle_quality(xy, a, b, c), triangle_quality(xy, b, a, d))
                if min(triangle_quality(xy, a, d, c), triangle_quality(xy, d, b, c)) <= before * (1.0 + GAIN):
                    continue
                ad, db = across[u, (m + 1) % 3], across[u, (m + 2) % 3]
                bc, ca = across[t, (k + 1) % 3], across[t, (k + 2) % 3]
                triangles[t, 0], triangles[t, 1], triangles[t, 2] = a, d, c
                triangles[u, 0], triangles[u, 1], triangles[u, 2] = d, b, c
                across[t, 0], across[t, 1], across[t, 2] = ad, u, ca
                across[u, 0], across[u, 1], across[u, 2] = db, bc, t
                relink(across, ad, u, t)
                relink(across, bc, t, u)
                flipped = True
                break


def triangulate(xy: Floats) -> tuple[Ints, Ints] | None:
    """Triangles of a weakly simple counter-clockwise ring.

    Args:
        xy: (n, 2) float64, n >= 3.

    Returns:
        (n - 2, 3) int64 places in the ring, counter-clockwise, and (n - 2, 3) int64 the triangle across each side,
        -1 for none. None where no ear is certain: the ring is not weakly simple, or too thin for its coordinates.
    """
    triangles = ears(xy)
    if len(triangles) < len(xy) - 2:
        return None
    across = neighbours(triangles, len(xy))
    flip(xy, triangles, across)
    return triangles, across
