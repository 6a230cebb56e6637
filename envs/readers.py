"""Polygon files in: GeoJSON, the paper authors' JSON, the catalogue's JSON and WKT, each to a list of rings.

Every reader returns the outer ring first, then the holes, as the file states them; :mod:`envs.polygon` validates.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from envs.polygon import from_ring_list
from envs.types import Domain, DomainError

Rings = list[Any]


def read(path: str | os.PathLike[str], *, fix_parity: bool = False) -> Domain:
    """The domain in a polygon file; its name is the file's, without the extension.

    Raises:
        DomainError: no such file, an unknown extension, a broken file, or a polygon that cannot be meshed.
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise DomainError(f"{path}: unknown extension {path.suffix!r}; use one of {', '.join(READERS)}")
    rings = reader(text_of(path), str(path))
    return renamed(from_ring_list(rings, str(path), fix_parity=fix_parity), path.stem)


def renamed(domain: Domain, name: str) -> Domain:
    """The domain under another name: messages name the whole path, tables only the stem."""
    return Domain(name=name, points=domain.points, ring=domain.ring, segments=domain.segments)


def text_of(path: Path) -> str:
    """The file's text (UTF-8, with or without a byte-order mark), not empty."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise DomainError(f"{path}: no such file; check the path") from None
    except UnicodeDecodeError as error:
        raise DomainError(f"{path}: not a text file (byte {error.start}); save it as UTF-8") from None
    except OSError as error:
        raise DomainError(f"{path}: cannot be read ({error.strerror}); check the path and its permissions") from None
    if not text.strip():
        raise DomainError(f"{path}: the file is empty; give a polygon")
    return text


def rings_of_json(text: str, source: str) -> Rings:
    """Rings of a JSON text: GeoJSON, ``{"rings": ...}``, or the authors' format (the first line a list of pairs)."""
    data = parsed_json(text, source)
    if isinstance(data, list):
        return [data]
    if isinstance(data, dict) and "rings" in data:
        if not isinstance(data["rings"], list) or not data["rings"]:
            raise DomainError(f"{source}: 'rings' is no list of rings; give the outer ring and then the holes")
        return data["rings"]
    if isinstance(data, dict) and "type" in data:
        return rings_of_geojson(data, source)
    raise DomainError(f"{source}: neither GeoJSON (no 'type') nor a list of [x, y] pairs; give one of the two")


def parsed_json(text: str, source: str) -> Any:
    """The JSON value of a text, or that of its first line when that alone is a list (the authors' files)."""
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        first = text.lstrip().splitlines()[0]
        try:
            data = json.loads(first)
        except (ValueError, RecursionError):
            data = None
        if isinstance(data, list):
            return data
        raise DomainError(
            f"{source}: line {error.lineno}, column {error.colno}: not valid JSON ({error.msg}); correct it there"
        ) from None
    except ValueError as error:
        raise DomainError(f"{source}: not valid JSON ({str(error).split(';')[0]}); correct it") from None
    except RecursionError:
        raise DomainError(f"{source}: nested too deeply for a polygon; give GeoJSON or a list of pairs") from None


def rings_of_geojson(data: dict[str, Any], source: str) -> Rings:
    """Rings of the one polygon in a GeoJSON object (RFC 7946); elevations are ignored."""
    found = polygons_of_geojson(data, source)
    if len(found) != 1:
        raise DomainError(f"{source}: {len(found)} polygons where exactly one is needed; keep one in each file")
    polygon = found[0]
    if not isinstance(polygon, list) or not polygon or not all(isinstance(ring, list) for ring in polygon):
        raise DomainError(f"{source}: 'coordinates' is no list of rings; give the outer ring and then the holes")
    return [[vertex[:2] if isinstance(vertex, list) else vertex for vertex in ring] for ring in polygon]


def polygons_of_geojson(data: Any, source: str) -> list[Any]:
    """The coordinates of every polygon in a GeoJSON object."""
    kind = data.get("type") if isinstance(data, dict) else None
    if kind == "Polygon":
        return [data.get("coordinates")]
    if kind == "MultiPolygon":
        return members(data, "coordinates", source)
    if kind == "Feature":
        return polygons_of_geojson(data.get("geometry"), source)
    if kind in ("FeatureCollection", "GeometryCollection"):
        key = "features" if kind == "FeatureCollection" else "geometries"
        return [polygon for member in members(data, key, source) for polygon in polygons_of_geojson(member, source)]
    named = f"type {kind!r}" if kind else "an object without a type"
    raise DomainError(f"{source}: GeoJSON {named} where a Polygon is needed; give a Polygon or a Feature with one")


def members(data: dict[str, Any], key: str, source: str) -> list[Any]:
    """The list under a key of a GeoJSON object."""
    found = data.get(key)
    if not isinstance(found, list):
        raise DomainError(f"{source}: {key!r} of the GeoJSON {data['type']} is no list; give one with a Polygon in it")
    return found


def rings_of_wkt(text: str, source: str) -> Rings:
    """Rings of a WKT ``POLYGON``; elevations are ignored."""
    try:
        shape = shapely.from_wkt(text.strip())
    except shapely.errors.ShapelyError as error:
        reason = str(error).splitlines()[0]
        raise DomainError(f"{source}: not valid WKT ({reason}); give POLYGON ((x y, x y, ...)), closed") from None
    parts = list(shape.geoms) if isinstance(shape, shapely.MultiPolygon) else [shape]
    if len(parts) != 1:
        raise DomainError(f"{source}: {len(parts)} polygons where exactly one is needed; keep one in each file")
    if not isinstance(parts[0], shapely.Polygon):
        raise DomainError(f"{source}: a WKT {shape.geom_type.upper()} where a POLYGON is needed; give a POLYGON")
    if parts[0].is_empty:
        raise DomainError(f"{source}: an empty POLYGON; give at least 4 vertices")
    return [np.asarray(ring.coords)[:, :2] for ring in (parts[0].exterior, *parts[0].interiors)]


READERS: dict[str, Callable[[str, str], Rings]] = {
    ".geojson": rings_of_json,
    ".json": rings_of_json,
    ".wkt": rings_of_wkt,
    ".txt": rings_of_wkt,
}
