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


def polygons_of_wkt(path: Path, edge_length: float | None = None) -> list[list[Any]]:
    """The rings of every polygon in a WKT file."""
    source, text = str(path), text_of(path).strip()
    fix = "give POLYGON ((x y, x y, ...)), closed"
    kind = re.match(r"[A-Za-z]*", text).group().upper()  # type: ignore[union-attr]
    if not kind.startswith(("POLYGON", "MULTIPOLYGON", "LINEARRING")):
        # GEOS reads collections by recursion: many in each other would overflow its stack.
        if kind.startswith(OTHERS):
            raise DomainError(f"{source}: a {kind} where a POLYGON is needed; give a POLYGON")
        raise DomainError(f"{source}: not valid WKT (it begins with {excerpt(text, 20)!r}); {fix}")
    try:
        shape = shapely.from_wkt(text)
    except shapely.errors.ShapelyError as error:
        raise DomainError(f"{source}: not valid WKT ({excerpt(str(error), 100)}); {fix}") from None
    return polygons_of_shape(shape, source)


def polygons_of_shape(shape: shapely.Geometry, source: str) -> list[list[Any]]:
    """The rings of a shapely Polygon, LinearRing or MultiPolygon, each (n, 2), closed."""
    if isinstance(shape, shapely.LinearRing):
        shape = shapely.Polygon(shape)
    parts = list(shape.geoms) if isinstance(shape, shapely.MultiPolygon) else [shape]
    for part in parts:
        if not isinstance(part, shapely.Polygon):
            raise DomainError(f"{source}: a {part.geom_type.upper()} where a POLYGON is needed; give a POLYGON")
        if part.is_empty:
            raise DomainError(f"{source}: an empty POLYGON; give at least 4 vertices")
    return [[np.asarray(ring.coords)[:, :2] for ring in (part.exterior, *part.interiors)] for part in parts]
