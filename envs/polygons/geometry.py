"""A drawing whose boundary is split: the domain of each region, and the names of what lies on it.

::

    drawing  -- outlines checked -->  outlines  -- names by place, split -->  rings  -- joined -->  regions
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely

from envs.drawing import Line
from envs.polygons.named_sides import along, line_of_segments, sides_by_name, tolerance
from envs.polygons.offered_names import offered
from envs.polygons.rings import place
from envs.types import Domain, DomainError, Floats, Ints

#: Which of (m, 2) places belong to a name: (m,) bool.
Test = Callable[[Floats], np.ndarray]

#: Lines of a drawing at most.
MOST_LINES = 100_000


@dataclass(frozen=True, eq=False)
class Region:
    """A polygon of a drawing: what is meshed at once.

    Attributes:
        domain: its boundary, split.
        name: such as its material; empty: none.
        sides: (k, 2) int64 segments of the domain of each name.
        line_of: (s,) int64, for each segment of the domain the line that it lies on, -1 for none.
    """

    domain: Domain
    name: str = ""
    sides: dict[str, Ints] = field(default_factory=dict)
    line_of: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


@dataclass(frozen=True, eq=False)
class Geometry:
    """Regions that share points where they share their boundary.

    Attributes:
        name: the drawing's.
        regions: in the order of its polygons.
        lines: of the drawing, or those offered where it names nothing.
        notes: what the user is to be told, a line each.
    """

    name: str
    regions: tuple[Region, ...]
    lines: tuple[Line, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Laid:
    """Lines laid on the outlines of a drawing.

    Attributes:
        lines: those that name sides: the drawing's, or what is offered where it names none.
        keep: (k, 2) places on the outlines where a name begins or ends.
        inside: lines off the outlines, for elements to follow.
        near: the distance within which a vertex lies on a line.
    """

    lines: tuple[Line, ...]
    keep: Floats
    inside: tuple[Line, ...]
    near: float


def laid(lines: Sequence[Line], polygons: Sequence[Sequence[Floats]], source: str) -> Laid:
    """Lay lines on outlines.

    Args:
        lines: of a drawing.
        polygons: valid outlines, for each its rings, the outer one first.
        source: what messages begin with.

    Raises:
        DomainError: too many lines, or one that lies outside of all polygons and is not optional.
    """
    if len(lines) > MOST_LINES:
        raise DomainError(f"{source}: {len(lines):,} lines, at most {MOST_LINES:,} are read; remove some")
    near = tolerance(polygons)
    rings = [np.concatenate([ring, ring[:1]]) for rings in polygons for ring in rings]
    outlines = shapely.MultiLineString(rings)
    shapely.prepare(outlines)
    keep, inside = [np.zeros((0, 2))], []
    for line in lines:
        found = along(line, outlines, near)
        if line.name:
            keep.append(found.ends)
        if not (line.optional and not line.name):
            inside += [replace(line, points=piece) for piece in found.inside]
    named = tuple(lines) if any(line.name for line in lines) else (*lines, *offers(polygons))
    return Laid(named, snapped(np.concatenate(keep), rings, near), within(inside, polygons, source), near)


def offers(polygons: Sequence[Sequence[Floats]]) -> list[Line]:
    """Names for the sides of a polygon alone; several would have the same ones."""
    return offered(polygons[0]) if len(polygons) == 1 else []


def snapped(places: Floats, rings: Sequence[Floats], near: float) -> Floats:
    """Places put on the outlines' vertices where these are near, else on the nearest place of the outlines."""
    if not len(places):
        return places
    vertices = np.concatenate(rings)
    tree = shapely.STRtree(shapely.points(vertices))
    nearest = vertices[tree.nearest(shapely.points(places))]
    close = np.linalg.norm(nearest - places, axis=1) <= 2.0 * near
    lines = shapely.linestrings(np.concatenate([np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings]))
    at = shapely.points(places)
    segment = lines[shapely.STRtree(lines).nearest(at)]
    projected = shapely.get_coordinates(shapely.line_interpolate_point(segment, shapely.line_locate_point(segment, at)))
    return np.unique(np.where(close[:, None], nearest, projected), axis=0)


def within(lines: Sequence[Line], polygons: Sequence[Sequence[Floats]], source: str) -> tuple[Line, ...]:
    """The lines that lie inside of polygons; the optional ones of the others are dropped.

    Raises:
        DomainError: one that is not optional lies outside.
    """
    if not lines:
        return ()
    area = shapely.union_all([shapely.Polygon(rings[0], rings[1:]) for rings in polygons])
    kept = []
    for line in lines:
        if shapely.LineString(line.points).within(area):
            kept.append(line)
        elif not line.optional:
            named = f" {line.name!r}" if line.name else ""
            raise DomainError(
                f"{source}: the line{named} from {place(line.points[0])} to {place(line.points[-1])} is not inside of "
                "a polygon; end it on the boundary, or remove it"
            )
    return tuple(kept)


def with_regions(geometry: Geometry, names: Sequence[str]) -> Geometry:
    """The geometry with these names of its regions.

    Raises:
        DomainError: another number of names than of regions.
    """
    if len(names) != len(geometry.regions):
        raise DomainError(
            f"{geometry.name}: {len(names)} names for {len(geometry.regions)} regions; give one for each polygon"
        )
    regions = zip(geometry.regions, names, strict=True)
    return replace(geometry, regions=tuple(replace(region, name=name) for region, name in regions))


def named_by(geometry: Geometry, tests: Mapping[str, Test]) -> Geometry:
    """The geometry with names for the segments whose ends and middle pass a test; they go before names by lines.

    Args:
        geometry: split.
        tests: by name, each (m, 2) places to (m,) bool; of several that a segment passes, the first has it.
    """
    return replace(geometry, regions=tuple(_tested(region, tests) for region in geometry.regions))


def _tested(region: Region, tests: Mapping[str, Test]) -> Region:
    segments = region.domain.segments
    ends = region.domain.points[segments]
    free = np.ones(len(segments), dtype=np.bool_)
    sides: dict[str, Ints] = {}
    for name, test in tests.items():
        passed = free.copy()
        for places in (ends[:, 0], ends[:, 1], ends.mean(axis=1)):
            passed &= np.asarray(test(places), dtype=np.bool_)
        sides[name] = segments[passed]
        free &= ~passed
    left = {tuple(segment) for segment in segments[free].tolist()}
    for name, rows in region.sides.items():
        rest = rows[[tuple(row) in left for row in rows.tolist()]]
        sides[name] = np.concatenate([sides[name], rest]) if name in sides else rest
    return replace(region, sides={name: rows for name, rows in sides.items() if len(rows)})


def region_of(domain: Domain, name: str, laid: Laid) -> Region:
    """The region of a domain, with the names of its segments."""
    line_of = line_of_segments(domain.points, domain.segments, laid.lines, laid.near)
    return Region(domain, name, sides_by_name(domain.segments, line_of, laid.lines), line_of)
