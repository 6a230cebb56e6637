"""JSON files: GeoJSON, the catalogue's ``{"rings": ...}``, the paper authors' first line, a list of polygons' pairs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from envs.polygons.drawing import Drawing, Reading
from envs.readers.file_check import text_of
from envs.readers.geojson import drawing_of_geojson, polygons_of_rings
from envs.types import DomainError


def drawing_of_file(path: Path, reading: Reading) -> Drawing:
    """What a JSON file states: GeoJSON, ``{"rings": ...}`` or a list of pairs."""
    source = str(path)
    data = parsed(text_of(path), source)
    if isinstance(data, list):
        return Drawing([[data]])
    if isinstance(data, dict) and "rings" in data:
        return Drawing(polygons_of_rings(data, source))
    if isinstance(data, dict) and "type" in data:
        return drawing_of_geojson(data, source)
    raise DomainError(f"{source}: neither GeoJSON (no 'type') nor a list of [x, y] pairs; give one of the two")


def parsed(text: str, source: str) -> Any:
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
