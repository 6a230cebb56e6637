r"""The filling that always exists: new points on the diagonals of a triangulation.

**Theorem.** Every weakly simple ring of n vertices, n even, has a filling with strictly convex quadrilaterals that
leaves its edges whole; 3 (n - 2) of them are enough.

A triangulation by diagonals has n - 2 triangles, an even number, and its dual is a tree. A diagonal is *odd* when an
odd number of triangles lies on each side of it, else *even*. Put one point on every odd diagonal and two on every even
one. Beyond the diagonals of a triangle lie n - 3 triangles, an odd number, so one or three of its diagonals are odd::

         leaf                  passage                  branch                  branch
     one odd diagonal       one odd, one even      one odd, two even        three odd ones

            o                      o                       o                       o
           / \                    / \                     / \                     / \
          /   \                  /   o                   o   o                   /   \
         /     m                m . . \                 / . . \                 m     m
        /       \              / .     o               o  . .  o               / .   . \
       /         \            / .       \             /    .    \             /    c    \
      o-----------o          o-----------o           o-----m-----o           o-----m-----o

A triangle with its points is a ring of 4, 6 or 8 vertices. Cut it by chords between them (``CUTS``), or by spokes to
every other one of them from their mean c. All of them lie on the boundary of a triangle, so every piece is convex;
strictly, but for flat corners at points that no chord or spoke *holds* in this triangle.

 1. Leaves hold nothing. Every other triangle holds the points of its odd diagonals.
 2. Of an even diagonal's points a triangle can hold either one, whatever it holds elsewhere: with the spokes, ``CUTS``
    has all the cases. Let the triangle on one side hold the one, and that on the other side the other.
 3. So every point is held on one side at least, but for the one between two leaves (n = 4). That diagonal gets three
    points: one leaf holds the outer two, the other leaf the middle one.
 4. Move every point held on one side only a little into the triangle that holds it. There all its corners are strictly
    convex, and stay so if the move is small; beyond the diagonal its flat corner becomes strictly convex.

A leaf is 1 piece, a passage at most 3, a branch at most 4; there are two leaves more than branches. That makes
at most 3 n - 10 pieces for n >= 6, and 5 for n = 4.
"""

from __future__ import annotations

import numpy as np

from envs.filling.fitness import DUBIOUS, fitnesses
from envs.types import Floats, Ints

#: Chords that cut a triangle's ring, by the places it holds. The ring starts at the corner before an odd diagonal,
#: whose point is thus vertex 1. Where the places held are no key they are odd, and spokes go to all odd vertices.
CUTS: dict[tuple[int, ...], tuple[tuple[int, int, int, int], ...]] = {
    (): ((0, 1, 2, 3),),
    (1, 4): ((1, 2, 3, 4), (4, 5, 0, 1)),
    (1, 4, 6): ((1, 2, 3, 4), (1, 4, 5, 6), (1, 6, 7, 0)),
    (1, 3, 6): ((1, 2, 3, 6), (3, 4, 5, 6), (1, 6, 7, 0)),
    (1, 4, 7): ((1, 2, 3, 4), (4, 5, 6, 7), (1, 4, 7, 0)),
    (2,): ((2, 3, 4, 5), (5, 0, 1, 2)),
}

#: How far a point moves at first, as a share of the way to the opposite corner.
FIRST_MOVE = 0.2
#: Halvings after which a move is lost in rounding.
HALVINGS = 60


class Division:
    """The new points on the diagonals of a triangulation, and which triangle holds which.

    Attributes:
        base: positions on the diagonals.
        move: for each, the way to the corner that it moves towards; zero where both triangles hold it.
        points: by triangle t and side k, the points from corner k to corner k + 1, numbered from n on.
        held: by triangle and side, those of them that the triangle holds.
    """

    def __init__(self, xy: Floats, triangles: Ints, across: Ints) -> None:
        """Divide all diagonals; the arguments are those of :func:`by_diagonals`."""
        self.xy, self.triangles, self.across = xy, triangles, across
        self.base: list[Floats] = []
        self.move: list[Floats] = []
        self.points: dict[tuple[int, int], list[int]] = {}
        self.held: dict[tuple[int, int], list[int]] = {}
        for t, k in np.argwhere(across > np.arange(len(triangles))[:, None]).tolist():
            u = int(across[t, k])
            self.divide(t, k, u, across[u].tolist().index(t))

    def divide(self, t: int, k: int, u: int, m: int) -> None:
        """Put points on the diagonal that is side k of triangle t and side m of triangle u."""
        ours, theirs = self.shares(t, k, u)
        count = max(ours + theirs) + 1
        first = len(self.xy) + len(self.base)
        start, end, our_corner = self.xy[np.roll(self.triangles[t], -k)]
        their_corner = self.xy[self.triangles[u, (m + 2) % 3]]
        for i in range(count):
            here = start + (end - start) * ((i + 1) / (count + 1))
            goal = here
            if (i in ours) != (i in theirs):
                goal = our_corner if i in ours else their_corner
            self.base.append(here)
            self.move.append(goal - here)
        numbers = list(range(first, first + count))
        self.points[t, k], self.held[t, k] = numbers, [first + i for i in ours]
        self.points[u, m], self.held[u, m] = numbers[::-1], [first + i for i in theirs]

    def shares(self, t: int, k: int, u: int) -> tuple[list[int], list[int]]:
        """Which points of side k, counted from its start, triangle t holds, and which the triangle u beyond it."""
        if not self.is_odd(t, k):
            # A triangle that holds the point away from its odd diagonal often needs no spokes.
            away = 1 if self.is_odd(t, (k + 2) % 3) else 0
            return [away], [1 - away]
        if self.is_leaf(t) and self.is_leaf(u):
            return [0, 2], [1]
        return ([] if self.is_leaf(t) else [0]), ([] if self.is_leaf(u) else [0])

    def is_odd(self, t: int, k: int) -> bool:
        """Whether side k of triangle t is an odd diagonal: an even number of the ring's edges lies beyond it."""
        return bool(self.across[t, k] >= 0 and (self.triangles[t, k] - self.triangles[t, (k + 1) % 3]) % 2 == 0)

    def is_leaf(self, t: int) -> bool:
        """Whether triangle t has one diagonal only."""
        return int((self.across[t] >= 0).sum()) == 1

    def ring(self, t: int) -> tuple[list[int], tuple[int, ...]]:
        """The corners and points around triangle t from before an odd diagonal on, and the places of those held."""
        first = next(k for k in range(3) if self.is_odd(t, k))
        ring: list[int] = []
        held: list[int] = []
        for k in (first, (first + 1) % 3, (first + 2) % 3):
            ring += [int(self.triangles[t, k]), *self.points.get((t, k), [])]
            held += self.held.get((t, k), [])
        return ring, tuple(sorted(ring.index(v) for v in held))

    def around(self, t: int) -> list[int]:
        """The new points on the sides of triangle t."""
        return [v for k in range(3) for v in self.points.get((t, k), [])]


def by_diagonals(xy: Floats, triangles: Ints, across: Ints) -> tuple[Floats, Ints] | None:
    """Fill a ring from its triangulation.

    Args:
        xy: (n, 2) float64, n even.
        triangles: (n - 2, 3) int64 places in the ring, counter-clockwise.
        across: (n - 2, 3) int64 the triangle across the side from corner k to corner k + 1, -1 for none.

    Returns:
        (s, 2) float64 new points and (m, 4) int64 quadrilaterals, in which n + i is new point i. None where rounding
        leaves no room for a strictly convex one.
    """
    division = Division(xy, triangles, across)
    pieces: list[tuple[int, int, int, int]] = []
    owner: list[int] = []
    spokes: list[list[int]] = []
    for t in range(len(triangles)):
        ring, held = division.ring(t)
        if held in CUTS:
            cut = [(ring[a], ring[b], ring[c], ring[d]) for a, b, c, d in CUTS[held]]
        else:
            centre = len(xy) + len(division.base) + len(spokes)
            cut = [(centre, ring[i - 2], ring[i - 1], ring[i]) for i in range(1, len(ring), 2)]
            spokes.append(ring[1::2])
        pieces += cut
        owner += [t] * len(cut)
    quads, of_triangle = np.array(pieces, dtype=np.int64), np.array(owner)
    on_diagonals = np.array(division.base), np.array(division.move)
    for least in (DUBIOUS, 0.0):
        share = np.full(len(division.base), FIRST_MOVE)
        for _ in range(HALVINGS):
            points = placed(xy, *on_diagonals, share, spokes)
            poor = fitnesses(points, quads) <= least
            if not poor.any():
                return points[len(xy) :], quads
            crowded = {v for t in set(of_triangle[poor].tolist()) for v in division.around(t)}
            share[np.array(list(crowded)) - len(xy)] *= 0.5
    return None


def placed(xy: Floats, base: Floats, move: Floats, share: Floats, spokes: list[list[int]]) -> Floats:
    """The ring's points, those on diagonals moved by a share of their way, and the means that spokes start from."""
    points = np.concatenate([xy, base + share[:, None] * move])
    return np.concatenate([points, *(points[ends].mean(axis=0)[None] for ends in spokes)])
