"""Tables of vertices: one ``x y`` row each, separated by comma, semicolon, tab or spaces; rings by a blank line.

A first row without numbers is a header. A third column, in a table with a header that calls it ``ring`` or in one
without a header, numbers or names the ring of each vertex. Rows after a ``#`` are comments. With semicolons, a comma
is the decimal point. Rings inside rings are holes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from envs.polygons.rings import check_count
from envs.readers.nesting import nested
from envs.readers.source import text_of
from envs.types import DomainError, Floats

#: Lines without a vertex, at most.
MOST_OTHER_LINES = 100_000


def polygons_of_file(path: Path, edge_length: float | None = None) -> list[list[Any]]:
    """The rings of every polygon in a table of vertices."""
    rings = rings_of_table(text_of(path), str(path))
    return nested([[[ring]] for ring in rings], str(path))


def rings_of_table(text: str, source: str) -> list[Floats]:
    """The rings of a table, each (n, 2) float64, in order of appearance."""
    check_count(text.count("\n") - MOST_OTHER_LINES, source)
    lines = [line.partition("#")[0].strip() for line in text.splitlines()]
    rows = [(number, cells(line)) for number, line in enumerate(lines, 1)]
    first = next((i for i, (_, row) in enumerate(rows) if row), None)
    if first is None:
        raise DomainError(f"{source}: no rows; give one 'x, y' row for each vertex")
    header = None
    if all(number_in(cell) is None for cell in rows[first][1]):
        header = [cell.lower() for cell in rows[first][1]]
        rows = rows[first + 1 :]
    x, y, ring = columns(header, max((len(row) for _, row in rows), default=0))
    rings: dict[tuple[int, str], list[tuple[float, float]]] = {}
    block = 0
    for number, row in rows:
        if not row:
            block += 1
            continue
        pair = tuple(number_in(row[column]) if column < len(row) else None for column in (x, y))
        if pair[0] is None or pair[1] is None:
            raise DomainError(
                f"{source}: line {number}: {' '.join(row)[:60]!r} where two numbers x and y are needed; correct the row"
            )
        label = row[ring] if ring is not None and ring < len(row) else ""
        rings.setdefault((block, label) if ring is None else (0, label), []).append((pair[0], pair[1]))
    if not rings:
        raise DomainError(f"{source}: no rows; give one 'x, y' row for each vertex")
    return [np.array(ring) for ring in rings.values()]


def columns(header: list[str] | None, width: int) -> tuple[int, int, int | None]:
    """Which columns hold x, y and the ring, if any."""
    if header is None:
        return 0, 1, 2 if width > 2 else None
    x = header.index("x") if "x" in header else 0
    y = header.index("y") if "y" in header else 1
    return x, y, header.index("ring") if "ring" in header else None


def cells(line: str) -> list[str]:
    """The cells of a row; with semicolons, decimal commas become points."""
    if ";" in line:
        return [cell.strip().replace(",", ".") for cell in line.split(";")]
    for separator in (",", "\t"):
        if separator in line:
            return [cell.strip() for cell in line.split(separator)]
    return line.split()


def number_in(cell: str) -> float | None:
    """The number in a cell, quotes aside; None when there is none."""
    try:
        return float(cell.strip("\"'"))
    except ValueError:
        return None
