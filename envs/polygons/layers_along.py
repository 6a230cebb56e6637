"""Boundary layers along the named sides of a geometry: regions whose rows are built, and what is left of them to mesh.

::

    region  -- sides by name -->  rows along them  -- what they leave -->  region with a smaller domain, and its rows
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from envs.mesh import STRAIGHT, CurvedEdges
from envs.polygons.boundary_layers import Layers, boundary_layers
from envs.polygons.drawing import Line
from envs.polygons.geometry import Geometry, Region, no_side
from envs.polygons.layer_loops import Rows
from envs.polygons.named_sides import line_of_segments, sides_by_name, tolerance
from envs.polygons.rings import place
from envs.polygons.validation import from_rings
from envs.types import Domain, DomainError, Floats, Ints


@dataclass(frozen=True)
class BoundaryLayers:
    """Rows of thin quadrilaterals along sides.

    Attributes:
        along: names of sides.
        count: rows, 1 to 200.
        first: height of the row at the boundary, in the polygon's units, above 0.
        growth: height of a row over that of the one before it, 1 to 3.
    """

    along: tuple[str, ...]
    count: int
    first: float
    growth: float = 1.2

    def __post_init__(self) -> None:
        object.__setattr__(self, "along", (self.along,) if isinstance(self.along, str) else tuple(self.along))


def with_layers_along(geometry: Geometry, wanted: BoundaryLayers) -> Geometry:
    """The geometry with boundary layers.

    A side without layers that rows end along gets their points on it, and its names stay.

    Args:
        geometry: split; no lines or points inside.
        wanted: the rows; each name is one of a side of some region.

    Raises:
        DomainError: no such side, lines or points inside, no room, or rows that end along the boundary of another
            region, which does not have their points.
    """
    known = dict.fromkeys(name for region in geometry.regions for name in region.sides)
    rows, names = Rows(wanted.count, wanted.first, wanted.growth), wanted.along
    rows.check(geometry.name)
    if not names:
        raise DomainError(f"{geometry.name}: boundary layers along no side; name sides with --along")
    for name in names:
        if name not in known:
            raise no_side(geometry.name, name, known)
    if geometry.inside or geometry.places:
        raise DomainError(f"{geometry.name}: boundary layers beside lines or points inside; remove one of the two")
    regions = tuple(
        _layered(region, rows, [name for name in names if name in region.sides]) for region in geometry.regions
    )
    _check_shared(geometry, regions)
    return replace(geometry, regions=regions)


def _layered(region: Region, rows: Rows, names: Sequence[str]) -> Region:
    if not names:
        return region
    domain = region.domain
    carrying = {tuple(segment) for name in names for segment in region.sides[name].tolist()}
    flags = np.array([tuple(segment) in carrying for segment in domain.segments.tolist()])
    walks = ring_numbers(domain)
    layers = boundary_layers(
        [domain.points[walk] for walk in walks], np.split(flags, np.cumsum([len(walk) for walk in walks])[:-1]),
        rows, domain.name,
    )  # fmt: skip
    outer, *holes = (layers.vertices[ring] for ring in layers.rings)
    inside = replace(from_rings(outer, holes, domain.name), deviation=domain.deviation)
    return replace(
        region, domain=inside, layers=layers, sides=_sides(region, walks, layers), curved=_curved(region, layers)
    )


def ring_numbers(domain: Domain) -> list[Ints]:
    """For each ring that a domain was made of its vertices, in the order of its segments."""
    starts, ends = domain.segments.T
    breaks = np.flatnonzero(ends[:-1] != starts[1:]) + 1
    return np.split(starts, breaks)


def _sides(region: Region, walks: Sequence[Ints], layers: Layers) -> dict[str, Ints]:
    """(k, 2) int64 segments of each name, of the boundary with the rows' points on it."""
    points = region.domain.points
    lines = []
    for name, segments in region.sides.items():
        mine = {tuple(segment) for segment in segments.tolist()}
        for walk in walks:
            on = np.array([pair in mine for pair in zip(walk.tolist(), np.roll(walk, -1).tolist(), strict=True)])
            lines += [Line(points[run], name) for run in runs(walk, on)]
    line_of = line_of_segments(layers.vertices, layers.segments, lines, tolerance([[points[walk] for walk in walks]]))
    return sides_by_name(layers.segments, line_of, lines)


def runs(walk: Ints, on: np.ndarray) -> list[Ints]:
    """The stretches of a closed walk whose segments, each from a vertex to the next one, are on."""
    n = len(walk)
    if on.all():
        return [np.append(walk, walk[0])]
    starts = np.flatnonzero(on & ~np.roll(on, 1))
    found = []
    for start in starts.tolist():
        length = int(np.argmin(np.roll(on, -start)))
        found.append(walk[np.arange(start, start + length + 1) % n])
    return found


def _curved(region: Region, layers: Layers) -> CurvedEdges:
    """Of the edges on curves those whose ends are vertices of the rows' boundary still, one after the other."""
    if not len(region.curved.edges):
        return STRAIGHT
    number = {tuple(at): i for i, at in enumerate(layers.vertices.tolist())}
    kept = {tuple(segment) for segment in layers.segments.tolist()}
    edges, curve_of = [], []
    ends = region.domain.points[region.curved.edges].tolist()
    for (a, b), curve in zip(ends, region.curved.curve_of.tolist(), strict=True):
        edge = number.get(tuple(a), -1), number.get(tuple(b), -1)
        if edge in kept or edge[::-1] in kept:
            edges.append(edge)
            curve_of.append(curve)
    return CurvedEdges(
        np.array(edges, dtype=np.int64).reshape(-1, 2), np.array(curve_of, dtype=np.int64), region.curved.curves
    )


def _check_shared(geometry: Geometry, regions: Sequence[Region]) -> None:
    """Refuse rows that changed what regions share.

    Raises:
        DomainError: a segment of two regions that one of them has no more; its place.
    """
    if len(regions) == 1:
        return
    before = [_pairs(region.domain.points, region.domain.segments) for region in geometry.regions]
    after = [
        _pairs(region.domain.points, region.domain.segments) if region.layers is None
        else _pairs(region.layers.vertices, region.layers.segments)
        for region in regions
    ]  # fmt: skip
    for i, mine in enumerate(before):
        for j in range(i):
            for pair in mine & before[j]:
                if pair not in after[i] or pair not in after[j]:
                    raise DomainError(
                        f"{geometry.name}: layers end along the side between two regions near "
                        f"{place(np.array(min(pair)))}; give them to that side, too, or to others"
                    )


def _pairs(points: Floats, segments: Ints) -> set[frozenset[tuple[float, ...]]]:
    return {frozenset(map(tuple, ends)) for ends in points[segments].tolist()}
