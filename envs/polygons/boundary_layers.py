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
from dataclasses import dataclass

import numpy as np

from envs.polygons.layer_loops import Loop, Rows
from envs.polygons.layer_rows import Built, assembled, crossed, flat
from envs.polygons.rings import extent, place
from envs.types import RELATIVE_TOLERANCE, DomainError, Floats, Ints

#: Quadrilaterals of layers at most.
MOST_QUADS = 5_000_000

#: Where rows cross or are not convex, they shrink by this, so often at most.
SHRINKING, TRIES = 0.8, 60

#: Rows lower than this share of what was asked for are refused.
LEAST_SHARE = 1e-6


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
    loops = [Loop.of(ring, np.asarray(flags, dtype=np.bool_), r == 0, rows)
             for r, (ring, flags) in enumerate(zip(rings, carries, strict=True))]  # fmt: skip
    spokes = sum(len(run.spokes.vertex) for loop in loops for run in loop.runs)
    if spokes * rows.count > MOST_QUADS:
        raise DomainError(
            f"{source}: {spokes * rows.count:,} elements in layers, at most {MOST_QUADS:,}; use fewer --boundary-layers"
        )
    every = np.concatenate([np.stack([loop.points, np.roll(loop.points, -1, axis=0)], axis=1) for loop in loops])
    touching = RELATIVE_TOLERANCE * extent(every.reshape(-1, 2))
    for loop in loops:
        for run in loop.runs:
            run.find_room(every, touching)
    for _ in range(TRIES):
        built = _built(loops, source)
        bad = crossed(built) | flat(built)
        if not bad:
            return _handed_out(built, loops)
        for r, i, vertex in bad:
            owner = loops[r].runs[i]
            owner.share[vertex] *= SHRINKING
            if owner.share[vertex] < LEAST_SHARE:
                where = place(owner.run.points[vertex])
                raise DomainError(
                    f"{source}: no room for layers at {where}; give them to other sides, or split the boundary finer"
                )
        for loop in loops:
            for run in loop.runs:
                run.smooth()
    r, i, vertex = min(bad)
    raise DomainError(
        f"{source}: layers cross or fold at {place(loops[r].runs[i].run.points[vertex])}; use fewer or thinner ones, "
        "or split the boundary finer"
    )


def _handed_out(built: Built, loops: list[Loop]) -> Layers:
    walks = [np.array(ring, dtype=np.int64) for ring in built.boundary]
    return Layers(
        built.vertices,
        np.concatenate(built.quads),
        tuple(np.array(ring, dtype=np.int64) for ring in built.rings),
        np.concatenate([np.stack([walk, np.roll(walk, -1)], axis=1) for walk in walks]),
        tuple(_limited(loops)),
    )


def _built(loops: list[Loop], source: str) -> Built:
    """The rows at the present heights; where the rings' total is odd, one segment more without layers."""
    built = assembled(loops)
    if sum(map(len, built.rings)) % 2 == 0:
        return built
    pieces = [
        (piece.spacing, r, i, j)
        for r, loop in enumerate(loops) for i in range(len(loop.runs)) for j, piece in enumerate(loop.stretches(i))
    ]  # fmt: skip
    for loop in loops:
        if loop.more is not None:
            loop.more = None
            return assembled(loops)
    if not pieces:
        raise DomainError(f"{source}: an odd number of boundary vertices; add or remove one")
    _, r, i, j = max(pieces)
    loops[r].more = (i, j)
    return assembled(loops)


def _limited(loops: list[Loop]) -> list[tuple[Floats, float]]:
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
