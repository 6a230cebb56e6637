"""Rings that are given with their seams already walked, as the paper's authors write polygons with holes."""

from __future__ import annotations

import numpy as np

from envs.polygons.parity import odd_message
from envs.polygons.rings import SegmentGraph, check_crossings, close_pairs, extent, loops, place, signed_area
from envs.types import RELATIVE_TOLERANCE, Domain, DomainError, Floats, Ints


def check(source: str, ring: Floats) -> None:
    """Refuse an (n, 2) ring whose repeated points are no seams.

    With the seam edges walked once in each direction, no two edges crossing, and the inside to the left at every
    corner, the walk is the border of one connected inside.

    Raises:
        DomainError: a pinch, a slit or a crossing.
    """
    points, walk = distinct(ring)
    check_rounding(source, points, walk)
    seam = seam_edges(walk)
    check_pinches(source, ring, walk, seam)
    ahead = np.roll(walk, -1)
    once = ~seam | (walk < ahead)
    number = np.flatnonzero(once)
    edges = np.stack([walk, ahead], axis=1)[once]
    check_crossings(SegmentGraph(source, points, edges, np.zeros(len(number), dtype=np.int64), number))
    forward = 1 if signed_area(ring) > 0 else -1
    check_inside_left(source, points, walk[::forward], np.arange(len(walk))[::forward])


def opened(name: str, source: str, ring: Floats, fix_parity: bool = False, odd: bool = False) -> Domain:
    """The domain of an (n, 2) ring with valid seams already walked in it.

    Raises:
        DomainError: an odd count without ``fix_parity`` or ``odd``.
    """
    points, walk = distinct(ring)
    if signed_area(ring) < 0:
        walk = walk[::-1]
    seam = seam_edges(walk)
    if len(walk) % 2 and not odd:
        if not fix_parity:
            raise DomainError(odd_message(source, len(walk)))
        here, there = points[walk], points[np.roll(walk, -1)]
        split = int(np.argmax(np.where(seam, 0.0, np.linalg.norm(there - here, axis=1))))
        points = np.concatenate([points, 0.5 * (here[split] + there[split])[None]])
        walk = np.insert(walk, split + 1, len(points) - 1)
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


def check_rounding(source: str, points: Floats, walk: Ints) -> None:
    """Refuse distinct points that touch: the two sides of a seam that differ by rounding, or a pinch."""
    for i, j in close_pairs(points, RELATIVE_TOLERANCE * extent(points)):
        a, b = (int(np.flatnonzero(walk == k)[0]) for k in (i, j))
        raise DomainError(
            f"{source}: outer ring, vertex {b} at {place(points[j])} repeats vertex {a} but for rounding: "
            "a pinch; make the two sides of a seam equal number for number, or move one of the two"
        )


def check_pinches(source: str, ring: Floats, walk: Ints, seam: np.ndarray) -> None:
    """Refuse a slit that leads nowhere, a point that repeats without a seam, an edge walked twice in one direction."""
    ahead, behind = np.roll(walk, -1), np.roll(walk, 1)
    for i in np.flatnonzero(ahead == behind)[:1]:
        raise DomainError(
            f"{source}: outer ring, a spike at vertex {i} at {place(ring[i])}: the boundary folds back onto itself; "
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
                f"{source}: outer ring, vertex {i} at {place(ring[i])} repeats vertex {first}: a pinch where the "
                "boundary touches itself, and no seam (walked once in each direction) ends there; move one of the two"
            )
    _, first_walked = np.unique(np.stack([walk, ahead], axis=1), axis=0, return_index=True)
    for i in np.setdiff1d(np.arange(len(walk)), first_walked)[:1]:
        raise DomainError(
            f"{source}: outer ring, segment {i} from {place(ring[i])} is walked twice in one direction, a seam "
            "walked once in each; remove one of the two"
        )


def check_inside_left(source: str, points: Floats, walk: Ints, number: Ints) -> None:
    """Refuse a walk that does not keep the inside to its left.

    ::

               prev
                |            between the edge ahead and the edge behind, counter-clockwise, lies the inside:
          . . . v----next    no other edge may leave v there

    Args:
        source: what messages begin with.
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
                    f"{source}: outer ring, vertex {number[i]} at {place(points[v])}: the boundary is walked across "
                    "itself here, so its repeated points are a pinch and no seam; walk holes against the outer ring"
                )


def renumbered(name: str, points: Floats, walk: Ints, seam: np.ndarray) -> Domain:
    """The domain with its points in order: the outer ring's, each hole's, then the seams'."""
    # The inside is connected and to the left, so the one counter-clockwise loop is the outer ring.
    rings = sorted(
        loops(np.stack([walk, np.roll(walk, -1)], axis=1)[~seam]), key=lambda loop: signed_area(points[loop]) < 0
    )
    given = np.concatenate([np.stack([loop, np.roll(loop, -1)], axis=1) for loop in rings])
    order = list(dict.fromkeys([*given[:, 0].tolist(), *walk.tolist()]))
    place_of = np.empty(len(points), dtype=np.int64)
    place_of[order] = np.arange(len(order))
    return Domain(name=name, points=points[order], ring=place_of[walk], segments=place_of[given])
