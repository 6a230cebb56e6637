"""A drawing whose boundary is split: the domain of each region, and the names of what lies on it.

::

    drawing  -- outlines checked -->  outlines  -- names by place, split -->  rings  -- joined -->  regions
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely

from envs.mesh import STRAIGHT, CurvedEdges
from envs.polygons.axis import Axis
from envs.polygons.boundary_layers import Layers
from envs.polygons.curved_edges import curved_edges, on_curves
from envs.polygons.drawing import Drawing, Line, Place
from envs.polygons.named_sides import along, line_of_segments, parts, segments_of, sides_by_name, tolerance
from envs.polygons.offered_names import offered
from envs.polygons.periodic import PeriodicSides
from envs.polygons.rings import extent
from envs.polygons.rings import place as shown
from envs.printable import printable
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
        curved: its segments that lie on curves.
        layers: rows of quadrilaterals along its boundary, of which ``domain`` is what they leave; the segments of
            ``sides`` and ``curved`` are theirs then. None: no rows.
    """

    domain: Domain
    name: str = ""
    sides: dict[str, Ints] = field(default_factory=dict)
    curved: CurvedEdges = STRAIGHT
    layers: Layers | None = None


@dataclass(frozen=True, eq=False)
class Geometry:
    """Regions that share points where they share their boundary.

    Attributes:
        name: the drawing's.
        regions: in the order of its polygons.
        inside: lines that elements follow, which lie inside of regions or between them.
        places: points that a node sits on.
        mirror: the axis that the regions are to the left of, as one half of what was drawn; None: they are all.
        stated: whether the drawing names anything; else the sides' names are those that are offered.
        notes: what the user is to be told, a line each.
        periodic: pairs of sides that have the same points.
    """

    name: str
    regions: tuple[Region, ...]
    inside: tuple[Line, ...] = ()
    places: tuple[Place, ...] = ()
    mirror: Axis | None = None
    stated: bool = True
    notes: tuple[str, ...] = ()
    periodic: tuple[PeriodicSides, ...] = ()


@dataclass(frozen=True, eq=False)
class Laid:
    """Lines laid on the outlines of a drawing.

    Attributes:
        lines: those that name sides: the drawing's, or what is offered where it names none.
        keep: (k, 2) places on the outlines where a name begins or ends.
        inside: lines that are not on the outlines alone, for elements to follow.
        places: (m, 2) float64, points that a node is to sit on.
        near: the distance within which a vertex lies on a line.
    """

    lines: tuple[Line, ...]
    keep: Floats
    inside: tuple[Line, ...]
    places: Floats
    near: float

    @property
    def divide(self) -> bool:
        """Whether there is anything inside for elements to follow."""
        return bool(self.inside) or len(self.places) > 0

    def named(self, name: str, source: str) -> list[Floats]:
        """The lines of a name, each (k, 2).

        Raises:
            DomainError: there is none.
        """
        found = [line.points for line in self.lines if line.name == name]
        if not found:
            raise no_side(source, name, [line.name for line in self.lines if line.name])
        return found


def no_side(source: str, name: str, known: Iterable[str]) -> DomainError:
    """The error for a name that no side has, with those that there are."""
    sides = ", ".join(dict.fromkeys(map(printable, known))) or "not named"
    return DomainError(
        f"{source}: no side is called {printable(name)}; the sides are {sides}; choose one of them, "
        "which `freemesh mesh FILE --list-names` prints and draws"
    )


def laid(drawing: Drawing, polygons: Sequence[Sequence[Floats]], source: str) -> Laid:
    """Lay a drawing's lines and places on its outlines.

    Args:
        drawing: its lines and places.
        polygons: valid outlines, for each its rings, the outer one first.
        source: what messages begin with.

    Raises:
        DomainError: too many lines, or one that lies outside of all polygons and is not optional, or such a place.
    """
    lines = drawing.lines
    if len(lines) > MOST_LINES:
        raise DomainError(f"{source}: {len(lines):,} lines, at most {MOST_LINES:,} are read; remove some")
    near = tolerance(polygons)
    rings = [np.concatenate([ring, ring[:1]]) for rings in polygons for ring in rings]
    outlines = shapely.MultiLineString(rings)
    segments = segments_of(polygons)
    keep, inside, naming = [np.zeros((0, 2))], [], False
    for line in lines:
        found = along(line, segments, near)
        if line.name:
            keep.append(found.ends)
            naming = naming or found.on > 4.0 * near
        if found.inside and not line.optional:
            check_within(line, found.inside, polygons, source)
            inside.append(line)
    places = np.array([(place.x, place.y) for place in drawing.places], dtype=np.float64).reshape(-1, 2)
    outside = shapely.distance(shapely.points(places), area_of(polygons)) > near
    for place in [place for place, off in zip(drawing.places, outside, strict=True) if off][:1]:
        raise DomainError(
            f"{source}: the point{named(place.name)} at {shown((place.x, place.y))} is outside of all polygons; move "
            "it, or remove it"
        )
    on_outlines = shapely.distance(shapely.points(places), outlines) <= near
    placed = places.copy()
    placed[on_outlines] = snapped(places[on_outlines], rings, near)
    keep.append(placed[on_outlines])
    all_named = tuple(lines) if naming else (*lines, *offers(polygons))
    ends = np.unique(snapped(np.concatenate(keep), rings, near), axis=0)
    return Laid(all_named, ends, tuple(inside), placed, near)


def named(name: str) -> str:
    """A name in the middle of a message; empty where there is none."""
    return f" {name!r}" if name else ""


def area_of(polygons: Sequence[Sequence[Floats]]) -> shapely.Geometry:
    """What polygons cover together."""
    return shapely.union_all([shapely.Polygon(rings[0], rings[1:]) for rings in polygons])


def to_the_left(drawing: Drawing, axis: Axis) -> Drawing:
    """The drawing with those of its lines and places that are to the left of an axis, lines cut at it."""
    far = 4.0 * max(extent(np.concatenate([line.points for line in drawing.lines])), 1.0) if drawing.lines else 1.0
    reach = far + float(max((np.abs(line.points - axis.start).max() for line in drawing.lines), default=0.0))
    a, b = axis.start - reach * axis.along, axis.start + reach * axis.along
    left = shapely.Polygon([a, b, b + reach * axis.left, a + reach * axis.left])
    lines = []
    for line in drawing.lines:
        pieces = parts(shapely.intersection(shapely.LineString(line.points), left), 0.0)
        lines += [replace(line, points=piece) for piece in pieces]
    places = [place for place in drawing.places if axis.offsets(np.array([[place.x, place.y]]))[0] >= 0.0]
    return replace(drawing, lines=lines, places=places)


def offers(polygons: Sequence[Sequence[Floats]]) -> list[Line]:
    """Names for the sides of what polygons cover together; none where that falls apart."""
    if len(polygons) == 1:
        return offered(polygons[0])
    whole = area_of(polygons)
    if whole.geom_type != "Polygon":
        return []
    return offered([shapely.get_coordinates(ring)[:-1] for ring in (whole.exterior, *whole.interiors)])


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
    return np.where(close[:, None], nearest, projected)


def check_within(line: Line, pieces: Sequence[Floats], polygons: Sequence[Sequence[Floats]], source: str) -> None:
    """Refuse a line of which a piece, each (m, 2) and off the outlines, lies outside of all polygons.

    Raises:
        DomainError: one does.
    """
    if not shapely.MultiLineString(list(pieces)).within(area_of(polygons)):
        start, end = shown(line.points[0]), shown(line.points[-1])
        raise DomainError(
            f"{source}: the line{named(line.name)} from {start} to {end} is not inside of a polygon; end it on the "
            "boundary, or remove it"
        )


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


def sides_of(domain: Domain, laid: Laid) -> dict[str, Ints]:
    """(k, 2) int64 segments of each name; the domain's vertices are where the lines' points are, on their chords."""
    named = [line for line in laid.lines if line.name]
    line_of = line_of_segments(domain.points, domain.segments, named, laid.near)
    return sides_by_name(domain.segments, line_of, named)


def on_their_curves(
    domains: Sequence[Domain], outlines: Sequence[Sequence[Floats]], laid: Laid
) -> tuple[list[Domain], list[CurvedEdges]]:
    """The domains with the vertices of curves on these, not on their chords; the edges that lie on curves.

    Args:
        domains: split; points that they share are equal number for number, and stay so.
        outlines: for each domain the rings that it was split from.
        laid: the lines, of which some have curves.
    """
    lines = [line for line in (*laid.lines, *laid.inside) if line.curve is not None]
    if not lines:
        return list(domains), [STRAIGHT] * len(domains)
    curved = [
        curved_edges(domain.points, domain.kept, lines, None if len(domain.lines) else rings)
        for domain, rings in zip(domains, outlines, strict=True)
    ]
    everything = np.concatenate([domain.points for domain in domains])
    points, number = np.unique(everything, axis=0, return_inverse=True)
    numbers = np.split(number.ravel(), np.cumsum([len(domain.points) for domain in domains])[:-1])
    moved = on_curves(points, together(curved, numbers))
    return [replace(domain, points=moved[ids]) for domain, ids in zip(domains, numbers, strict=True)], curved


def together(curved: Sequence[CurvedEdges], numbers: Sequence[Ints]) -> CurvedEdges:
    """The curved edges of several domains over common points; a curve that several have is one."""
    curves = list({id(curve): curve for each in curved for curve in each.curves}.values())
    index = {id(curve): i for i, curve in enumerate(curves)}
    edges = [ids[each.edges] for each, ids in zip(curved, numbers, strict=True)]
    of = [np.array([index[id(each.curves[c])] for c in each.curve_of.tolist()], dtype=np.int64) for each in curved]
    return CurvedEdges(np.concatenate(edges), np.concatenate(of), tuple(curves))
