"""Plain texts: a table of vertices when it begins with a number, otherwise WKT."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from envs.readers import table, wkt
from envs.readers.source import text_of


def polygons_of_file(path: Path, edge_length: float | None = None) -> list[list[Any]]:
    """The rings of every polygon in a text."""
    first = text_of(path).replace(",", " ").replace(";", " ").split()[:1]
    reader = table if first and table.number_in(first[0]) is not None else wkt
    return reader.polygons_of_file(path, edge_length)
