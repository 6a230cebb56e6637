"""GeoJSON (RFC 7946) and the catalogue's ``{"rings": ...}``: polygons, lines and points with their names.

A Feature's property ``name``, or else ``material``, is the name of what it holds; ``"crack": true`` makes its lines
cracks. Elevations are ignored.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from envs.polygons.drawing import Drawing, Line, Place
from envs.polygons.rings import check_coordinates, check_count, is_number
from envs.readers.file_check import excerpt
from envs.readers.stated_points import check_line
from envs.types import DomainError, Floats

#: Collections in collections at most.
DEPTH = 20

#: Properties that are names, the first that a Feature has.
NAMES = ("name", "material")

#: What each geometry's coordinates are.
POLYGONS, LINES, POINTS = ("Polygon", "MultiPolygon"), ("LineString", "MultiLineString"), ("Point", "MultiPoint")


@dataclass(frozen=True)
class Part:
    """A geometry that is no collection, with what its Feature says.

    Attributes:
        stated: its type, one of `POLYGONS`, `LINES`, `POINTS` without Multi.
        coordinates: as the file has them.
        name: empty: none.
        crack: whether its lines are cracks.
    """

    stated: str
    coordinates: Any
    name: str
    crack: bool


def drawing_of_geojson(data: Mapping[str, Any], source: str) -> Drawing:
    """What a GeoJSON object states; the names of polygons are those of regions.

    Raises:
        DomainError: no polygon in it, another geometry, or coordinates that are none.
    """
    polygons, regions, lines, places = list[list[Any]](), list[str](), list[Line](), list[Place]()
    total = 0
    for part in parts_of(data, source):
        if part.stated == "Polygon":
            polygons.append(rings_of(part.coordinates, source))
            regions.append(part.name)
            continue
        rows = [part.coordinates] if part.stated == "Point" else part.coordinates
        points = points_of(rows, part.stated, source)
        total += len(points)
        check_count(total, source)
        if part.stated == "Point":
            x, y = points[0].tolist()
            places.append(Place(x, y, part.name))
        else:
            lines.append(Line(points, name=part.name, crack=part.crack))
    if not polygons and (lines or places):
        raise DomainError(f"{source}: GeoJSON of lines and points alone; give a Polygon, too, that they lie in")
    return Drawing(polygons, tuple(regions) if any(regions) else (), lines, places)


def polygons_of_geojson(data: Mapping[str, Any], source: str) -> list[list[Any]]:
    """The rings of every polygon in a GeoJSON object: an outer ring, then its holes.

    Raises:
        DomainError: as `drawing_of_geojson`.
    """
    return [list(rings) for rings in drawing_of_geojson(data, source).polygons]


def parts_of(data: Any, source: str, name: str = "", crack: bool = False, depth: int = 0) -> Iterator[Part]:
    """Every geometry in a GeoJSON object, the members of Multi-geometries one by one."""
    if depth > DEPTH:
        raise DomainError(f"{source}: GeoJSON nested more than {DEPTH} deep; give a Polygon or a Feature with one")
    stated = data.get("type") if isinstance(data, Mapping) else None
    if stated in (POLYGONS[0], LINES[0], POINTS[0]):
        yield Part(stated, data.get("coordinates"), name, crack)
    elif stated in (POLYGONS[1], LINES[1], POINTS[1]):
        single = str(stated).removeprefix("Multi")
        yield from (Part(single, member, name, crack) for member in members(data, "coordinates", source))
    elif stated == "Feature":
        given = data.get("properties")
        properties = given if isinstance(given, Mapping) else {}
        named = name_of(properties, source)
        yield from parts_of(data.get("geometry"), source, named, properties.get("crack") is True, depth + 1)
    elif stated in ("FeatureCollection", "GeometryCollection"):
        key = "features" if stated == "FeatureCollection" else "geometries"
        for member in members(data, key, source):
            yield from parts_of(member, source, name, crack, depth + 1)
    else:
        told = f"type {stated[:40]!r}" if isinstance(stated, str) else "an object without a type"
        raise DomainError(f"{source}: GeoJSON {told} where a Polygon is needed; give a Polygon or a Feature with one")


def name_of(properties: Mapping[str, Any], source: str) -> str:
    """The name that a Feature's properties give; empty where they give none."""
    given = next((properties[key] for key in NAMES if properties.get(key) is not None), "")
    if not (isinstance(given, str) or is_number(type(given))):
        raise DomainError(f"{source}: {excerpt(repr(given))} as a Feature's name; give a text")
    return str(given).strip()


def points_of(coordinates: Any, stated: str, source: str) -> Floats:
    """(k, 2) places of a line's or a point's coordinates, k >= 2 for a line."""
    least = 2 if stated == "LineString" else 1
    fix = f"give a {stated} {'[[x, y], [x, y], ...]' if least == 2 else '[x, y]'}"
    rows = coordinates if is_list(coordinates) else ()
    if len(rows) < least or not all(is_list(row) and len(row) >= 2 for row in rows):
        raise DomainError(f"{source}: 'coordinates' of a {stated} are no list of [x, y] pairs; {fix}")
    for row in rows:
        if not all(is_number(type(value)) for value in row[:2]):
            raise DomainError(f"{source}: {excerpt(repr(row))} in a {stated} where [x, y] is needed; {fix}")
    try:
        points = np.array([row[:2] for row in rows], dtype=np.float64)
    except OverflowError:
        raise DomainError(f"{source}: a {stated} with a coordinate that is too large; correct it") from None
    if least == 2:
        check_line(points, source, f"a {stated}")
    else:
        check_coordinates(points, source, lambda _: f"a {stated}")
    return points


def members(data: Mapping[str, Any], key: str, source: str) -> list[Any]:
    """The list under a key of a GeoJSON object."""
    found = data.get(key)
    if not is_list(found):
        raise DomainError(f"{source}: {key!r} of the GeoJSON {data['type']} is no list; give one with a Polygon in it")
    return list(found)  # type: ignore[arg-type]


def rings_of(polygon: Any, source: str) -> list[Any]:
    """The rings of a polygon's coordinates, each vertex cut to x and y."""
    if not is_list(polygon) or not polygon or not all(is_list(ring) for ring in polygon):
        raise DomainError(f"{source}: 'coordinates' is no list of rings; give the outer ring and then the holes")
    return [[vertex[:2] if is_list(vertex) else vertex for vertex in ring] for ring in polygon]


def polygons_of_rings(data: Mapping[str, Any], source: str) -> list[list[Any]]:
    """The one polygon of ``{"rings": [outer, hole, ...]}``."""
    rings = data["rings"]
    if not is_list(rings) or not len(rings):
        raise DomainError(f"{source}: 'rings' is no list of rings; give the outer ring and then the holes")
    return [list(rings)]


def is_list(value: Any) -> bool:
    """Whether a value is what JSON calls an array; Python's own GeoJSON-like objects hold tuples."""
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)
