"""Boundary layers: rows of thin quadrilaterals along sides, and the rings inside of them that are left to be meshed.

::

    +-----------------------------+     The rows have heights first, first x growth, first x growth^2, ... At a corner
    |                             |     of both sides with layers they follow the bisector, or fan out; where the next
    o=============================o     side has none they end along it (o), and where it goes straight on, or away,
    o=============================o     they end upright. Rows are less high where there is no room.
    +-----------------------------+
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from envs.polygons.layer_ends import Stretch
from envs.polygons.layer_room import room, smoothed
from envs.polygons.layer_spokes import Run, Spokes, spokes_of
from envs.polygons.outline import CORNER
from envs.polygons.rings import extent, oriented, place, signed_area
from envs.polygons.turning import turns
from envs.types import RELATIVE_TOLERANCE, DomainError, Floats, Ints

#: Rows at most, and how much a row may be higher than the one before it.
MOST_ROWS, MOST_GROWTH = 200, 3.0

#: Quadrilaterals of layers at most.
MOST_QUADS = 5_000_000

#: The least sine of an angle of a layer's quadrilateral.
FLATTEST = 0.02

#: Where rows cross or are not convex, they shrink by this, so often at most.
SHRINKING, TRIES = 0.8, 60

#: Of a stretch without layers the rows at one end take this at most.
TAKEN = 1.0 / 3.0

#: Rows lower than this share of what was asked for are refused.
LEAST_SHARE = 1e-6


@dataclass(frozen=True)
class Rows:
    """What layers are to be.

    Attributes:
        count: rows.
        first: height of the row at the boundary, above 0.
        growth: height of a row over that of the one before it, at least 1.
    """

    count: int
    first: float
    growth: float

    @property
    def heights(self) -> Floats:
        """(count,) distance of the end of each row from the boundary."""
        return np.cumsum(self.first * self.growth ** np.arange(self.count, dtype=np.float64))

    def check(self, source: str) -> None:
        """Refuse numbers that are none.

        Raises:
            DomainError: the number and its range.
        """
        if not 1 <= self.count <= MOST_ROWS:
            raise DomainError(f"{source}: {self.count} layers; give --layers a whole number from 1 to {MOST_ROWS}")
        if not 0.0 < self.first < np.inf:
            raise DomainError(f"{source}: first layer {self.first:g} high; give --first a number above 0")
        if not 1.0 <= self.growth <= MOST_GROWTH:
            raise DomainError(
                f"{source}: growth {self.growth:g} of layers; give --growth a number from 1 to {MOST_GROWTH:g}"
            )


@dataclass(frozen=True, eq=False)
class Layers:
    """Rows of quadrilaterals, and what they leave.

    Attributes:
        vertices: (n, 2) float64.
        quads: (q, 4) int64, strictly convex, counter-clockwise.
        rings: the rings inside of the rows, each (k,) int64: the outer one first, counter-clockwise, holes clockwise;
            an even number of vertices in all. Where there are no rows they are the boundary.
        segments: (s, 2) int64 the whole boundary, the domain on its left.
        limited: where rows are less high than asked for: the place, and their share of the height.
    """

    vertices: Floats
    quads: Ints
    rings: tuple[Ints, ...]
    segments: Ints
    limited: tuple[tuple[Floats, float], ...]


def boundary_layers(rings: Sequence[Floats], carries: Sequence[np.ndarray], rows: Rows, source: str) -> Layers:
    """Layers along some of the segments of a domain.

    A side without layers that rows end along gets their points on it; of its own vertices those stay that the rows
    neither pass nor come close to.

    Args:
        rings: valid rings of one polygon, each (n, 2) float64, the outer one first.
        carries: for each ring (n,) bool, whether the segment from each vertex to the next carries layers.
        rows: how many, and how high.
        source: what messages begin with.

    Raises:
        DomainError: numbers that are none, no segment with layers, or no room for them at all; the place.
    """
    rows.check(source)
    if not any(np.any(flags) for flags in carries):
        raise DomainError(f"{source}: no side carries the layers; name sides of the boundary")
    loops = [_Loop.of(ring, np.asarray(flags, dtype=np.bool_), r == 0, rows)
             for r, (ring, flags) in enumerate(zip(rings, carries, strict=True))]  # fmt: skip
    spokes = sum(len(run.spokes.vertex) for loop in loops for run in loop.runs)
    if spokes * rows.count > MOST_QUADS:
        raise DomainError(
            f"{source}: {spokes * rows.count:,} elements in layers, at most {MOST_QUADS:,}; use fewer --layers"
        )
    every = np.concatenate([np.stack([loop.points, np.roll(loop.points, -1, axis=0)], axis=1) for loop in loops])
    touching = RELATIVE_TOLERANCE * extent(every.reshape(-1, 2))
    for loop in loops:
        for run in loop.runs:
            run.find_room(every, touching)
    for _ in range(TRIES):
        built = _built(loops, source)
        bad = _crossed(built) | _flat(built)
        if not bad:
            return built.layers(tuple(_limited(loops)))
        for loop, run, vertex in bad:
            owner = loops[loop].runs[run]
            owner.share[vertex] *= SHRINKING
            if owner.share[vertex] < LEAST_SHARE:
                where = place(owner.run.points[vertex])
                raise DomainError(
                    f"{source}: no room for layers at {where}; give them to other sides, or split the boundary finer"
                )
        for loop in loops:
            for run in loop.runs:
                run.smooth()
    loop, run, vertex = min(bad)
    raise DomainError(
        f"{source}: layers cross or fold at {place(loops[loop].runs[run].run.points[vertex])}; use fewer or thinner ones, "
        "or split the boundary finer"
    )


#: A vertex of a run: its loop, its run, its number in the run.
Owner = tuple[int, int, int]


class _Layered:
    """A run on its way: its spokes, and the share of the height at each vertex."""

    def __init__(self, run: Run, rows: Rows) -> None:
        self.run, self.heights = run, rows.heights
        self.height = float(self.heights[-1])
        self.spokes: Spokes = spokes_of(run, self.height)
        self.share = np.minimum(1.0, self.spokes.most)
        self.gaps = np.linalg.norm(run.steps, axis=1)

    def find_room(self, boundary: Floats, touching: float) -> None:
        """Lower the shares to what there is room for."""
        spokes, points = self.spokes, self.run.points
        free = np.ones(len(spokes.vertex), dtype=np.bool_)
        free[[0, -1]] = [not spokes.first_along, not spokes.last_along]
        vertex = spokes.vertex[free]
        found = room(points[vertex], spokes.way[free], self.height, boundary, touching)
        np.minimum.at(self.share, vertex, found)
        # From the middles of the segments, too: what is small may lie between two spokes.
        ahead, behind = self.after(), np.arange(len(self.gaps))
        middles = points[behind] + 0.5 * self.run.steps
        last = np.searchsorted(spokes.vertex, behind, side="right") - 1
        first = np.searchsorted(spokes.vertex, ahead, side="left")
        found = room(middles, 0.5 * (spokes.way[last] + spokes.way[first]), self.height, boundary, touching)
        np.minimum.at(self.share, behind, found)
        np.minimum.at(self.share, ahead, found)
        self.smooth()

    def after(self) -> Ints:
        """(segments,) the vertex at the end of each segment."""
        return (np.arange(len(self.gaps)) + 1) % len(self.run.points)

    def smooth(self) -> None:
        """No steps in the height."""
        self.share = smoothed(self.share, self.gaps, self.height, self.run.closed)

    def levels(self) -> Floats:
        """(p, count, 2) where the rows end on each spoke."""
        spokes = self.spokes
        scaled = self.share[spokes.vertex][:, None] * self.heights
        return self.run.points[spokes.vertex][:, None] + scaled[..., None] * spokes.way[:, None]

    def taken(self, last: bool) -> float:
        """How much of the next side the rows take; 0 where they end upright."""
        spoke = -1 if last else 0
        if not (self.spokes.last_along if last else self.spokes.first_along):
            return 0.0
        return float(self.share[spoke] * self.height * np.linalg.norm(self.spokes.way[spoke]))


class _Loop:
    """A ring: runs with layers and, between them, stretches without."""

    def __init__(self, points: Floats, runs: list[_Layered], between: list[list[Floats]]) -> None:
        self.points, self.runs, self.between = points, runs, between
        #: Which stretch gets one more segment: its place in `between`.
        self.more: tuple[int, int] | None = None
        for i, pieces in enumerate(between):
            if runs and pieces:
                for run, last, piece in ((runs[i], True, pieces[0]), (runs[(i + 1) % len(runs)], False, pieces[-1])):
                    taken = run.taken(last)
                    if taken > 0.0:
                        vertex = -1 if last else 0
                        run.share[vertex] = min(
                            run.share[vertex], TAKEN * Stretch(piece).length / taken * run.share[vertex]
                        )

    @classmethod
    def of(cls, ring: Floats, flags: np.ndarray, outer: bool, rows: Rows) -> _Loop:
        """A ring with the domain on its left."""
        if (signed_area(ring) > 0.0) != outer:
            flags = flags[::-1]
        points = oriented(ring, counterclockwise=outer)
        n = len(points)
        if flags.all():
            return cls(points, [_Layered(Run(points, True, points[-1], points[0]), rows)], [[]])
        corner = np.abs(turns(points)) > CORNER
        starts = np.flatnonzero(flags & ~np.roll(flags, 1))
        ends = np.flatnonzero(flags & ~np.roll(flags, -1)) + 1
        ends = np.sort(np.where(ends <= starts[0], ends + n, ends)) if len(starts) else ends
        runs, between = [], []
        for i, (start, end) in enumerate(zip(starts.tolist(), ends.tolist(), strict=True)):
            walk = points[np.arange(start, end + 1) % n]
            runs.append(_Layered(Run(walk, False, points[start - 1], points[(end + 1) % n]), rows))
            following = int(starts[(i + 1) % len(starts)]) + (n if i + 1 == len(starts) else 0)
            cuts = [end, *(j for j in range(end + 1, following) if corner[j % n]), following]
            between.append([points[np.arange(a, b + 1) % n] for a, b in zip(cuts[:-1], cuts[1:], strict=True)])
        return cls(points, runs, between)

    def stretches(self, i: int) -> list[Stretch]:
        """The stretches behind run i, with what the rows take."""
        pieces = [Stretch(piece, more=int(self.more == (i, j))) for j, piece in enumerate(self.between[i])]
        if pieces:
            pieces[0] = replace(pieces[0], taken_first=self.runs[i].taken(last=True))
            pieces[-1] = replace(pieces[-1], taken_last=self.runs[(i + 1) % len(self.runs)].taken(last=False))
        return pieces


class _Built:
    """Vertices, quadrilaterals and rings, as far as they are."""

    def __init__(self) -> None:
        self.points: list[Floats] = []
        self.count = 0
        self.quads: list[Ints] = []
        #: The spokes of the quadrilaterals: two owners each.
        self.sides: list[tuple[Owner, Owner]] = []
        self.rings: list[list[int]] = []
        self.boundary: list[list[int]] = []
        #: What the vertices of rows belong to.
        self.owner: dict[int, Owner] = {}

    def add(self, points: Floats) -> list[int]:
        """The numbers of new vertices."""
        self.points.append(points.reshape(-1, 2))
        self.count += len(self.points[-1])
        return list(range(self.count - len(self.points[-1]), self.count))

    @property
    def vertices(self) -> Floats:
        """(n, 2)."""
        return np.concatenate(self.points)

    def layers(self, limited: tuple[tuple[Floats, float], ...]) -> Layers:
        """What is handed out."""
        walks = [np.array(ring, dtype=np.int64) for ring in self.boundary]
        segments = np.concatenate([np.stack([walk, np.roll(walk, -1)], axis=1) for walk in walks])
        rings = tuple(np.array(ring, dtype=np.int64) for ring in self.rings)
        return Layers(self.vertices, np.concatenate(self.quads), rings, segments, limited)


def _built(loops: list[_Loop], source: str) -> _Built:
    """The rows at the present heights; where the rings' total is odd, one segment more without layers."""
    built = _assembled(loops)
    if sum(map(len, built.rings)) % 2 == 0:
        return built
    pieces = [
        (piece.spacing, r, i, j)
        for r, loop in enumerate(loops) for i in range(len(loop.runs)) for j, piece in enumerate(loop.stretches(i))
    ]  # fmt: skip
    for loop in loops:
        if loop.more is not None:
            loop.more = None
            return _assembled(loops)
    if not pieces:
        raise DomainError(f"{source}: an odd number of boundary vertices; add or remove one")
    _, r, i, j = max(pieces)
    loops[r].more = (i, j)
    return _assembled(loops)


def _assembled(loops: list[_Loop]) -> _Built:
    built = _Built()
    for r, loop in enumerate(loops):
        if not loop.runs:
            ids = built.add(loop.points)
            built.rings.append(ids)
            built.boundary.append(ids)
            continue
        feet = [built.add(run.run.points) for run in loop.runs]
        ends: list[dict[bool, list[int]]] = [{} for _ in loop.runs]
        inside = []
        for i in range(len(loop.runs)):
            following = (i + 1) % len(loop.runs)
            pieces = loop.stretches(i)
            middle: list[int] = []
            for k, piece in enumerate(pieces):
                if k == 0 and piece.taken_first > 0.0:
                    ends[i][True] = built.add(piece.at(piece.taken_first * loop.runs[i].heights / loop.runs[i].height))
                middle += built.add(piece.inside())
                if k < len(pieces) - 1:
                    middle += built.add(piece.points[-1:])
                elif piece.taken_last > 0.0:
                    owner = loop.runs[following]
                    ends[following][False] = built.add(
                        piece.at(piece.length - piece.taken_last * owner.heights / owner.height)
                    )
            inside.append(middle)
        ring: list[int] = []
        boundary: list[int] = []
        for i, run in enumerate(loop.runs):
            ring += _rows(built, run, feet[i], ends[i], (r, i)) + inside[i]
            boundary += feet[i] + ends[i].get(True, []) + inside[i] + ends[(i + 1) % len(ends)].get(False, [])[::-1]
        built.rings.append(ring)
        built.boundary.append(boundary)
    return built


def _rows(
    built: _Built, run: _Layered, feet: list[int], ends: dict[bool, list[int]], who: tuple[int, int]
) -> list[int]:
    """Lay the rows of a run; the vertices that the ring inside of them walks."""
    spokes, levels = run.spokes, run.levels()
    rows = len(run.heights)
    grid = np.empty((len(spokes.vertex), rows + 1), dtype=np.int64)
    grid[:, 0] = np.array(feet)[spokes.vertex]
    for p in range(len(grid)):
        given = ends.get(True) if p == len(grid) - 1 else ends.get(False) if p == 0 else None
        grid[p, 1:] = given if given is not None else built.add(levels[p])
        built.owner.update(dict.fromkeys(grid[p, 1:].tolist(), (*who, int(spokes.vertex[p]))))
    columns = [(p, p + 1) for p in range(len(grid) - 1)] + ([(len(grid) - 1, 0)] if run.run.closed else [])
    fan = 0
    for p, q in columns:
        pair = ((*who, int(spokes.vertex[p])), (*who, int(spokes.vertex[q])))
        quads = np.stack([grid[p, :-1], grid[q, :-1], grid[q, 1:], grid[p, 1:]], axis=1)
        if len(grid) > 1 and pair[0] == pair[1]:
            # Two columns of a fan have one quadrilateral in the first row.
            fan += 1
            quads = quads[1:]
            if fan % 2 == 0:
                before = p - 1
                quads = np.concatenate([[[grid[p, 0], grid[q, 1], grid[p, 1], grid[before, 1]]], quads])
        built.quads.append(quads)
        built.sides += [pair] * len(quads)
    walk = grid[:, -1].tolist()
    if not run.run.closed:
        if not spokes.first_along:
            walk = grid[0, :-1].tolist() + walk
        if not spokes.last_along:
            walk = walk + grid[-1, -2::-1].tolist()
    return walk


def _flat(built: _Built) -> set[Owner]:
    """The owners of quadrilaterals that are not convex, or nearly so."""
    corners = built.vertices[np.concatenate(built.quads)]
    ahead, behind = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    turn = ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        sine = turn / (np.linalg.norm(ahead, axis=2) * np.linalg.norm(behind, axis=2))
    bad = np.flatnonzero(~(sine.min(axis=1) >= FLATTEST))
    return {owner for i in bad.tolist() for owner in built.sides[i]}


def _crossed(built: _Built) -> set[Owner]:
    """The owners of segments of the rings inside that meet others."""
    segments = np.concatenate([np.stack([ring, np.roll(ring, -1)], axis=1) for ring in map(np.array, built.rings)])
    lines = shapely.linestrings(built.vertices[segments])
    i, j = shapely.STRtree(lines).query(lines, predicate="intersects")
    apart = (i < j) & ~(segments[i][:, :, None] == segments[j][:, None]).any(axis=(1, 2))
    ids = np.unique(segments[np.concatenate([i[apart], j[apart]])]).tolist()
    return {built.owner[v] for v in ids if v in built.owner}


def _limited(loops: list[_Loop]) -> list[tuple[Floats, float]]:
    """The lowest place of each stretch whose rows are less high than asked for."""
    found = []
    for loop in loops:
        for run in loop.runs:
            low = run.share < 1.0 - 1e-9
            starts = np.flatnonzero(low & ~np.concatenate([[False], low[:-1]]))
            for start in starts.tolist():
                end = start + int(np.argmin(np.append(low[start:], False)))
                worst = start + int(run.share[start:end].argmin())
                found.append((run.run.points[worst], float(run.share[worst])))
    return found
