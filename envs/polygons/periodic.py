"""Periodic sides: two stretches of boundary, one the other moved, that have the same points.

::

    +---------------+        first and second, each walked with the domain on its left; the motion takes the start of
    |               ^        the first to the end of the second, and the domain beside it to what lies beyond
    v first  second |
    |               |
    +---------------+

In the graph of the boundary each chain of the first side has a twin on the second: they get the same sizes, the same
number of segments, and where a total is odd one more both or none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.ops import substring

from envs.polygons.boundary import Boundary
from envs.polygons.rings import EDGE_LENGTH, extent, place
from envs.polygons.sizing import Sizes
from envs.types import DomainError, Floats, Ints

#: How far sides may be from one another's images, as a share of the domain's diameter.
ALIKE = 2e-6


@dataclass(frozen=True, eq=False)
class Motion:
    """A rotation, then a shift.

    Attributes:
        turn: (2, 2) float64, applied from the left; the unit matrix itself where nothing turns.
        shift: (2,) float64.
    """

    turn: Floats
    shift: Floats

    def __call__(self, points: Floats) -> Floats:
        """(n, 2) points moved."""
        return np.asarray(points @ self.turn.T + self.shift)

    def back(self, points: Floats) -> Floats:
        """(n, 2) points moved the other way."""
        return np.asarray((points - self.shift) @ self.turn)


@dataclass(frozen=True, eq=False)
class PeriodicSides:
    """Two sides and the motion between them.

    Attributes:
        names: what messages and files call them.
        first: (k, 2) float64, walked with the domain on its left.
        second: (l, 2) float64, walked with the domain on its right: the image of the first one.
        motion: takes the first side to the second one.
        near: how far off a place may be that is an image.
    """

    names: tuple[str, str]
    first: Floats
    second: Floats
    motion: Motion
    near: float


def periodic_sides(
    first: Sequence[Floats],
    second: Sequence[Floats],
    polygons: Sequence[Sequence[Floats]],
    source: str,
    names: tuple[str, str] = ("first", "second"),
) -> PeriodicSides:
    """Two sides said to be periodic.

    Args:
        first, second: each a stretch of boundary, in one polyline or several in any order, whichever way they run.
        polygons: valid rings, for each the outer one first.
        source: what messages begin with.
        names: what messages and files call the sides.

    Raises:
        DomainError: a side in several pieces, one that is closed or off the boundary, or two that are no images of one
            another; the place where they differ most.
    """
    near = ALIKE * extent(np.concatenate([ring for rings in polygons for ring in rings]))
    a, b = (_walked(side, polygons, f"{source}: side {name!r}", near) for side, name in
            ((first, names[0]), (second, names[1])))  # fmt: skip
    motion, b = _motion(a, b), b[::-1]
    both = f"{source}: sides {names[0]!r} and {names[1]!r} are not periodic"
    off = shapely.distance(shapely.LineString(b), shapely.points(motion(a)))
    other = shapely.distance(shapely.LineString(a), shapely.points(motion.back(b)))
    if max(off.max(), other.max()) > near:
        worst = a[off.argmax()] if off.max() > other.max() else b[other.argmax()]
        raise DomainError(
            f"{both}: {place(worst)} is {max(off.max(), other.max()):.3g} away from its image on the other side; give "
            "two sides of one shape"
        )
    if shapely.LineString(a).distance(shapely.LineString(b)) <= near and not _meet_in_a_tip(a, b, near):
        raise DomainError(f"{both}: they meet at more than a common end; give two sides apart")
    return PeriodicSides(names, a, b, motion, near)


def _meet_in_a_tip(first: Floats, second: Floats, near: float) -> bool:
    """Whether all that two sides have in common is one end, as the sides of a sector have its tip."""
    for end in (0, -1):
        if np.linalg.norm(first[end] - second[end]) <= near:
            line = shapely.LineString(first)
            rest = substring(line, *((0.01, 1.0) if end == 0 else (0.0, 0.99)), normalized=True)
            return bool(rest.distance(shapely.LineString(second)) > near)
    return False


def _walked(side: Sequence[Floats], polygons: Sequence[Sequence[Floats]], where: str, near: float) -> Floats:
    """A side as one polyline with the domain on its left."""
    lines = [shapely.LineString(points) for points in side if len(points) > 1]
    merged = shapely.line_merge(shapely.MultiLineString(lines)) if len(lines) > 1 else (lines or [shapely.Point()])[0]
    if merged.geom_type != "LineString" or merged.is_closed:
        raise DomainError(f"{where} is not one open line along the boundary; name the stretch that is periodic alone")
    points = shapely.get_coordinates(merged)
    middle = shapely.Point(0.5 * (points[0] + points[1]))
    for rings in polygons:
        for r, ring in enumerate(rings):
            closed = np.concatenate([ring, ring[:1]])
            if shapely.LineString(closed).distance(middle) > near:
                continue
            segments = shapely.linestrings(np.stack([closed[:-1], closed[1:]], axis=1))
            i = int(shapely.distance(segments, middle).argmin())
            along = float((points[1] - points[0]) @ (closed[i + 1] - closed[i]))
            outer = shapely.LinearRing(ring).is_ccw == (r == 0)
            return points if (along > 0.0) == outer else points[::-1]
    raise DomainError(f"{where} is not on the boundary at {place(points[0])}; give a side of the polygon")


def _motion(first: Floats, second: Floats) -> Motion:
    """From the first side to the second one reversed, by their ends."""
    a, b = first[-1] - first[0], second[0] - second[-1]
    angle = float(np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b))
    if abs(angle) <= ALIKE:
        return Motion(np.eye(2), second[-1] - first[0])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return Motion(turn, 0.5 * (second[-1] + second[0] - turn @ (first[0] + first[-1])))


def common_nodes(graph: Boundary, pairs: Sequence[PeriodicSides]) -> Floats:
    """(k, 2) places that have to be nodes of the graph: its nodes on periodic sides, and the images of these.

    Where an image is near a vertex of the side it is that vertex, otherwise it is put on the side.
    """
    nodes = np.array([chain.points[end] for chain in graph.chains for end in (0, -1)])
    found = [np.zeros((0, 2))]
    for pair in pairs:
        for here, there, move in ((pair.first, pair.second, pair.motion), (pair.second, pair.first, pair.motion.back)):
            on = nodes[shapely.distance(shapely.LineString(here), shapely.points(nodes)) <= pair.near]
            images = _onto(move(np.concatenate([on, here[[0, -1]]])), there, pair.near)
            found += [on, images]
    return np.unique(np.concatenate(found), axis=0)


def _onto(places: Floats, side: Floats, near: float) -> Floats:
    """Places put on a side: on its nearest vertex, if that is near."""
    off, vertex = _nearest(side, places)
    line = shapely.LineString(side)
    put = shapely.get_coordinates(
        shapely.line_interpolate_point(line, shapely.line_locate_point(line, shapely.points(places)))
    )
    return np.where((off <= 2.0 * near)[:, None], side[vertex], put)


def _nearest(points: Floats, places: Floats) -> tuple[Floats, Ints]:
    """How far (m, 2) places are from the nearest of some points, and which that is, each (m,)."""
    found = shapely.STRtree(shapely.points(points)).nearest(shapely.points(places))
    return np.linalg.norm(points[found] - places, axis=1), found


@dataclass(frozen=True)
class Twins:
    """Two chains with the same points.

    Attributes:
        first, second: the chains.
        backward: the second one runs against the image of the first.
    """

    first: int
    second: int
    backward: bool


def twins_of(graph: Boundary, pairs: Sequence[PeriodicSides], source: str) -> list[Twins]:
    """The chains on periodic sides, two by two.

    Args:
        graph: with `common_nodes` among its nodes.
        pairs: the sides.
        source: what messages begin with.

    Raises:
        DomainError: a chain without a twin, or in two pairs.
    """
    middles = np.array([chain.at(np.array([0.5 * chain.length]))[0] for chain in graph.chains])
    starts, ends = (np.array([chain.points[end] for chain in graph.chains]) for end in (0, -1))
    found: list[Twins] = []
    taken: set[int] = set()
    for pair in pairs:
        here, there = (
            np.flatnonzero(np.max([
                shapely.distance(shapely.LineString(side), shapely.points(places)) for places in (starts, middles, ends)
            ], axis=0) <= pair.near) for side in (pair.first, pair.second)
        )  # fmt: skip
        images = [pair.motion(places[here]) for places in (starts, middles, ends)]
        if not len(there) or len(here) != len(there):
            raise _without_twin(pair, source, pair.first[0])
        off, nearest = _nearest(middles[there], images[1])
        for i, chain in enumerate(here.tolist()):
            twin = int(there[nearest[i]])
            tips = np.array([starts[twin], ends[twin]])
            gaps = [float(np.linalg.norm(np.array([images[0][i], images[2][i]]) - each, axis=1).max())
                    for each in (tips, tips[::-1])]  # fmt: skip
            if max(off[i], min(gaps)) > 4.0 * pair.near:
                raise _without_twin(pair, source, middles[chain])
            if taken & {chain, twin}:
                raise DomainError(
                    f"{source}: {place(middles[chain])} of the boundary is in two pairs of periodic sides; name one"
                )
            taken |= {chain, twin}
            found.append(Twins(chain, twin, gaps[1] < gaps[0]))
    return found


def _without_twin(pair: PeriodicSides, source: str, where: Floats) -> DomainError:
    return DomainError(
        f"{source}: sides {pair.names[0]!r} and {pair.names[1]!r} have different vertices near {place(where)}; use "
        f"{EDGE_LENGTH}, or give both the same ones"
    )


def with_equal_sizes(along: Sequence[Sizes], twins: Sequence[Twins]) -> list[Sizes]:
    """The sizes of each chain, those of twins the smaller of both at each place."""
    found = list(along)
    for twin in twins:
        one, other = along[twin.first], along[twin.second]
        share, h = other.at / other.at[-1], other.h
        if twin.backward:
            share, h = 1.0 - share[::-1], h[::-1]
        every = np.unique(np.concatenate([one.at / one.at[-1], share]))
        least = np.minimum(np.interp(every, one.at / one.at[-1], one.h), np.interp(every, share, h))
        found[twin.first] = replace(one, at=every * one.at[-1], h=least)
        if twin.backward:
            every, least = 1.0 - every[::-1], least[::-1]
        found[twin.second] = replace(other, at=every * other.at[-1], h=least)
    return found


def equal_counts(counts: Ints, twins: Sequence[Twins]) -> None:
    """Give twins the larger of their counts, in place."""
    for twin in twins:
        counts[[twin.first, twin.second]] = max(counts[twin.first], counts[twin.second])


def tied(users: Sequence[Sequence[int]], costs: Floats, twins: Sequence[Twins]) -> tuple[list[list[int]], Floats]:
    """Users and costs of chains for `parity.made_even`: of twins the first stands for both, nobody uses the second."""
    found, dear = [list(each) for each in users], costs.copy()
    for twin in twins:
        found[twin.first] += found[twin.second]
        found[twin.second] = []
        dear[twin.first] += costs[twin.second]
    return found, dear


def with_twins(chosen: set[int], twins: Sequence[Twins]) -> set[int]:
    """The chains chosen, and the twins of those that stand for both."""
    return chosen | {twin.second for twin in twins if twin.first in chosen}


def node_pairs(points: Floats, segments: Ints, pair: PeriodicSides, source: str) -> Ints:
    """(k, 2) int64: the vertices on the first side, from its start on, and their images on the second.

    A tip that both sides have in common is no image of itself here.

    Args:
        points: (n, 2) a mesh's vertices.
        segments: (s, 2) int64 boundary segments.
        pair: the sides.
        source: what messages begin with.

    Raises:
        DomainError: a vertex without an image.
    """
    on_boundary = np.unique(segments)
    first = shapely.LineString(pair.first)
    at = shapely.points(points[on_boundary])
    mine = on_boundary[shapely.distance(first, at) <= pair.near]
    mine = mine[np.argsort(shapely.line_locate_point(first, shapely.points(points[mine])), kind="stable")]
    off, image = _nearest(points[on_boundary], pair.motion(points[mine]))
    on_second = on_boundary[shapely.distance(shapely.LineString(pair.second), at) <= pair.near]
    images = on_boundary[image]
    for i in np.flatnonzero(off > 4.0 * pair.near)[:1]:
        raise _without_twin(pair, source, points[mine[i]])
    if len(np.unique(images)) != len(mine) or len(on_second) != len(mine):
        raise _without_twin(pair, source, pair.first[0])
    pairs = np.column_stack([mine, images])
    return pairs[mine != images]
