"""WKT: ``POLYGON`` and ``MULTIPOLYGON``, elevations ignored."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from envs.readers.source import excerpt, text_of
from envs.types import DomainError

#: What WKT has beside polygons.
OTHERS = (
    "POINT", "LINESTRING", "MULTIPOINT", "MULTILINESTRING", "GEOMETRYCOLLECTION", "CIRCULARSTRING", "CURVEPOLYGON",
    "COMPOUNDCURVE", "MULTICURVE", "MULTISURFACE", "TRIANGLE", "TIN", "POLYHEDRALSURFACE",
)  # fmt: skip


def polygons_of_file(path: Path, edge_length: float | None = None) -> list[list[Any]]:
    """The rings of every polygon in a WKT file."""
    source, text = str(path), text_of(path).strip()
    fix = "give POLYGON ((x y, x y, ...)), closed"
    word = re.match(r"[A-Za-z]*", text).group().upper()  # type: ignore[union-attr]
    if not word.startswith(("POLYGON", "MULTIPOLYGON", "LINEARRING")):
        # GEOS reads collections by recursion: many in each other would overflow its stack.
        if word.startswith(OTHERS):
            raise DomainError(f"{source}: a {word} where a POLYGON is needed; give a POLYGON")
        raise DomainError(f"{source}: not valid WKT (it begins with {excerpt(text, 20)!r}); {fix}")
    try:
        geometry = shapely.from_wkt(text)
    except shapely.errors.ShapelyError as error:
        raise DomainError(f"{source}: not valid WKT ({excerpt(str(error), 100)}); {fix}") from None
    return polygons_of_geometry(geometry, source)


def polygons_of_geometry(geometry: shapely.Geometry, source: str) -> list[list[Any]]:
    """The rings of a shapely Polygon, LinearRing or MultiPolygon, each (n, 2), closed."""
    if isinstance(geometry, shapely.LinearRing):
        geometry = shapely.Polygon(geometry)
    members = list(geometry.geoms) if isinstance(geometry, shapely.MultiPolygon) else [geometry]
    for member in members:
        if not isinstance(member, shapely.Polygon):
            raise DomainError(f"{source}: a {member.geom_type.upper()} where a POLYGON is needed; give a POLYGON")
        if member.is_empty:
            raise DomainError(f"{source}: an empty POLYGON; give at least 4 vertices")
    return [[np.asarray(ring.coords)[:, :2] for ring in (member.exterior, *member.interiors)] for member in members]
