"""The rings of a domain as runs that carry boundary layers, each with its spokes and heights, and stretches between."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from envs.polygons.layer_ends import Stretch
from envs.polygons.layer_room import room, smoothed
from envs.polygons.layer_spokes import Run, Spokes, spokes_of
from envs.polygons.outline import CORNER
from envs.polygons.rings import oriented, signed_area
from envs.polygons.turning import turns
from envs.types import DomainError, Floats, Ints

#: Rows at most, and how much a row may be higher than the one before it.
MOST_ROWS, MOST_GROWTH = 200, 3.0

#: Of a stretch without layers the rows at one end take this at most.
TAKEN = 1.0 / 3.0


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
            raise DomainError(
                f"{source}: {self.count} layers; give --boundary-layers a whole number from 1 to {MOST_ROWS}"
            )
        if not 0.0 < self.first < np.inf:
            raise DomainError(f"{source}: first layer {self.first:g} high; give --first a number above 0")
        if not 1.0 <= self.growth <= MOST_GROWTH:
            raise DomainError(
                f"{source}: growth {self.growth:g} of layers; give --growth a number from 1 to {MOST_GROWTH:g}"
            )


class Layered:
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


class Loop:
    """A ring: runs with layers and, between them, stretches without."""

    def __init__(self, points: Floats, runs: list[Layered], between: list[list[Floats]]) -> None:
        self.points, self.runs, self.between = points, runs, between
        #: Which stretch gets one more segment: its place in `between`.
        self.more: tuple[int, int] | None = None
        for i, pieces in enumerate(between):
            if runs and pieces:
                for run, last, piece in ((runs[i], True, pieces[0]), (runs[(i + 1) % len(runs)], False, pieces[-1])):
                    taken = run.taken(last)
                    if taken > 0.0:
                        vertex = -1 if last else 0
                        run.share[vertex] *= min(1.0, TAKEN * Stretch(piece).length / taken)

    @classmethod
    def of(cls, ring: Floats, flags: np.ndarray, outer: bool, rows: Rows) -> Loop:
        """A ring with the domain on its left."""
        if (signed_area(ring) > 0.0) != outer:
            flags = flags[::-1]
        points = oriented(ring, counterclockwise=outer)
        n = len(points)
        if flags.all():
            return cls(points, [Layered(Run(points, True, points[-1], points[0]), rows)], [[]])
        corner = np.abs(turns(points)) > CORNER
        starts = np.flatnonzero(flags & ~np.roll(flags, 1))
        ends = np.flatnonzero(flags & ~np.roll(flags, -1)) + 1
        ends = np.sort(np.where(ends <= starts[0], ends + n, ends)) if len(starts) else ends
        runs, between = [], []
        for i, (start, end) in enumerate(zip(starts.tolist(), ends.tolist(), strict=True)):
            walk = points[np.arange(start, end + 1) % n]
            runs.append(Layered(Run(walk, False, points[start - 1], points[(end + 1) % n]), rows))
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
