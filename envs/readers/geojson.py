"""GeoJSON (RFC 7946) and the catalogue's ``{"rings": ...}``: the polygons of an object, elevations ignored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from envs.types import DomainError

#: Collections in collections at most.
DEPTH = 20


def polygons_of_geojson(data: Mapping[str, Any], source: str) -> list[list[Any]]:
    """The rings of every polygon in a GeoJSON object: an outer ring, then its holes.

    Raises:
        DomainError: another geometry than polygons, or coordinates that are no rings.
    """
    return [rings_of(coordinates, source) for coordinates in coordinates_of(data, source)]


def coordinates_of(data: Any, source: str, depth: int = 0) -> list[Any]:
    """The coordinates of every polygon in a GeoJSON object."""
    if depth > DEPTH:
        raise DomainError(f"{source}: GeoJSON nested more than {DEPTH} deep; give a Polygon or a Feature with one")
    stated = data.get("type") if isinstance(data, Mapping) else None
    if stated == "Polygon":
        return [data.get("coordinates")]
    if stated == "MultiPolygon":
        return members(data, "coordinates", source)
    if stated == "Feature":
        return coordinates_of(data.get("geometry"), source, depth + 1)
    if stated in ("FeatureCollection", "GeometryCollection"):
        key = "features" if stated == "FeatureCollection" else "geometries"
        return [found for member in members(data, key, source) for found in coordinates_of(member, source, depth + 1)]
    named = f"type {stated[:40]!r}" if isinstance(stated, str) else "an object without a type"
    raise DomainError(f"{source}: GeoJSON {named} where a Polygon is needed; give a Polygon or a Feature with one")


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
