"""Seams: zero-width bridges that make one ring of a polygon with holes.

::

    o-------------------------o        o   outer ring, walked counter-clockwise
    |                         |        h   hole, walked clockwise
    |        h-----h          |        s   seam points: once in the points, twice in the ring
    |        |     |          |
    a--s--s--h-----h          |        ... o a s s h h h h s s a o ...
    |                         |
    o-------------------------o

The bridges are edges of a constrained Delaunay triangulation of the polygon: those lie inside and never cross each
other, whatever the number of holes.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

from envs.polygons.rings import oriented
from envs.polygons.turning import signed_angles
from envs.types import Domain, Floats, Ints

#: How many times costlier a bridge is that leaves where another one does.
SHARED_VERTEX = 4.0


@dataclass(frozen=True)
class Bridge:
    """A diagonal that may join two rings: its ends as indices into the points, and its cost (a length)."""

    start: int
    end: int
    cost: float


class Walk:
    """A ring that grows hole by hole: each visit of a vertex knows the next and the one before, so no step takes longer
    the longer the ring is.
    """

    def __init__(self, vertices: Sequence[int]) -> None:
        self.vertex, self.first = list(vertices), 0
        self.ahead = [*range(1, len(self.vertex)), 0]
        self.behind = [len(self.vertex) - 1, *range(len(self.vertex) - 1)]
        #: Visits of each vertex in the order of the walk.
        self.visits: dict[int, list[int]] = {}
        for visit, vertex in enumerate(self.vertex):
            self.visits.setdefault(vertex, []).append(visit)

    def insert(self, before: int, vertices: Sequence[int]) -> None:
        """Walk some vertices before a visit; the first of them is the one visited there."""
        new = list(range(len(self.vertex), len(self.vertex) + len(vertices)))
        self.vertex += vertices
        self.behind += [self.behind[before], *new[:-1]]
        self.ahead += [*new[1:], before]
        self.ahead[self.behind[before]], self.behind[before] = new[0], new[-1]
        self.first = new[0] if self.first == before else self.first
        there = self.visits[vertices[0]]
        there.insert(there.index(before), new[0])
        for visit, vertex in zip(new[1:], vertices[1:], strict=True):
            self.visits.setdefault(vertex, []).append(visit)

    def vertices(self) -> Ints:
        """(n,) the vertices in the order of the walk."""
        order = [self.first]
        while (visit := self.ahead[order[-1]]) != self.first:
            order.append(visit)
        return np.array([self.vertex[visit] for visit in order], dtype=np.int64)


def join(name: str, rings: Sequence[Floats]) -> Domain:
    """One counter-clockwise ring of valid rings: the outer one first, then the holes, in either orientation."""
    turned = [oriented(ring, counterclockwise=h == 0) for h, ring in enumerate(rings)]
    points = np.concatenate(turned)
    starts = np.cumsum([0, *(len(ring) for ring in turned)])
    ring_of = np.repeat(np.arange(len(turned)), [len(ring) for ring in turned])
    following = np.concatenate([np.roll(np.arange(a, b), -1) for a, b in pairwise(starts)])
    segments = np.stack([np.arange(len(points)), following], axis=1).astype(np.int64)
    walk = Walk(range(starts[1]))
    places, local = list(points), local_length(points, following)
    for bridge in chosen_bridges(turned, points, ring_of, following):
        first, last = starts[ring_of[bridge.end]], starts[ring_of[bridge.end] + 1]
        around = np.roll(np.arange(first, last), first - bridge.end).tolist()
        at = corner_facing(places, walk, bridge)
        seam = seam_points(places, local, bridge)
        inner = list(range(len(places), len(places) + len(seam)))
        places += seam
        walk.insert(at, [bridge.start, *inner, *around, bridge.end, *reversed(inner)])
    return Domain(name=name, points=np.array(places), ring=walk.vertices(), segments=segments)


def chosen_bridges(rings: Sequence[Floats], points: Floats, ring_of: Ints, following: Ints) -> list[Bridge]:
    """One bridge for each hole, from what is already joined, the cheapest first (Prim's tree over the rings)."""
    if len(rings) == 1:
        return []
    candidates = bridge_candidates(rings, points, ring_of, following)
    leaving: list[list[int]] = [[] for _ in rings]
    for i, bridge in enumerate(candidates):
        leaving[ring_of[bridge.start]].append(i)
    joined, taken, chosen = {0}, set[int](), list[Bridge]()

    def cost(i: int) -> float:
        # Two bridges at one vertex would share its angle: only where all others are much worse.
        return candidates[i].cost * (SHARED_VERTEX if candidates[i].start in taken else 1.0)

    waiting = [(cost(i), i) for i in leaving[0]]
    heapq.heapify(waiting)
    while len(joined) < len(rings):
        then, i = heapq.heappop(waiting)
        best = candidates[i]
        if ring_of[best.end] in joined:
            continue
        if cost(i) > then:  # another bridge has left there since
            heapq.heappush(waiting, (cost(i), i))
            continue
        chosen.append(best)
        joined.add(int(ring_of[best.end]))
        taken.update((best.start, best.end))
        for j in leaving[ring_of[best.end]]:
            heapq.heappush(waiting, (cost(j), j))
    return chosen


def corner_facing(points: Sequence[Floats], walk: Walk, bridge: Bridge) -> int:
    """The visit of the walk that the bridge leaves at: the corner at its start that opens towards its end.

    A start that other bridges left before is visited more than once; each visit has its own share of the angle,
    counter-clockwise from the vertex ahead to the vertex behind.
    """
    visits = walk.visits[bridge.start]
    here, there = points[bridge.start], points[bridge.end]
    for i in visits[:-1]:
        ahead, behind = points[walk.vertex[walk.ahead[i]]], points[walk.vertex[walk.behind[i]]]
        if turn_to(there - here, ahead - here) < turn_to(behind - here, ahead - here):
            return i
    return visits[-1]


def turn_to(direction: Floats, origin: Floats) -> float:
    """Counter-clockwise angle in [0, 2 pi) from the vector ``origin`` to the vector ``direction``."""
    return float(signed_angles(origin, direction) % (2 * np.pi))


def bridge_candidates(rings: Sequence[Floats], points: Floats, ring_of: Ints, following: Ints) -> list[Bridge]:
    """Every triangulation edge that joins two rings, in both directions.

    The cost is the length, over the square of the sine of the smallest angle against the boundary, over the square of
    the clearance: a short bridge near 90 degrees at both ends that passes close to no vertex wins.
    """
    pairs = diagonals(rings, points)
    pairs = pairs[ring_of[pairs[:, 0]] != ring_of[pairs[:, 1]]]
    before = preceding(following)
    length = np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=1)
    least = np.full(len(pairs), np.pi / 2)
    for end, other in ((0, 1), (1, 0)):
        along = points[pairs[:, other]] - points[pairs[:, end]]
        for neighbour in (before, following):
            edge = points[neighbour[pairs[:, end]]] - points[pairs[:, end]]
            least = np.minimum(least, np.abs(signed_angles(along, edge)))
    room = clearance(points, pairs, 0.3 * np.minimum(length, local_length(points, following)[pairs].mean(axis=1)))
    cost = length / np.maximum(np.sin(least) * room, 1e-12) ** 2
    return [Bridge(int(a), int(b), float(c)) for (a, b), c in zip(pairs, cost, strict=True)]


def diagonals(rings: Sequence[Floats], points: Floats) -> Ints:
    """(m, 2) edges of the constrained Delaunay triangulation, as indices into the points, both directions of each."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.Polygon(rings[0], rings[1:])))
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    index = {tuple(p): i for i, p in enumerate(points.tolist())}
    ids = np.array([index[tuple(p)] for p in corners.reshape(-1, 2).tolist()], dtype=np.int64).reshape(-1, 3)
    pairs = np.stack([ids, np.roll(ids, -1, axis=1)], axis=-1).reshape(-1, 2)
    return np.unique(np.concatenate([pairs, pairs[:, ::-1]]), axis=0)


def preceding(following: Ints) -> Ints:
    """The vertex before each one along its ring, from the vertex after each one."""
    before = np.empty_like(following)
    before[following] = np.arange(len(following))
    return before


def local_length(points: Floats, following: Ints) -> Floats:
    """(n,) mean length of the two boundary segments at each vertex."""
    ahead = np.linalg.norm(points[following] - points, axis=1)
    return 0.5 * (ahead + ahead[preceding(following)])


def clearance(points: Floats, pairs: Ints, wanted: Floats) -> Floats:
    """(m,) in [0, 1]: how far each bridge stays from all other vertices, over the distance wanted of it.

    Rounding may leave a triangulation's edge upon a vertex that it should pass by; such a bridge has no clearance.
    """
    lines, vertices = shapely.linestrings(points[pairs]), shapely.points(points)
    i, j = shapely.STRtree(vertices).query(lines, predicate="dwithin", distance=wanted)
    other = (j != pairs[i, 0]) & (j != pairs[i, 1])
    i, j = i[other], j[other]
    share = np.ones(len(pairs))
    np.minimum.at(share, i, shapely.distance(lines[i], vertices[j]) / wanted[i])
    return share


def seam_points(points: Sequence[Floats], local: Floats, bridge: Bridge) -> list[Floats]:
    """The k - 1 points that split the bridge into k >= 1 even segments of about the local boundary length."""
    a, b = points[bridge.start], points[bridge.end]
    k = max(1, round(float(np.linalg.norm(b - a) / local[[bridge.start, bridge.end]].mean())))
    return list(a + (b - a) * (np.arange(1, k) / k)[:, None])
