"""WKT: ``POLYGON``, ``MULTIPOLYGON``, or a ``GEOMETRYCOLLECTION`` of these with lines and points; no elevations."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from envs.polygons.drawing import Drawing, Line, Place, Reading
from envs.polygons.rings import check_coordinates
from envs.readers.file_check import excerpt, text_of
from envs.readers.stated_points import check_line
from envs.types import DomainError

#: What WKT has beside polygons and collections.
OTHERS = (
    "POINT", "LINESTRING", "MULTIPOINT", "MULTILINESTRING", "CIRCULARSTRING", "CURVEPOLYGON", "COMPOUNDCURVE",
    "MULTICURVE", "MULTISURFACE", "TRIANGLE", "TIN", "POLYHEDRALSURFACE",
)  # fmt: skip

#: Collections in collections at most: GEOS reads them by recursion, many in each other would overflow its stack.
DEPTH = 20

#: Parentheses of a geometry that is no collection.
PARENTHESES = 3


def drawing_of_file(path: Path, reading: Reading) -> Drawing:
    """What a WKT file states.

    Raises:
        DomainError: no WKT, or no polygon in it.
    """
    source, text = str(path), text_of(path).strip()
    fix = "give POLYGON ((x y, x y, ...)), closed"
    word = re.match(r"[A-Za-z]*", text).group().upper()  # type: ignore[union-attr]
    if not word.startswith(("POLYGON", "MULTIPOLYGON", "LINEARRING", "GEOMETRYCOLLECTION")):
        if word.startswith(OTHERS):
            raise DomainError(f"{source}: a {word} where a POLYGON is needed; give a POLYGON")
        raise DomainError(f"{source}: not valid WKT (it begins with {excerpt(text, 20)!r}); {fix}")
    if depth_of(text) > DEPTH + PARENTHESES:
        raise DomainError(f"{source}: collections nested more than {DEPTH} deep; give one of POLYGONs")
    try:
        geometry = shapely.from_wkt(text)
    except shapely.errors.ShapelyError as error:
        raise DomainError(f"{source}: not valid WKT ({excerpt(str(error), 100)}); {fix}") from None
    return drawing_of_geometry(geometry, source)


def depth_of(text: str) -> int:
    """How many parentheses are open at most."""
    characters = np.frombuffer(text.encode(), dtype=np.uint8)
    steps = (characters == ord("(")).astype(np.int8) - (characters == ord(")")).astype(np.int8)
    return int(np.cumsum(steps, dtype=np.int64).max(initial=0))


def drawing_of_geometry(geometry: shapely.Geometry, source: str) -> Drawing:
    """What a shapely Polygon, LinearRing, MultiPolygon, or a collection with lines and points states.

    Raises:
        DomainError: no polygon in it, or an empty one.
    """
    if isinstance(geometry, shapely.LinearRing):
        geometry = shapely.Polygon(geometry)
    collection = isinstance(geometry, shapely.GeometryCollection)
    polygons, lines, places = list[list[Any]](), list[Line](), list[Place]()
    for member in members_of(geometry):
        if isinstance(member, shapely.Polygon) and member.is_empty:
            raise DomainError(f"{source}: an empty POLYGON; give at least 4 vertices")
        if isinstance(member, shapely.Polygon):
            polygons.append([np.asarray(ring.coords)[:, :2] for ring in (member.exterior, *member.interiors)])
        elif collection and not member.is_empty and isinstance(member, shapely.LineString | shapely.Point):
            points = shapely.get_coordinates(member)
            if isinstance(member, shapely.Point):
                check_coordinates(points, source)
                places.append(Place(*points[0].tolist()))
            else:
                check_line(points, source, "a LINESTRING")
                lines.append(Line(points))
        else:
            empty = "an empty" if member.is_empty else "a"
            raise DomainError(f"{source}: {empty} {member.geom_type.upper()} where a POLYGON is needed; give a POLYGON")
    if not polygons:
        raise DomainError(f"{source}: no POLYGON in the {geometry.geom_type.upper()}; give one with a POLYGON in it")
    return Drawing(polygons, lines=lines, places=places)


def members_of(geometry: shapely.Geometry) -> Iterator[shapely.Geometry]:
    """A geometry, or what a Multi-geometry or a collection holds, whatever it is nested in."""
    if isinstance(geometry, shapely.geometry.base.BaseMultipartGeometry):
        for member in geometry.geoms:
            yield from members_of(member)
    else:
        yield geometry


def polygons_of_geometry(geometry: shapely.Geometry, source: str) -> list[list[Any]]:
    """The rings of a shapely Polygon, LinearRing or MultiPolygon, each (n, 2), closed.

    Raises:
        DomainError: as `drawing_of_geometry`.
    """
    return [list(rings) for rings in drawing_of_geometry(geometry, source).polygons]
