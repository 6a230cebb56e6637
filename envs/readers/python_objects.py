"""Polygons as Python programs hold them: arrays, lists, shapely's geometries, GeoJSON-like mappings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import shapely

from envs.polygons.drawing import Drawing
from envs.readers.geojson import drawing_of_geojson, polygons_of_geojson, polygons_of_rings
from envs.readers.wkt import polygons_of_geometry
from envs.types import DomainError


def drawing_of(given: Any, source: str) -> Drawing:
    """A Python object as a drawing; see :func:`envs.domains.load.from_object`.

    Raises:
        DomainError: an object that holds no polygon.
    """
    if isinstance(given, Drawing):
        return given
    stated = getattr(given, "__geo_interface__", given) if not isinstance(given, shapely.Geometry) else given
    if isinstance(stated, Mapping) and "rings" not in stated:
        return drawing_of_geojson(stated, source)
    return Drawing(polygons_of(given, source))


def polygons_of(given: Any, source: str) -> list[list[Any]]:
    """The rings of every polygon in a Python object; see :func:`envs.domains.load.from_object`.

    Raises:
        DomainError: an object that holds no polygon.
    """
    if isinstance(given, shapely.Geometry):
        return polygons_of_geometry(given, source)
    if isinstance(given, Mapping):
        if "rings" in given:
            return polygons_of_rings(given, source)
        return polygons_of_geojson(given, source)
    if hasattr(given, "__geo_interface__"):
        return polygons_of_geojson(given.__geo_interface__, source)
    if is_list(given) and len(given) and all(isinstance(geometry, shapely.Geometry) for geometry in given):
        return [rings for geometry in given for rings in polygons_of_geometry(geometry, source)]
    depth = depth_of(given)
    if depth == 2:
        return [[given]]
    if depth == 3:
        return [list(given)]
    if depth == 4 and all(is_list(rings) and len(rings) for rings in given):
        return [list(rings) for rings in given]
    raise DomainError(
        f"{source}: a {type(given).__name__} where a polygon is needed; give an (n, 2) array, a list of rings, a "
        "shapely Polygon or a GeoJSON mapping"
    )


def depth_of(value: Any) -> int:
    """How many lists deep the first number of a nested list lies: 2 for a ring, 3 for rings, 4 for polygons."""
    depth = 0
    while is_list(value):
        depth += 1
        if not len(value) or depth > 4:
            break
        value = value[0]
    return depth


def is_list(value: Any) -> bool:
    """Whether a value is a list, a tuple or an array with at least one axis."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)
