r"""The filling that always exists: new points on the diagonals of a triangulation.

**Theorem.** Every weakly simple ring of n vertices, n even, has a filling with strictly convex quadrilaterals that
leaves its edges whole: at most 3 (n - 2) of them.

A triangulation by diagonals has n - 2 triangles, an even number; its dual is a tree. A diagonal is *odd* when it has
an odd number of triangles on each side, else *even*. Put one point on every odd diagonal and two on every even one.
As the triangles on the far sides of a triangle's diagonals are odd in number, it has one or three odd diagonals:

    leaf             passage                    passage, branch                 three odd
    1 odd            1 odd, 1 even              1 odd, 1 or 2 even              diagonals

         o                o                            o                             o
        / \              / \                          / \                           / \
       /   \            o   \                        o   o                         /   \
      o     o          /  .  o                      / \ / \                       o     o
     /       \        o .     \                    o   c   \                     /  \ /  \
    o---------o      o---------o                  o----|----o                   o----c----o
                                                       o                             |

A triangle with its points is a ring of 4, 6 or 8 vertices, all upon the boundary of a triangle. Cut it by chords
between its vertices or by spokes from a point c inside to every other vertex (``CUTS``): a piece is convex, and
strictly so but for points on a side that it has as flat corners, those that no chord or spoke *holds* in this triangle.

 1. Leaves hold nothing. Every other triangle holds the point of each of its odd diagonals.
 2. Of an even diagonal's two points a triangle can hold either one, whatever it holds on the other sides: the keys
    of ``CUTS`` and the spokes are all the cases. Let one triangle hold the one and the other triangle the other.
 3. So every point is held on at least one side, but for the one between two leaves (n = 4). That diagonal gets three
    points: one leaf holds the outer two, the other leaf the middle one.
 4. Move every point held on one side only a little into the triangle that holds it. There it was part of strictly
    convex corners, which a small move keeps; beyond the diagonal its flat corner becomes strictly convex.

A leaf has 1 piece, a passage at most 3, a branch of one odd and two even diagonals 4, one of three odd ones 3. There
are two leaves more than branches, hence at most 3 n - 10 pieces; for n = 4, five.
"""

from __future__ import annotations

import numpy as np

from envs.filling.fitness import DUBIOUS, fitnesses
from envs.types import Floats, Ints

#: How a ring of 6 or 8 vertices is cut by chords that hold the vertices of the key, which number the ring from the
#: corner before an odd diagonal, so that its point is vertex 1. For other keys, all odd, spokes go to the odd vertices.
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
#: Halvings of the move after which it is lost in rounding.
HALVINGS = 60


def by_diagonals(xy: Floats, triangles: Ints, across: Ints) -> tuple[Floats, Ints] | None:
    """Fill a ring from its triangulation.

    Args:
        xy: (n, 2) float64, n even.
        triangles: (n - 2, 3) int64 places in the ring.
        across: (n - 2, 3) int64 the triangle across each side.

    Returns:
        (s, 2) float64 new points and (m, 4) int64 quadrilaterals, in which n + i is new point i. None where rounding
        leaves no room for a strictly convex one.
    """
    n = len(xy)
    sides = Sides(xy, triangles, across)
    pieces: list[tuple[int, int, int, int]] = []
    owner: list[int] = []
    spokes: list[list[int]] = []
    centre = n + len(sides.base)
    for t in range(len(triangles)):
        ring, held = sides.ring(t)
        cut = CUTS.get(held)
        if cut is None:
            around = range(1, len(ring), 2)
            pieces += [(centre, ring[i - 2], ring[i - 1], ring[i]) for i in around]
            spokes.append([ring[i] for i in around])
            owner += [t] * len(around)
            centre += 1
        else:
            pieces += [(ring[a], ring[b], ring[c], ring[d]) for a, b, c, d in cut]
            owner += [t] * len(cut)
    quads = np.array(pieces, dtype=np.int64)
    base, move = np.array(sides.base).reshape(-1, 2), np.array(sides.move).reshape(-1, 2)
    of_triangle = np.array(owner)
    for least in (DUBIOUS, 0.0):
        share = np.full(len(base), FIRST_MOVE)
        for _ in range(HALVINGS):
            points = np.concatenate([xy, base + share[:, None] * move])
            if spokes:
                points = np.concatenate([points, [points[ends].mean(axis=0) for ends in spokes]])
            flat = fitnesses(points, quads) <= least
            if not flat.any():
                return points[n:], quads
            crowded = np.unique(np.concatenate([sides.points_of(t) for t in np.unique(of_triangle[flat])]))
            share[crowded - n] *= 0.5
    return None


class Sides:
    """The new points on the diagonals, and which triangle holds which.

    Attributes:
        base: positions on the diagonals.
        move: for each point, the way to the corner that it moves towards; zero where both triangles hold it.
    """

    def __init__(self, xy: Floats, triangles: Ints, across: Ints) -> None:
        self.xy, self.triangles, self.across = xy, triangles, across
        self.base: list[Floats] = []
        self.move: list[Floats] = []
        # By triangle and side: the points from corner k to corner k + 1, and those of them that the triangle holds.
        self.points: dict[tuple[int, int], list[int]] = {}
        self.held: dict[tuple[int, int], list[int]] = {}
        for t, k in np.argwhere(across > np.arange(len(triangles))[:, None]).tolist():
            u = int(across[t, k])
            self.divide(t, k, u, across[u].tolist().index(t))

    def divide(self, t: int, k: int, u: int, m: int) -> None:
        """Put points on the diagonal that is side k of triangle t and side m of triangle u."""
        if self.odd(t, k):
            lone = [self.is_leaf(t), self.is_leaf(u)]
            count, first, second = {
                (False, False): (1, [0], [0]),
                (True, False): (1, [], [0]),
                (False, True): (1, [0], []),
                (True, True): (3, [0, 2], [1]),
            }[lone[0], lone[1]]
        else:
            # Away from the odd side a passage or a branch needs no spokes.
            place = 1 if self.touches_odd(t, k) else 0
            count, first, second = 2, [place], [1 - place]
        numbers = [len(self.xy) + len(self.base) + i for i in range(count)]
        start, end = self.xy[self.triangles[t, k]], self.xy[self.triangles[t, (k + 1) % 3]]
        into_t, into_u = self.xy[self.triangles[t, (k + 2) % 3]], self.xy[self.triangles[u, (m + 2) % 3]]
        for i in range(count):
            here = start + (end - start) * ((i + 1) / (count + 1))
            self.base.append(here)
            self.move.append(((i in first) * (into_t - here) if i not in second else (i not in first) * (into_u - here)))
        self.points[t, k], self.held[t, k] = numbers, [numbers[i] for i in first]
        self.points[u, m], self.held[u, m] = numbers[::-1], [numbers[i] for i in second]

    def odd(self, t: int, k: int) -> bool:
        """Whether side k of triangle t is an odd diagonal: an even stretch of the ring runs between its ends."""
        return bool(self.across[t, k] >= 0 and (self.triangles[t, k] - self.triangles[t, (k + 1) % 3]) % 2 == 0)

    def is_leaf(self, t: int) -> bool:
        """Whether triangle t has one diagonal only."""
        return int((self.across[t] >= 0).sum()) == 1

    def touches_odd(self, t: int, k: int) -> bool:
        """Whether the odd diagonal of triangle t starts from the first corner of its even side k."""
        return self.odd(t, (k + 2) % 3)

    def ring(self, t: int) -> tuple[list[int], tuple[int, ...]]:
        """The corners and points around triangle t from before an odd diagonal on, and the places of those it holds."""
        first = next(k for k in range(3) if self.odd(t, k))
        ring: list[int] = []
        held: list[int] = []
        for k in (first, (first + 1) % 3, (first + 2) % 3):
            ring += [int(self.triangles[t, k]), *self.points.get((t, k), [])]
            held += self.held.get((t, k), [])
        return ring, tuple(sorted(ring.index(v) for v in held))

    def points_of(self, t: int) -> list[int]:
        """The new points on the sides of triangle t."""
        return [v for k in range(3) for v in self.points.get((t, k), [])]
