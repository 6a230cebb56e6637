"""Polygon files in: every format becomes a list of polygons, each a list of rings as the file states them.

A reader takes the path and the edge length that outlines are to be discretised by, or None; curves are flattened to
suit. The outer ring comes first, then the holes; :mod:`envs.polygons.domain` validates.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from envs.polygons.curves import ChordsError
from envs.polygons.rings import check_count, check_rings
from envs.readers.dxf import polygons_of_dxf
from envs.readers.geo import polygons_of_geo
from envs.readers.json_text import polygons_of_json
from envs.readers.msh import polygons_of_msh
from envs.readers.source import check_file, text_of
from envs.readers.table import number_in, polygons_of_table
from envs.readers.wkt import polygons_of_wkt
from envs.types import DomainError

Polygons = list[list[Any]]


def read(path: Path, edge_length: float | None = None) -> Polygons:
    """The polygons in a file.

    Args:
        path: a polygon file; its extension, in any case, tells the format.
        edge_length: what outlines are to be discretised by; None: curves are flattened for good.

    Returns:
        For each polygon its rings, the outer one first, as the file states them: nothing is checked yet.

    Raises:
        DomainError: no such file, an unknown extension, a file that is too large, broken or without a polygon.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise DomainError(f"{path}: unknown extension {path.suffix!r}; use one of {', '.join(READERS)}")
    check_file(path)
    try:
        with np.errstate(all="ignore"):  # numbers beyond floats are for the checks of the rings to name
            polygons = reader(path, edge_length)
    except ChordsError as error:
        raise DomainError(f"{path}: {error}") from None
    check_rings(sum(map(len, polygons)), str(path))
    check_count(sum(len(ring) for rings in polygons for ring in rings if hasattr(ring, "__len__")), str(path))
    return polygons


def polygons_of_text(path: Path, edge_length: float | None = None) -> Polygons:
    """A plain text: a table of vertices when it begins with a number, otherwise WKT."""
    first = text_of(path).replace(",", " ").replace(";", " ").split()[:1]
    reader = polygons_of_table if first and number_in(first[0]) is not None else polygons_of_wkt
    return reader(path, edge_length)


READERS: dict[str, Callable[[Path, float | None], Polygons]] = {
    ".geojson": polygons_of_json,
    ".json": polygons_of_json,
    ".wkt": polygons_of_wkt,
    ".txt": polygons_of_text,
    ".csv": polygons_of_table,
    ".tsv": polygons_of_table,
    ".xy": polygons_of_table,
    ".dat": polygons_of_table,
    ".dxf": polygons_of_dxf,
    ".geo": polygons_of_geo,
    ".msh": polygons_of_msh,
}
