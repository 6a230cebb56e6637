"""Plain texts: a table of vertices when it begins with a number, otherwise WKT."""

from __future__ import annotations

from pathlib import Path

from envs.polygons.drawing import Drawing, Reading
from envs.readers import table, wkt
from envs.readers.file_check import text_of


def drawing_of_file(path: Path, reading: Reading) -> Drawing:
    """What a text states."""
    first = text_of(path).replace(",", " ").replace(";", " ").split()[:1]
    reader = table if first and table.number_in(first[0]) is not None else wkt
    return reader.drawing_of_file(path, reading)
