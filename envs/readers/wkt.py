"""WKT: ``POLYGON`` and ``MULTIPOLYGON``, elevations ignored."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import shapely

from envs.readers.source import text_of
from envs.types import DomainError


def polygons_of_wkt(path: Path, edge_length: float | None = None) -> list[list[Any]]:
    """The rings of every polygon in a WKT file."""
    source = str(path)
    try:
        shape = shapely.from_wkt(text_of(path).strip())
    except shapely.errors.ShapelyError as error:
        reason = str(error).splitlines()[0]
        raise DomainError(f"{source}: not valid WKT ({reason}); give POLYGON ((x y, x y, ...)), closed") from None
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
