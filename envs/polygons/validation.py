"""Coordinates become domains: the whole way, top to bottom.

::

    polygons  -- checked -->  valid rings  -- joined -->  domains
                               |         ^
                          discretised  checked again: coarse segments may cross where the outline did not
                               v         |
                         rings of even totals
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike

from envs.errors import UserError
from envs.polygons import ring_with_seams, seam
from envs.polygons.axis import axis_of
from envs.polygons.close_places import close_sizes
from envs.polygons.deviation import deviation
from envs.polygons.discretisation import NOWHERE, discretised
from envs.polygons.drawing import Drawing
from envs.polygons.element_count import check_elements, expected_in_rings
from envs.polygons.faces import Face, divided
from envs.polygons.geometry import Geometry, Region, laid, on_their_curves, sides_of, to_the_left
from envs.polygons.halves import halves
from envs.polygons.overlaps import check_overlaps
from envs.polygons.parity import with_even_count
from envs.polygons.periodic import periodic_sides
from envs.polygons.rings import (
    EDGE_LENGTH,
    OUTER_LEAST,
    as_ring,
    check_count,
    check_crossings,
    check_distinct,
    check_least,
    check_nesting,
    segment_graph,
)
from envs.polygons.size_cells import Size, cells
from envs.polygons.size_within import within
from envs.polygons.sizing import CURVATURE, check_sizes
from envs.polygons.slits import slit_domain
from envs.polygons.with_lines import faces_with_lines
from envs.printable import printable
from envs.types import Domain, DomainError, Floats, WantedSizes


def domains_of(polygons: Sequence[Sequence[ArrayLike]], name: str, source: str, **options: Any) -> list[Domain]:
    """The domain of each polygon, with common points where they share their boundary.

    Args:
        polygons: for each its rings, the outer one first; nothing is checked yet. A ring alone may walk seams to its
            holes.
        name, source, options: see `geometry_of`.

    Raises:
        DomainError, UserError: as `geometry_of`.
    """
    return [region.domain for region in geometry_of(Drawing(polygons), name, source, **options).regions]


def geometry_of(
    drawing: Drawing,
    name: str,
    source: str,
    *,
    fix_parity: bool = False,
    edge_length: float | None = None,
    grading: float = 1.0,
    curvature: float = CURVATURE,
    size: Size | Floats | None = None,
    allow_large: bool = False,
    room: Callable[[float, str], None] | None = None,
    mirror: str | Sequence[Sequence[float]] | None = None,
    periodic: Sequence[tuple[str, str]] = (),
    numbers: Sequence[int] | None = None,
    odd: bool = False,
) -> Geometry:
    """The regions of a drawing, with common points where they share their boundary.

    Args:
        drawing: nothing of it is checked yet.
        name: the domain's name; several are called ``name[0]``, ``name[1]``, ...
        source: what messages begin with.
        fix_parity: split the longest segment when a polygon's total of vertices is odd.
        edge_length: discretise the outlines by this length; their totals are then even.
        grading: largest size over the smallest, 1 to 1000; needs an edge length, or a size.
        curvature: segments for a full turn of an arc, 4 to 180, where outlines are discretised.
        size: discretise the outlines by this size, and by the edge length where that is less: a function of (m, 2)
            places to (m,) edge lengths, asked inside the polygons alone, or (m, 3) rows x, y and an edge length.
        allow_large: also where an edge length asks for a mesh of more than ``element_count.MOST_ELEMENTS``.
        room: called, before the outlines are split, with the elements that are expected of all of them and what
            messages begin with; raises an error where there is no room for so many.
        mirror: an axis of symmetry, ``x``, ``y``, ``x0,y0,x1,y1`` or two points: the half to its left alone.
        periodic: pairs of names of sides that get the same points.
        numbers: what the polygons, and their domains unless lines divide them, are numbered by; None: 0, 1, ...
        odd: also with odd totals, of which there is no mesh: to look at the outlines alone.

    Raises:
        DomainError: the first polygon that cannot be meshed, with its number when there are several; a line that lies
            outside.
        UserError: a size that is none; no room.
    """
    check_sizes(edge_length, grading, curvature, source, sized=size is not None)
    name, polygons = printable(name), drawing.polygons
    sources = numbered(source, len(polygons), ": polygon {}", numbers)
    split = edge_length is not None or size is not None or (fix_parity and len(polygons) > 1)
    # What is wrong with an outline is said in terms of its own vertices, before it gets others.
    least = 3 if split else OUTER_LEAST
    outlines = [checked(rings, where, least) for rings, where in zip(polygons, sources, strict=True)]
    regions = list(drawing.regions) or [""] * len(outlines)
    axis = None
    if mirror is not None:
        check_no_seams(outlines, sources)
        axis = axis_of(mirror, source)
        parts = halves(outlines, axis, source)
        outlines, regions = [half.rings for half in parts], [regions[half.of] for half in parts]
        sources = [sources[half.of] for half in parts]
        drawing = to_the_left(drawing, axis)
    lines = laid(drawing, outlines, source)
    pairs = [
        periodic_sides(lines.named(a, source), lines.named(b, source), outlines, source, (a, b)) for a, b in periodic
    ]
    faces = [Face(rings, NOWHERE, NOWHERE, p) for p, rings in enumerate(outlines)]
    if lines.divide:
        check_no_seams(outlines, sources)
        inside = [line.points for line in lines.inside]
        faces = (divided if split else faces_with_lines)(outlines, inside, lines.places, source)
    if len(outlines) > 1:
        check_overlaps(outlines, sources, lines.near)
    sources = [sources[face.polygon] for face in faces]
    valid, deviations = [face.rings for face in faces], [0.0] * len(faces)
    if split:
        wanted = None if size is None else wanted_at(size, outlines)
        if wanted is not None:
            edge_length = largest_wanted(size, wanted, edge_length)
        if edge_length is not None:
            expected = [expected_in_rings(face.rings, edge_length) for face in faces]
            if not allow_large:
                for each, where in zip(expected, sources, strict=True):
                    check_elements(each, where)
            if room is not None:
                room(sum(expected), source)
        if edge_length is not None and lines.divide:
            close = close_sizes(faces, edge_length)
            wanted = close if wanted is None else np.concatenate([wanted, close])
        fine = discretised(
            valid, source, edge_length=edge_length, grading=grading, curvature=curvature,
            wanted=wanted if wanted is not None and len(wanted) else None,
            size=within(size, outlines) if callable(size) else None,
            keep=np.concatenate([lines.keep, *(face.marks for face in faces)]), periodic=pairs,
        )  # fmt: skip
        if edge_length is not None:
            deviations = [deviation(before, after) for before, after in zip(valid, fine, strict=True)]
        valid = [
            rings if lines.divide else checked_again(rings, where, edge_length)
            for rings, where in zip(fine, sources, strict=True)
        ]
    names = numbered(name, len(faces), "[{}]", numbers if numbers and len(faces) == len(numbers) else None)
    domains = [
        slit_domain(called, rings, face.places, where)
        if lines.divide
        else joined(rings, called, where, fix_parity, odd)
        for face, rings, called, where in zip(faces, valid, names, sources, strict=True)
    ]
    domains = [replace(domain, deviation=off) for domain, off in zip(domains, deviations, strict=True)]
    sides = [sides_of(domain, lines) for domain in domains]
    domains, curved = on_their_curves(domains, [outlines[face.polygon] for face in faces], lines)
    return Geometry(
        name,
        tuple(
            Region(domain, regions[face.polygon], named, on_curves)
            for domain, face, named, on_curves in zip(domains, faces, sides, curved, strict=True)
        ),
        lines.inside,
        tuple(drawing.places),
        axis,
        any([*regions, *(line.name for line in drawing.lines), *(place.name for place in drawing.places)]),
        tuple(drawing.notes),
        tuple(pairs),
    )


def numbered(name: str, count: int, form: str, numbers: Sequence[int] | None = None) -> list[str]:
    """The name, or where several have it, or have numbers, one for each, followed by its number in a form."""
    if numbers is None:
        return [name] if count == 1 else [name + form.format(i) for i in range(count)]
    return [name + form.format(i) for i in numbers]


def check_no_seams(outlines: Sequence[Sequence[Floats]], sources: Sequence[str]) -> None:
    """Refuse outlines that walk seams, which lines inside would have to cross.

    Raises:
        DomainError: one does.
    """
    for rings, where in zip(outlines, sources, strict=True):
        if has_seams(rings):
            raise DomainError(f"{where}: lines or points inside of a ring that walks seams; give its holes as rings")


def wanted_at(size: Size | Floats, polygons: Sequence[Sequence[Floats]]) -> Floats:
    """(m, 3) float64, x, y and the edge length wanted there: rows as they are, or a function's values in cells.

    Args:
        size: see `domains_of`.
        polygons: valid rings, for each the outer one first.

    Raises:
        UserError: rows that are none, none of them near the polygons, or a function's value that is no size.
    """
    points = np.concatenate([ring for rings in polygons for ring in rings])
    low, high = points.min(axis=0), points.max(axis=0)
    if callable(size):
        return cells(within(size, polygons), low, high).points
    rows = WantedSizes(points=np.asarray(size, dtype=np.float64)).points
    if not len(rows):
        raise UserError("points with sizes: no points; give rows x, y and a size")
    beyond = np.maximum(np.maximum(low - rows[:, :2], rows[:, :2] - high), 0.0).max(axis=1)
    if beyond.min() > float((high - low).max()):
        x, y = rows[beyond.argmin(), :2]
        raise UserError(
            f"points with sizes: the nearest one, ({x:g}, {y:g}), is far from the domain, ({low[0]:g}, {low[1]:g}) to "
            f"({high[0]:g}, {high[1]:g}); give both in the same units"
        )
    return rows


def largest_wanted(size: Size | Floats | None, wanted: Floats, edge_length: float | None) -> float:
    """The largest edge length of a boundary: of rows, which say nothing of places further away, the one given if any.

    Args:
        size, edge_length: see `domains_of`.
        wanted: see `wanted_at`.
    """
    largest = float(wanted[:, 2].max())
    if edge_length is None:
        return largest
    return min(largest, edge_length) if callable(size) else edge_length


def checked(rings: Sequence[ArrayLike], source: str, least: int = OUTER_LEAST) -> list[Floats]:
    """Valid rings, each (n, 2): none crosses or touches itself or another, and the holes lie side by side.

    Args:
        rings: the outer one first; one alone may walk seams to its holes.
        source: what messages begin with.
        least: vertices that an outer ring needs.

    Raises:
        DomainError: what makes them unfit for a mesh of quadrilaterals: source, place and fix in one line.
    """
    valid = [as_ring(ring, source, i, least=least) for i, ring in enumerate(rings)]
    if has_seams(valid):
        ring_with_seams.check(source, valid[0])
    else:
        check_apart(valid, source)
    return valid


def check_apart(rings: Sequence[Floats], source: str) -> None:
    """Refuse rings, the outer one first, that meet themselves or each other, and holes that are not side by side."""
    graph = segment_graph(rings, source)
    check_distinct(graph)
    check_crossings(graph)
    check_nesting(rings, source)


def checked_again(rings: list[Floats], source: str, edge_length: float | None) -> list[Floats]:
    """Discretised rings, still valid; a midpoint more, where there was no edge length, breaks nothing."""
    if edge_length is None:
        check_least(len(rings[0]), source)
        return rings
    try:
        return checked(rings, source)
    except DomainError as error:
        told = str(error).removeprefix(f"{source}: ").partition(";")[0]
        raise DomainError(
            f"{source}: with edge length {edge_length:g} the boundary is too coarse: {told}; use a smaller "
            f"{EDGE_LENGTH}"
        ) from None


def joined(rings: list[Floats], name: str, source: str, fix_parity: bool, odd: bool = False) -> Domain:
    """The domain of valid rings.

    Raises:
        DomainError: too many vertices, or an odd total without ``fix_parity`` or ``odd``.
    """
    if has_seams(rings):
        return ring_with_seams.opened(name, source, rings[0], fix_parity, odd)
    check_count(sum(len(ring) for ring in rings), source, holes=len(rings) > 1)
    return seam.join(name, rings if odd else with_even_count(rings, source, fix_parity))


def has_seams(rings: Sequence[Floats]) -> bool:
    """Whether one ring alone visits points more than once: it walks seams, or pinches itself."""
    return len(rings) == 1 and len(np.unique(rings[0], axis=0)) < len(rings[0])


def from_rings(
    outer: ArrayLike, holes: Sequence[ArrayLike] = (), name: str = "polygon", *, fix_parity: bool = False
) -> Domain:
    """The domain inside an outer ring and outside some holes.

    Either orientation is accepted; a closing point that repeats the first is dropped; no coordinate is moved.

    Args:
        outer: n >= 4 pairs of numbers.
        holes: each n >= 3 pairs of numbers.
        name: what messages, tables and files call the domain.
        fix_parity: split the longest segment at its midpoint when the total number of vertices is odd.

    Returns:
        The domain; its points are the outer ring's in counter-clockwise order, each hole's, then the seams'.

    Raises:
        DomainError: what makes it unfit for a mesh of quadrilaterals: source, place and fix in one line.
    """
    rings = [as_ring(ring, name, i) for i, ring in enumerate([outer, *holes])]
    check_apart(rings, name)
    return joined(rings, name, name, fix_parity)


def from_ring_with_seam(ring: ArrayLike, name: str = "polygon", *, fix_parity: bool = False) -> Domain:
    """The domain of one ring that may walk seams to its holes; without repeated points, as :func:`from_rings`.

    Repeated points are accepted where they form seams: every edge between them walked once in each direction, the
    inside to the left throughout. The two sides of a seam must be equal number for number.

    Raises:
        DomainError: as :func:`from_rings`; repeated points that are no seam are a pinch.
    """
    return joined(checked([ring], name), name, name, fix_parity)


def from_polygon(polygon: shapely.Polygon, name: str = "polygon", *, fix_parity: bool = False) -> Domain:
    """The domain of a shapely polygon; see :func:`from_rings`."""
    if not isinstance(polygon, shapely.Polygon):
        raise DomainError(f"{name}: a {type(polygon).__name__} where a Polygon is needed; give one polygon")
    if polygon.is_empty:
        raise DomainError(f"{name}: an empty polygon; give at least 4 vertices")
    rings = [np.asarray(ring.coords)[:, :2] for ring in (polygon.exterior, *polygon.interiors)]
    return joined(checked(rings, name), name, name, fix_parity)
