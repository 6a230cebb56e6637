r"""Slits: lines inside a domain, walked out and back, so that its ring goes along both of their sides.

::

    o-------------------o        o   outer ring        t   tip of a line that ends inside: an inner angle of 2 pi
    |         t         |        l   the line's points: once in the points, in the ring once for each of its sides
    |         l         |        s   seam points, as between a ring and a hole
    |         l---t     |
    |         l         |        A line is a seam whose segments stay: the mesh has them as edges, its elements follow.
    o-s-s-----t---------o

A place that a node is to sit on is a line of no length, joined by a seam.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence

import numpy as np
import shapely

from envs.polygons.rings import check_count, extent, place
from envs.polygons.seam import SHARED_VERTEX, Bridge, Walk, clearance, corner_facing, seam_points
from envs.polygons.turning import signed_angles
from envs.types import RELATIVE_TOLERANCE, Domain, DomainError, Floats, Ints

#: A seam leaves a boundary or a line at this angle at least (radians).
LEAST_ANGLE = 1e-4

#: Lengths grow by this share of the distance from where they are known.
GROWTH = 0.2

#: Pairs of points that are looked at in one go for a seam that nothing lies across.
AT_ONCE = 2_000


def slit_domain(name: str, rings: Sequence[Floats], places: Floats, source: str, *, deviation: float = 0.0) -> Domain:
    """The domain of a face: one ring through its rings, along both sides of its lines, and through its places.

    Args:
        name: the domain's name.
        rings: see `faces.Face`, discretised; an even number of vertices in all.
        places: (m, 2), m >= 0.
        source: what messages begin with.
        deviation: see `Domain`.

    Raises:
        DomainError: segments that meet anywhere but at their ends, or too many.
    """
    points, walks = _numbered(rings, places)
    ring_steps = np.concatenate([np.stack([walk, np.roll(walk, -1)], axis=1) for walk in walks if len(walk) > 1])
    low, high = ring_steps.min(axis=1), ring_steps.max(axis=1)
    keys, where, counts = np.unique(low * len(points) + high, return_inverse=True, return_counts=True)
    segments = ring_steps[counts[where.ravel()] == 1]
    lines = np.stack(np.divmod(keys[counts == 2], len(points)), axis=1)
    edges = np.concatenate([segments, lines])
    check_count(len(ring_steps), source, holes=len(walks) > 1)
    _check_crossings(points, edges, source)
    ring, points = _joined(points, walks, edges, source)
    held = np.array([walk[0] for walk in walks if len(walk) == 1], dtype=np.int64)
    return Domain(name, points, ring, segments, deviation, lines, held)


def _numbered(rings: Sequence[Floats], places: Floats) -> tuple[Floats, list[Ints]]:
    """The distinct points in order of first occurrence, and the rings and places as walks along them."""
    seen: dict[tuple[float, ...], int] = {}
    walks = [
        np.array([seen.setdefault(tuple(p), len(seen)) for p in ring.tolist()], dtype=np.int64)
        for ring in [*rings, *np.reshape(places, (-1, 1, 2))]
    ]
    return np.array(list(seen)), walks


def _check_crossings(points: Floats, edges: Ints, source: str) -> None:
    """Refuse edges that meet anywhere but at a common end: coarse pieces may where what they stand for does not."""
    lines = shapely.linestrings(points[edges])
    tolerance = RELATIVE_TOLERANCE * extent(points)
    i, j = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=tolerance)
    apart = (i < j) & (edges[i][:, :, None] != edges[j][:, None, :]).all(axis=(1, 2))
    for a, b in zip(i[apart][:1], j[apart][:1], strict=True):
        at = shapely.shortest_line(lines[a], lines[b]).coords[0]
        raise DomainError(
            f"{source}: pieces of lines or of the boundary meet at {place(at)}; use a smaller edge length, or move a "
            "line clear"
        )


def _joined(points: Floats, walks: list[Ints], edges: Ints, source: str) -> tuple[Ints, Floats]:
    """One ring through all walks, the first one the outer ring, and the points with those of the seams."""
    walk, placed = Walk(walks[0].tolist()), list(points)
    if len(walks) > 1:
        part_of = np.empty(len(points), dtype=np.int64)
        for number, one in enumerate(walks):
            part_of[one] = number
        local = _local_lengths(points, edges)
        for bridge in _bridges(points, part_of, edges, local, source):
            part = walks[part_of[bridge.end]]
            visit = corner_facing(placed, Walk(part.tolist()), Bridge(bridge.end, bridge.start, bridge.cost))
            around = [*np.roll(part, -visit).tolist(), bridge.end][: 1 if len(part) == 1 else None]
            at = corner_facing(placed, walk, bridge)
            seam = seam_points(placed, local, bridge)
            inner = list(range(len(placed), len(placed) + len(seam)))
            placed += seam
            walk.insert(at, [bridge.start, *inner, *around, *reversed(inner)])
    return walk.vertices(), np.array(placed)


def _local_lengths(points: Floats, edges: Ints) -> Floats:
    """(p,) mean length of the edges at each point; where there are none, what it is nearby."""
    lengths = np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1)
    meeting = np.bincount(edges.ravel(), minlength=len(points))
    local = np.bincount(edges.ravel(), np.repeat(lengths, 2), minlength=len(points)) / np.maximum(meeting, 1)
    known = meeting > 0
    for v in np.flatnonzero(~known):
        local[v] = np.min(local[known] + GROWTH * np.linalg.norm(points[known] - points[v], axis=1))
    return local


def _bridges(points: Floats, part_of: Ints, edges: Ints, local: Floats, source: str) -> list[Bridge]:
    """One bridge to each part but the first, from what is already joined, the cheapest first (Prim's tree)."""
    pairs = _near_pairs(points, part_of)
    pairs = pairs[_is_free(points, edges, pairs)]
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    costs = _costs(points, edges, local, pairs)
    leaving: dict[int, list[int]] = {}
    for i, part in enumerate(part_of[pairs[:, 0]].tolist()):
        leaving.setdefault(part, []).append(i)
    joined, taken, chosen = {0}, set[int](), list[Bridge]()
    parts = int(part_of.max()) + 1

    def cost(i: int) -> float:
        return float(costs[i]) * (SHARED_VERTEX if pairs[i, 0] in taken else 1.0)

    def choose(start: int, end: int, price: float) -> None:
        chosen.append(Bridge(start, end, price))
        joined.add(int(part_of[end]))
        taken.update((start, end))
        for j in leaving.get(int(part_of[end]), []):
            heapq.heappush(waiting, (cost(j), j))

    waiting = [(cost(i), i) for i in leaving.get(0, [])]
    heapq.heapify(waiting)
    while len(joined) < parts:
        if not waiting:
            walls = np.concatenate([edges, np.array([(one.start, one.end) for one in chosen], np.int64).reshape(-1, 2)])
            start, end = _any_free_pair(points, part_of, walls, joined, source)
            choose(start, end, 0.0)
            continue
        then, i = heapq.heappop(waiting)
        start, end = pairs[i].tolist()
        if part_of[end] in joined:
            continue
        if cost(i) > then:  # another bridge has left there since
            heapq.heappush(waiting, (cost(i), i))
            continue
        if any(one.cost == 0.0 for one in chosen):
            walls = np.array([(one.start, one.end) for one in chosen], dtype=np.int64)
            if not _is_free(points, walls, pairs[i : i + 1])[0]:
                continue
        choose(start, end, then)
    return chosen


def _near_pairs(points: Floats, part_of: Ints) -> Ints:
    """(m, 2) edges of the points' Delaunay triangulation that join two parts; no two of them cross."""
    from scipy.spatial import Delaunay  # a quarter of a second that domains without lines need not wait

    corners = Delaunay(points - points.mean(axis=0)).simplices.astype(np.int64)
    pairs = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
    pairs = np.unique(pairs, axis=0)
    return pairs[part_of[pairs[:, 0]] != part_of[pairs[:, 1]]]


def _is_free(points: Floats, edges: Ints, pairs: Ints) -> np.ndarray:
    """(m,) bool, whether nothing lies across the way between two points: no edge, no other point."""
    tolerance = RELATIVE_TOLERANCE * extent(points)
    ways = shapely.linestrings(points[pairs])
    free = np.ones(len(pairs), dtype=np.bool_)
    i, j = shapely.STRtree(shapely.linestrings(points[edges])).query(ways, predicate="dwithin", distance=tolerance)
    across = (pairs[i][:, :, None] != edges[j][:, None, :]).all(axis=(1, 2))
    free[i[across]] = False
    i, j = shapely.STRtree(shapely.points(points)).query(ways, predicate="dwithin", distance=tolerance)
    free[i[(pairs[i] != j[:, None]).all(axis=1)]] = False
    return free & (_least_angles(points, edges, pairs) > LEAST_ANGLE)


def _least_angles(points: Floats, edges: Ints, pairs: Ints) -> Floats:
    """(m,) the least angle between the way between two points and the edges at its ends, pi / 2 at most."""
    ends = np.concatenate([edges, edges[:, ::-1]])
    ends = ends[np.argsort(ends[:, 0], kind="stable")]
    least = np.full(len(pairs), 0.5 * np.pi)
    for end in (0, 1):
        here, there = pairs[:, end], pairs[:, 1 - end]
        first = np.searchsorted(ends[:, 0], here, side="left")
        count = np.searchsorted(ends[:, 0], here, side="right") - first
        for k in range(int(count.max(initial=0))):
            has = np.flatnonzero(count > k)
            other = ends[first[has] + k, 1]
            angle = signed_angles(points[there[has]] - points[here[has]], points[other] - points[here[has]])
            least[has] = np.minimum(least[has], np.abs(angle))
    return least


def _costs(points: Floats, edges: Ints, local: Floats, pairs: Ints) -> Floats:
    """(m,) what bridges cost, as in `seam.bridge_candidates`."""
    length = np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=1)
    room = clearance(points, pairs, 0.3 * np.minimum(length, local[pairs].mean(axis=1)))
    return length / np.maximum(np.sin(_least_angles(points, edges, pairs)) * room, 1e-12) ** 2


def _any_free_pair(points: Floats, part_of: Ints, walls: Ints, joined: set[int], source: str) -> tuple[int, int]:
    """The shortest way from a joined part to one that is not, where no wall is; there always is one."""
    inside = np.isin(part_of, list(joined))
    starts, ends = np.flatnonzero(inside), np.flatnonzero(~inside)
    best: tuple[float, int, int] | None = None
    for end in ends.tolist():
        length = np.linalg.norm(points[starts] - points[end], axis=1)
        order = np.argsort(length, kind="stable")
        for a in range(0, len(order), AT_ONCE):
            some = order[a : a + AT_ONCE]
            if best is not None and length[some[0]] >= best[0]:
                break
            pairs = np.stack([starts[some], np.full(len(some), end)], axis=1)
            free = np.flatnonzero(_is_free(points, walls, pairs))
            if len(free):
                found = (float(length[some[free[0]]]), int(pairs[free[0], 0]), end)
                best = found if best is None else min(best, found)
                break
    if best is None:
        raise DomainError(f"{source}: lines so close to each other that nothing fits between; move them apart")
    return best[1], best[2]
