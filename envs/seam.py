"""Seams: zero-width bridges that make one ring of a polygon with holes, and their recognition in a given ring.

::

    o-------------------------o        o   outer ring, walked counter-clockwise
    |                         |        h   hole, walked clockwise
    |        h-----h          |        s   seam points: once in the points, twice in the ring
    |        |     |          |
    a--s--s--h-----h          |        ... o a s s h h h h s s a o ...
    |                         |
    o-------------------------o

The bridges are edges of a constrained Delaunay triangulation of the polygon: those lie strictly inside, pass
through no vertex and never cross each other, whatever the number of holes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from envs.rings import Outline, check_crossings, close_pairs, extent, odd_message, oriented, place, signed_area
from envs.types import RELATIVE_TOLERANCE, Domain, DomainError, Floats, Ints


@dataclass(frozen=True)
class Bridge:
    """A diagonal that may join two rings: its ends as indices into the points, and its cost (a length)."""

    start: int
    end: int
    cost: float


def join(name: str, rings: Sequence[Floats]) -> Domain:
    """One counter-clockwise ring of valid rings: the outer one first, then the holes, in either orientation."""
    turned = [oriented(ring, counterclockwise=h == 0) for h, ring in enumerate(rings)]
    points = np.concatenate(turned)
    starts = np.cumsum([0, *(len(ring) for ring in turned)])
    ring_of = np.repeat(np.arange(len(turned)), [len(ring) for ring in turned])
    following = np.concatenate([np.roll(np.arange(a, b), -1) for a, b in zip(starts[:-1], starts[1:], strict=True)])
    segments = np.stack([np.arange(len(points)), following], axis=1).astype(np.int64)
    walk = list(range(starts[1]))
    added: list[Floats] = []
    for bridge in chosen_bridges(turned, points, ring_of, following):
        seam = seam_points(points, following, bridge)
        inner = list(range(len(points) + len(added), len(points) + len(added) + len(seam)))
        added.extend(seam)
        hole = int(ring_of[bridge.end])
        around = np.roll(np.arange(starts[hole], starts[hole + 1]), -(bridge.end - starts[hole])).tolist()
        at = walk.index(bridge.start)
        walk[at:at] = [bridge.start, *inner, *around, bridge.end, *reversed(inner)]
    every = np.concatenate([points, np.array(added).reshape(-1, 2)])
    return Domain(name=name, points=every, ring=np.array(walk, dtype=np.int64), segments=segments)


def chosen_bridges(rings: Sequence[Floats], points: Floats, ring_of: Ints, following: Ints) -> list[Bridge]:
    """One bridge for each hole, from what is already joined, the cheapest first (Prim's tree over the rings)."""
    if len(rings) == 1:
        return []
    candidates = bridge_candidates(rings, points, ring_of, following)
    joined, taken, chosen = {0}, set[int](), list[Bridge]()
    while len(joined) < len(rings):
        open_ones = [b for b in candidates if (ring_of[b.start] in joined) and (ring_of[b.end] not in joined)]
        # Two bridges at one vertex would share its angle: only where there is no other way.
        apart = [b for b in open_ones if b.start not in taken]
        best = min(apart or open_ones, key=lambda b: b.cost)
        chosen.append(best)
        joined.add(int(ring_of[best.end]))
        taken.update((best.start, best.end))
    return chosen


def bridge_candidates(rings: Sequence[Floats], points: Floats, ring_of: Ints, following: Ints) -> list[Bridge]:
    """Both directions of every triangulation edge that joins two rings.

    The cost is the length over the square of the sine of the smallest angle against the boundary, so that a short
    bridge near 90 degrees at both ends wins.
    """
    polygon = shapely.Polygon(rings[0], rings[1:])
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    index = {tuple(p): i for i, p in enumerate(points.tolist())}
    ids = np.array([index[tuple(p)] for p in corners.reshape(-1, 2).tolist()]).reshape(-1, 3)
    pairs = np.unique(np.stack([ids, np.roll(ids, -1, axis=1)], axis=-1).reshape(-1, 2), axis=0)
    pairs = pairs[ring_of[pairs[:, 0]] != ring_of[pairs[:, 1]]]
    # A pair may be listed in one direction only (at a bridge of the triangulation's own making): both are candidates.
    pairs = np.unique(np.concatenate([pairs, pairs[:, ::-1]]), axis=0)
    before = np.empty_like(following)
    before[following] = np.arange(len(following))
    length = np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=1)
    least = np.full(len(pairs), np.pi / 2)
    for end, other in ((0, 1), (1, 0)):
        along = points[pairs[:, other]] - points[pairs[:, end]]
        for neighbour in (before, following):
            edge = points[neighbour[pairs[:, end]]] - points[pairs[:, end]]
            least = np.minimum(least, angle_between(along, edge))
    cost = length / np.maximum(np.sin(least), 1e-12) ** 2
    return [Bridge(int(a), int(b), float(c)) for (a, b), c in zip(pairs, cost, strict=True)]


def angle_between(u: Floats, v: Floats) -> Floats:
    """(m,) angles in [0, pi] between (m, 2) vectors."""
    return np.arctan2(np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]), (u * v).sum(axis=1))


def seam_points(points: Floats, following: Ints, bridge: Bridge) -> Floats:
    """(k - 1, 2) points that split the bridge into k >= 1 even segments of about the local boundary length."""
    ends = np.array([bridge.start, bridge.end])
    before = np.array([int(np.flatnonzero(following == end)[0]) for end in ends])
    near = np.concatenate([points[following[ends]] - points[ends], points[before] - points[ends]])
    local = np.linalg.norm(near, axis=1).mean()
    a, b = points[ends]
    k = max(1, round(float(np.linalg.norm(b - a) / local)))
    return a + (b - a) * (np.arange(1, k) / k)[:, None]


def opened(name: str, ring: Floats, fix_parity: bool = False) -> Domain:
    """The domain of an (n, 2) ring with its seams already walked in it.

    Accepted is a ring whose repeated points are seams: with the seam edges walked once in each direction, no two edges
    crossing, and the inside to the left at every corner, the walk is the border of one connected inside.

    Raises:
        DomainError: a pinch, a slit, a crossing, or an odd count without ``fix_parity``.
    """
    points, walk = distinct(ring)
    for i, j in close_pairs(points, RELATIVE_TOLERANCE * extent(points)):
        a, b = (int(np.flatnonzero(walk == k)[0]) for k in (i, j))
        raise DomainError(
            f"{name}: outer ring, vertex {b} at {place(points[j])} repeats vertex {a} but for rounding: "
            "a pinch; make the two sides of a seam equal number for number, or move one of the two"
        )
    seam = seam_edges(walk)
    check_pinches(name, ring, walk, seam)
    ahead = np.roll(walk, -1)
    once = ~seam | (walk < ahead)
    number = np.flatnonzero(once)
    graph = Outline(name, points, np.stack([walk, ahead], axis=1)[once], np.zeros(len(number), dtype=np.int64), number)
    check_crossings(graph)
    if signed_area(ring) < 0:
        walk, seam = walk[::-1], np.roll(seam[::-1], -1)
        check_inside_left(name, points, walk, np.arange(len(walk))[::-1])
    else:
        check_inside_left(name, points, walk, np.arange(len(walk)))
    if len(walk) % 2:
        if not fix_parity:
            raise DomainError(odd_message(name, len(walk)))
        a, b = points[walk], points[np.roll(walk, -1)]
        i = int(np.argmax(np.where(seam, 0.0, np.linalg.norm(b - a, axis=1))))
        points = np.concatenate([points, 0.5 * (a[i : i + 1] + b[i : i + 1])])
        walk = np.insert(walk, i + 1, len(points) - 1)
        seam = seam_edges(walk)
    return renumbered(name, points, walk, seam)


def distinct(ring: Floats) -> tuple[Floats, Ints]:
    """The distinct points of a ring in order of first occurrence, (p, 2), and the ring as indices, (n,)."""
    seen: dict[tuple[float, ...], int] = {}
    walk = np.array([seen.setdefault(tuple(p), len(seen)) for p in ring.tolist()], dtype=np.int64)
    return np.array(list(seen)), walk


def seam_edges(walk: Ints) -> np.ndarray:
    """(n,) bool: which edges of the walk are walked in the other direction too."""
    forward = list(zip(walk.tolist(), np.roll(walk, -1).tolist(), strict=True))
    every = set(forward)
    return np.array([(b, a) in every for a, b in forward])


def check_pinches(name: str, ring: Floats, walk: Ints, seam: np.ndarray) -> None:
    """Refuse a point that repeats without a seam, an edge walked twice in one direction, and a slit that leads nowhere."""
    ahead, behind = np.roll(walk, -1), np.roll(walk, 1)
    for i in np.flatnonzero(ahead == behind)[:1]:
        raise DomainError(
            f"{name}: outer ring, a spike at vertex {i} at {place(ring[i])}: the boundary folds back onto itself; "
            "remove the vertex"
        )
    on_boundary = np.bincount(walk[~seam], minlength=int(walk.max()) + 1)
    on_seam = np.bincount(walk[seam], minlength=int(walk.max()) + 1)
    visits = np.bincount(walk)
    pinched = (visits > 1) & ((on_boundary > 1) | (on_seam == 0))
    for i in np.flatnonzero(pinched[walk]):
        first = int(np.flatnonzero(walk == walk[i])[0])
        if first != i:
            raise DomainError(
                f"{name}: outer ring, vertex {i} at {place(ring[i])} repeats vertex {first}: a pinch where the boundary "
                "touches itself, and no seam (walked once in each direction) ends there; move one of the two"
            )
    edges, counts = np.unique(np.stack([walk, ahead], axis=1), axis=0, return_counts=True)
    for (a, b), _ in zip(edges[counts > 1], counts, strict=False):
        i = int(np.flatnonzero((walk == a) & (ahead == b))[1])
        raise DomainError(
            f"{name}: outer ring, segment {i} from {place(ring[i])} is walked twice in one direction; a seam is walked "
            "once in each: remove one of the two"
        )


def check_inside_left(name: str, points: Floats, walk: Ints, number: Ints) -> None:
    """Refuse a walk that does not keep the inside to its left.

    ::

               prev
                |            between the edge ahead and the edge behind, counter-clockwise, lies the inside:
          . . . v----next    no other edge may leave v there

    Args:
        name: what messages begin with.
        points: (p, 2).
        walk: (n,) indices into ``points``, counter-clockwise.
        number: (n,) the index that each vertex of the walk was given with.
    """
    ahead, behind = np.roll(walk, -1), np.roll(walk, 1)
    leaving: dict[int, list[int]] = {}
    for i, v in enumerate(walk.tolist()):
        leaving.setdefault(v, []).append(i)
    for v, visits in leaving.items():
        if len(visits) == 1:
            continue
        ends = np.unique([ahead[visits], behind[visits]])
        directions = points[ends] - points[v]
        spokes = ends[np.argsort(np.arctan2(directions[:, 1], directions[:, 0]))].tolist()
        after = dict(zip(spokes, [*spokes[1:], spokes[0]], strict=True))
        for i in visits:
            if after[int(ahead[i])] != int(behind[i]):
                raise DomainError(
                    f"{name}: outer ring, vertex {number[i]} at {place(points[v])}: the boundary is walked across itself here, "
                    "so its repeated points are a pinch and no seam; walk the hole against the outer ring's direction"
                )


def renumbered(name: str, points: Floats, walk: Ints, seam: np.ndarray) -> Domain:
    """The domain with its points in order: the outer ring's, each hole's, then the seams'."""
    step = {int(a): int(b) for a, b in zip(walk[~seam], np.roll(walk, -1)[~seam], strict=True)}
    loops: list[list[int]] = []
    rest = dict(step)
    while rest:
        loop = [next(iter(rest))]
        while (following := rest.pop(loop[-1])) != loop[0]:
            loop.append(following)
        loops.append(loop)
    loops.sort(key=lambda loop: signed_area(points[loop]) < 0)
    for loop in loops[1:]:
        if signed_area(points[loop]) > 0:
            raise DomainError(f"{name}: outer ring: two outer rings joined by a seam; give one polygon")
    order = [v for loop in loops for v in loop]
    given = np.array([[a, step[a]] for a in order])
    known = set(order)
    order += [v for v in dict.fromkeys(walk.tolist()) if v not in known]
    place_of = np.empty(len(points), dtype=np.int64)
    place_of[order] = np.arange(len(order))
    return Domain(name=name, points=points[order], ring=place_of[walk], segments=place_of[given])
