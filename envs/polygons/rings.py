"""Checks of the rings a polygon is given by: what cannot be meshed is named with its place and the fix.

A ring is (n, 2) float64; its vertex ``i`` is row ``i`` as given, its segment ``i`` runs from vertex ``i`` to the next.
Everything within ``RELATIVE_TOLERANCE`` of the domain's diameter counts as touching.
"""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike

from envs.types import RELATIVE_TOLERANCE, DomainError, Floats, Ints

#: Vertices of a boundary at most.
MOST_VERTICES = 1_000_000

#: Vertices of a polygon with holes at most: the triangulation that finds seams takes time with their square.
MOST_WITH_HOLES = 50_000

#: Rings of a file at most.
MOST_RINGS = 10_000

#: Vertices that an outer ring and a hole have at least.
OUTER_LEAST, HOLE_LEAST = 4, 3

#: Pairs that a search for what lies near looks at in one go: a scribble of n segments has n^2 / 2 of them.
PAIRS_AT_ONCE = 30_000_000

#: What messages call the options that help, on the command line and in Python.
EDGE_LENGTH, FIX_PARITY = "--edge-length (edge_length= in Python)", "--fix-parity (fix_parity=True in Python)"

#: Coordinates beyond this, or domains smaller than its inverse, would overflow when squared or multiplied.
LARGEST_COORDINATE = 1e100


@dataclass(frozen=True)
class SegmentGraph:
    """The segments of one or several rings as a graph over distinct points, with what messages call them.

    Attributes:
        source: the name that messages begin with.
        points: (p, 2) float64, distinct points.
        edges: (e, 2) int64, indices into ``points``, each undirected edge once.
        ring_of: (e,) int64, the ring that each edge was given in; 0 is the outer one, h the hole h - 1.
        number: (e,) int64, the edge's index within that ring, which is also its first vertex's.
    """

    source: str
    points: Floats
    edges: Ints
    ring_of: Ints
    number: Ints

    @cached_property
    def tolerance(self) -> float:
        """Distance below which two points touch."""
        return RELATIVE_TOLERANCE * extent(self.points)


def ring_name(index: int) -> str:
    """What messages call ring ``index``: the outer one is 0, hole h is h + 1."""
    return "outer ring" if index == 0 else f"hole {index - 1}"


def place(point: Sequence[float] | Floats) -> str:
    """Coordinates as messages show them, in full: ``(x, y)``."""
    return f"({float(point[0])!r}, {float(point[1])!r})"


def extent(points: Floats) -> float:
    """Diagonal of the bounding box of (n, 2) points."""
    return float(np.hypot(*np.ptp(points, axis=0)))


def signed_area(ring: Floats) -> float:
    """Shoelace area of an (n, 2) ring, positive when counter-clockwise."""
    x, y = (ring - ring[0]).T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def loops(segments: Ints) -> list[Ints]:
    """The closed loops that directed segments form, in the order of the first segment of each.

    Args:
        segments: (s, 2) vertices; each vertex begins one segment and ends one.

    Returns:
        For each loop its vertices, (k,) int64, in the segments' direction.
    """
    following = dict(segments.tolist())
    found = []
    while following:
        loop = [next(iter(following))]
        while (vertex := following.pop(loop[-1])) != loop[0]:
            loop.append(vertex)
        found.append(np.array(loop, dtype=np.int64))
    return found


def oriented(ring: Floats, counterclockwise: bool) -> Floats:
    """The (n, 2) ring in the wanted orientation, its first vertex kept first."""
    if (signed_area(ring) > 0) == counterclockwise:
        return ring
    return np.concatenate([ring[:1], ring[:0:-1]])


def check_count(
    vertices: float, source: str, fix: str = "split or simplify the polygon", *, holes: bool = False
) -> None:
    """Refuse more than ``MOST_VERTICES``, or with holes ``MOST_WITH_HOLES``."""
    most, what = (MOST_WITH_HOLES, " with holes") if holes else (MOST_VERTICES, "")
    if vertices > most:
        raise DomainError(f"{source}: {vertices:,.0f} vertices{what}, at most {most:,} are possible; {fix}")


def check_rings(rings: int, source: str) -> None:
    """Refuse more than ``MOST_RINGS``."""
    if rings > MOST_RINGS:
        raise DomainError(f"{source}: {rings:,} rings, at most {MOST_RINGS:,} are possible; split the file")


def pairs_of(
    tree: shapely.STRtree, geometries: np.ndarray, predicate: str, distance: float | None = None
) -> Iterator[tuple[Ints, Ints]]:
    """The pairs (i, j) of geometry i and the tree's j that a predicate holds for, for a few more i each time.

    Who looks for one pair alone can stop early, and never are there more than ``PAIRS_AT_ONCE``.

    Args:
        tree: of p geometries.
        geometries: (g,) what is asked about.
        predicate: one of `shapely.STRtree.query`'s.
        distance: of ``dwithin``.
    """
    most = max(1, PAIRS_AT_ONCE // max(1, len(tree)))
    start, count = 0, 1
    while start < len(geometries):
        i, j = tree.query(geometries[start : start + count], predicate=predicate, distance=distance)
        yield i + start, j
        start, count = start + count, min(2 * count, most)


def is_number(given: type) -> bool:
    """Whether a type is one of numbers; truth values are none."""
    return issubclass(given, int | float | np.integer | np.floating) and given is not bool


def as_ring(coordinates: ArrayLike, source: str, index: int = 0, *, least: int = OUTER_LEAST) -> Floats:
    """Coordinates as an (n, 2) float64 ring, without the closing point that repeats the first.

    Args:
        coordinates: n pairs of numbers.
        source: the name that messages begin with.
        index: 0 for the outer ring, h + 1 for hole h.
        least: vertices that an outer ring needs; a hole needs 3.

    Raises:
        DomainError: not pairs of finite numbers, too few of them, or repeated neighbours.
    """
    where = f"{source}: {ring_name(index)}"
    try:
        given = np.asarray(coordinates, dtype=None if hasattr(coordinates, "__array__") else object)
        if given.size and given.dtype.kind not in "iufO":
            raise TypeError("not numbers")
        if given.dtype == object and not all(map(is_number, set(map(type, given.ravel())))):
            raise TypeError("not numbers")
        ring = np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        where += first_broken(coordinates)
        raise DomainError(f"{where}: not a list of [x, y] pairs of numbers; give every vertex as [x, y]") from None
    if ring.size == 0:
        raise DomainError(f"{where}: no vertices; give at least 4 [x, y] pairs")
    if ring.ndim != 2 or ring.shape[1] != 2:
        raise DomainError(f"{where}: shape {ring.shape} where (n, 2) is needed; give every vertex as [x, y]")
    check_coordinates(ring, source, lambda i: f"{ring_name(index)}, vertex {i}")
    # -0.0 and 0.0 are one place: adding zero makes them one number too.
    ring = ring + 0.0
    tolerance = RELATIVE_TOLERANCE * extent(ring)
    if len(ring) > 1 and np.linalg.norm(ring[0] - ring[-1]) <= tolerance:
        ring = ring[:-1]
    check_least(len(ring), source, index, least)
    gaps = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
    for i in np.flatnonzero(gaps <= tolerance)[:1]:
        j = (i + 1) % len(ring)
        raise DomainError(f"{where}, vertex {j} at {place(ring[j])}: repeats vertex {i}; remove one of the two")
    check_thickness(ring, where)
    return ring


def check_coordinates(points: Floats, source: str, name: Callable[[int], str] = lambda _: "a point") -> None:
    """Refuse (n, 2 or 3) points not finite or beyond ``LARGEST_COORDINATE``; the name tells which row it is."""
    for i in np.flatnonzero(~(np.abs(points) <= LARGEST_COORDINATE).all(axis=1))[:1]:
        what = "too large" if np.isfinite(points[i]).all() else "not finite (NaN or infinity)"
        raise DomainError(f"{source}: {name(i)} at {place(points[i])}: coordinate {what}; correct or remove it")


def first_broken(coordinates: Any) -> str:
    """What a message says of the first vertex that is no pair of numbers; nothing when there are no vertices."""
    if not isinstance(coordinates, list | tuple):
        return ""
    for i, vertex in enumerate(coordinates):
        if not isinstance(vertex, list | tuple | np.ndarray) or not all(is_number(type(value)) for value in vertex):
            return f", vertex {i} {reprlib.repr(vertex)}"
        if len(vertex) != 2:
            return f", vertex {i} of {len(vertex)} numbers"
    return ""


def check_least(vertices: int, source: str, index: int = 0, least: int = OUTER_LEAST) -> None:
    """Refuse a ring of too few vertices: an outer one of less than ``least``, a hole of less than ``HOLE_LEAST``."""
    least = HOLE_LEAST if index else least
    if vertices >= least:
        return
    fix = "add vertices or remove the hole" if index else "add vertices"
    if vertices == OUTER_LEAST - 1 and not index:
        fix = f"use {EDGE_LENGTH}, which splits its sides, or add a vertex"
    raise DomainError(f"{source}: {ring_name(index)}: {vertices} vertices, at least {least} are needed; {fix}")


def check_thickness(ring: Floats, where: str) -> None:
    """Refuse an (n, 2) ring whose vertices lie on one line (no area), within the tolerance."""
    size = extent(ring)
    if size < 1 / LARGEST_COORDINATE:
        raise DomainError(f"{where}: degenerate, its extent {size:.3g} is too small; scale it up")
    centred = (ring - ring.mean(axis=0)) / size
    thin = np.linalg.svd(centred, full_matrices=False)[2][-1]
    if np.ptp(centred @ thin) <= RELATIVE_TOLERANCE:
        raise DomainError(
            f"{where}: degenerate, zero area: all {len(ring)} vertices lie on the line from {place(ring[0])}; "
            "give a polygon with area"
        )


def segment_graph(rings: Sequence[Floats], source: str) -> SegmentGraph:
    """The graph of several rings that share no points."""
    counts = [len(ring) for ring in rings]
    starts = np.concatenate([[0], np.cumsum(counts)])
    edges = [
        np.stack([np.arange(n), np.roll(np.arange(n), -1)], axis=1) + start
        for n, start in zip(counts, starts, strict=False)
    ]
    return SegmentGraph(
        source=source,
        points=np.concatenate(rings),
        edges=np.concatenate(edges).astype(np.int64),
        ring_of=np.repeat(np.arange(len(rings)), counts),
        number=np.concatenate([np.arange(n) for n in counts]),
    )


def check_distinct(graph: SegmentGraph) -> None:
    """Refuse points that occur twice, in one ring (a pinch) or in two (they touch)."""
    for i, j in close_pairs(graph.points, graph.tolerance):
        first, second = (f"{ring_name(graph.ring_of[k])}, vertex {graph.number[k]}" for k in (i, j))
        if graph.ring_of[i] == graph.ring_of[j]:
            problem = "a pinch where the boundary touches itself; move one of the two"
        else:
            problem = "the two rings touch; move one of them"
        raise DomainError(f"{graph.source}: {second} at {place(graph.points[j])} repeats {first}: {problem}")


def close_pairs(points: Floats, distance: float) -> Iterator[tuple[int, int]]:
    """Pairs i < j of (p, 2) points within ``distance``, in order of j."""
    geometries = shapely.points(points)
    for j, i in pairs_of(shapely.STRtree(geometries), geometries, "dwithin", distance):
        later = i < j
        order = np.lexsort([i[later], j[later]])
        yield from zip(i[later][order].tolist(), j[later][order].tolist(), strict=True)


def check_crossings(graph: SegmentGraph) -> None:
    """Refuse edges that meet anywhere but at a shared end, and neighbours that fold back onto each other.

    Raises:
        DomainError: the two segments, by ring and index, and where they meet.
    """
    ends = graph.points[graph.edges]
    lines = shapely.linestrings(ends)
    for i, j in pairs_of(shapely.STRtree(lines), lines, "dwithin", graph.tolerance):
        i, j = i[i < j], j[i < j]
        shared = (graph.edges[i][:, :, None] == graph.edges[j][:, None, :]).any(axis=2)
        neighbours = shared.any(axis=1)
        check_folds(graph, i[neighbours], j[neighbours], shared[neighbours])
        i, j = i[~neighbours], j[~neighbours]
        for k in np.lexsort([j, i])[:1]:
            raise DomainError(crossing_message(graph, int(i[k]), int(j[k]), lines))


def crossing_message(graph: SegmentGraph, a: int, b: int, lines: np.ndarray) -> str:
    """The line that names the edges ``a`` and ``b`` and where they meet."""
    meeting = shapely.shortest_line(lines[a], lines[b]).coords[0]
    ring_a, ring_b = int(graph.ring_of[a]), int(graph.ring_of[b])
    if ring_a == ring_b:
        return (
            f"{graph.source}: {ring_name(ring_a)} crosses itself: segments {graph.number[a]} and {graph.number[b]} "
            f"meet at {place(meeting)}; move a vertex so that they do not meet"
        )
    other = "the outer ring" if ring_a == 0 else ring_name(ring_a)
    return (
        f"{graph.source}: {ring_name(ring_b)} crosses or touches {other}: its segment {graph.number[b]} meets "
        f"segment {graph.number[a]} at {place(meeting)}; move the hole clear"
    )


def check_folds(graph: SegmentGraph, i: Ints, j: Ints, shared: np.ndarray) -> None:
    """Refuse neighbouring edges that lie upon each other: the corner between them is a spike of zero angle.

    Args:
        graph: of all segments.
        i: (m,) edges.
        j: (m,) edges, each a neighbour of the one in ``i``.
        shared: (m, 2) bool, which end of ``i`` is the common one.
    """
    first, second = graph.edges[i], graph.edges[j]
    corner = np.where(shared[:, 0], first[:, 0], first[:, 1])
    tip = graph.points[corner]
    u = graph.points[first.sum(axis=1) - corner] - tip
    v = graph.points[second.sum(axis=1) - corner] - tip
    cross, dot = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0], (u * v).sum(axis=1)
    # Distance of the shorter one's far end from the longer one.
    off = np.abs(cross) / np.maximum(np.linalg.norm(u, axis=1), np.linalg.norm(v, axis=1))
    for k in np.flatnonzero((dot > 0) & (off <= graph.tolerance))[:1]:
        a, b = int(i[k]), int(j[k])
        raise DomainError(
            f"{graph.source}: {ring_name(graph.ring_of[a])}, a spike at {place(tip[k])}: segment "
            f"{graph.number[b]} folds back onto segment {graph.number[a]}; remove the vertex at the tip"
        )


def check_nesting(rings: Sequence[Floats], source: str) -> None:
    """Refuse holes outside the outer ring or inside another hole; the rings are known not to meet.

    Since no two rings meet, one vertex of a hole tells where the whole hole lies.
    """
    if len(rings) == 1:
        return
    inside = shapely.polygons([shapely.linearrings(ring) for ring in rings])
    probes = shapely.points([ring[0] for ring in rings[1:]])
    shapely.prepare(inside[0])
    for h in np.flatnonzero(~shapely.contains(inside[0], probes))[:1] + 1:
        where = f"{source}: {ring_name(h)}, vertex 0 at {place(rings[h][0])}"
        raise DomainError(f"{where}: lies outside the outer ring; move the hole inside or remove it")
    for inner, outer in pairs_of(shapely.STRtree(inside[1:]), probes, "within"):
        for k in np.flatnonzero(inner != outer)[:1]:
            h, other = inner[k] + 1, outer[k] + 1
            where = f"{source}: {ring_name(h)}, vertex 0 at {place(rings[h][0])}"
            raise DomainError(f"{where}: lies inside {ring_name(other)}; remove one of the two")
