"""Rows laid along the runs of rings: vertices, quadrilaterals, and the rings inside of them."""

from __future__ import annotations

import numpy as np
import shapely

from envs.polygons.layer_loops import Layered, Loop
from envs.types import Floats, Ints

#: The least sine of an angle of a layer's quadrilateral.
FLATTEST = 0.02

#: A vertex of a run: its loop, its run, its number in the run.
Owner = tuple[int, int, int]


class Built:
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


def assembled(loops: list[Loop]) -> Built:
    """All rows, and the rings inside of them, at the present heights; nothing is checked."""
    built = Built()
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
            ring += _laid(built, run, feet[i], ends[i], (r, i)) + inside[i]
            boundary += feet[i] + ends[i].get(True, []) + inside[i] + ends[(i + 1) % len(ends)].get(False, [])[::-1]
        built.rings.append(ring)
        built.boundary.append(boundary)
    return built


def _laid(built: Built, run: Layered, feet: list[int], ends: dict[bool, list[int]], who: tuple[int, int]) -> list[int]:
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


def flat(built: Built) -> set[Owner]:
    """The owners of quadrilaterals that are not convex, or nearly so."""
    corners = built.vertices[np.concatenate(built.quads)]
    ahead, behind = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    turn = ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        sine = turn / (np.linalg.norm(ahead, axis=2) * np.linalg.norm(behind, axis=2))
    bad = np.flatnonzero(~(sine.min(axis=1) >= FLATTEST))
    return {owner for i in bad.tolist() for owner in built.sides[i]}


def crossed(built: Built) -> set[Owner]:
    """The owners of segments of the rings inside that meet others."""
    segments = np.concatenate([np.stack([ring, np.roll(ring, -1)], axis=1) for ring in map(np.array, built.rings)])
    lines = shapely.linestrings(built.vertices[segments])
    i, j = shapely.STRtree(lines).query(lines, predicate="intersects")
    apart = (i < j) & ~(segments[i][:, :, None] == segments[j][:, None]).any(axis=(1, 2))
    ids = np.unique(segments[np.concatenate([i[apart], j[apart]])]).tolist()
    return {built.owner[v] for v in ids if v in built.owner}
