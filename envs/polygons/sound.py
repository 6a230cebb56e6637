"""Of a drawing's polygons those that can be meshed, where others cannot: these are left out, and told."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from envs.polygons.drawing import Drawing
from envs.polygons.geometry import Geometry, laid
from envs.polygons.named_sides import tolerance
from envs.polygons.overlaps import overlaps
from envs.polygons.rings import place
from envs.polygons.validation import checked, geometry_of
from envs.types import DomainError, Floats

#: Called with the number of a polygon that is left out, or None for a line or a point, and why.
LeftOut = Callable[[int | None, str], None]


def sound_geometry(drawing: Drawing, name: str, source: str, left_out: LeftOut, **options: Any) -> Geometry:
    """The regions of a drawing, as `validation.geometry_of`, without those polygons that cannot be meshed.

    Args:
        drawing: nothing of it is checked yet.
        name: the domain's name; of several polygons each keeps its number, ``name[7]``, whatever is left out.
        source: what messages begin with.
        left_out: called with each polygon, line and point that is left out.
        options: of `geometry_of`.

    Raises:
        DomainError: no polygon can be meshed: what is wrong with the first; or something that is no polygon's fault.
        UserError: as `geometry_of`.
    """
    count = len(drawing.polygons)
    try:
        return geometry_of(drawing, name, source, **options)
    except DomainError as error:
        if count == 1 or options.get("mirror") is not None:
            raise
        first = error
    wrong = wrong_alone(drawing, name, source, options)
    for number, why in wrong.items():
        left_out(number, why)
    kept = [p for p in range(count) if p not in wrong]
    for number, why in overlapping(drawing.polygons, kept, source).items() if kept else []:
        left_out(number, why)
        kept.remove(number)
    while kept:
        some = part_of(drawing, kept)
        some = with_lines_inside(some, source, left_out)
        try:
            return geometry_of(some, name, source, numbers=kept, **options)
        except DomainError as error:
            # What is fine alone may not be beside others: the message names it.
            told = re.match(re.escape(source) + r": polygon (\d+)\b", str(error))
            if told is None or int(told[1]) not in kept:
                raise
            left_out(int(told[1]), str(error))
            kept.remove(int(told[1]))
    raise first


def wrong_alone(drawing: Drawing, name: str, source: str, options: dict[str, Any]) -> dict[int, str]:
    """By number, the polygons that cannot be meshed even by themselves, and why."""
    wrong = {}
    for p in range(len(drawing.polygons)):
        alone = replace(part_of(drawing, [p]), lines=(), places=())
        try:
            # Periodic sides have their names from lines, and may be of two polygons.
            geometry_of(alone, name, f"{source}: polygon {p}", **{**options, "periodic": ()})
        except DomainError as error:
            wrong[p] = str(error)
    return wrong


def part_of(drawing: Drawing, kept: Sequence[int]) -> Drawing:
    """The drawing with some of its polygons."""
    regions = [drawing.regions[p] for p in kept] if drawing.regions else ()
    return replace(drawing, polygons=[drawing.polygons[p] for p in kept], regions=regions)


def overlapping(polygons: Sequence[Sequence[Any]], kept: Sequence[int], source: str) -> dict[int, str]:
    """By number, the polygons to leave out so that no two overlap, the later of each two, and why."""
    outlines = outlines_of([polygons[p] for p in kept], source)
    gone: dict[int, str] = {}
    for i, j, common in overlaps(outlines, tolerance(outlines)):
        a, b = kept[i], kept[j]
        if a not in gone and b not in gone:
            where = place(common.point_on_surface().coords[0])
            gone[b] = f"{source}: polygon {b}: overlaps polygon {a} at {where}; cut it off one of the two"
    return gone


def outlines_of(polygons: Sequence[Sequence[Any]], source: str) -> list[list[Floats]]:
    """Polygons that are fine each by itself, as their rings."""
    return [checked(rings, source, 3) for rings in polygons]


def with_lines_inside(drawing: Drawing, source: str, left_out: LeftOut) -> Drawing:
    """The drawing without those of its lines and points that lie outside of its polygons, which are told."""
    outlines = outlines_of(drawing.polygons, source)
    parts: dict[str, list[Any]] = {"lines": [], "places": []}
    for kind, found in parts.items():
        for each in getattr(drawing, kind):
            alone = replace(drawing, lines=(), places=())
            try:
                laid(replace(alone, **{kind: [each]}), outlines, source)
            except DomainError as error:
                left_out(None, str(error))
            else:
                found.append(each)
    return replace(drawing, **parts)
