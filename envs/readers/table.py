"""Tables of vertices: one ``x y`` row each, separated by comma, semicolon, tab or spaces; rings by a blank line.

A first row without numbers is a header. A third column, in a table with a header that calls it ``ring`` or in one
without a header, numbers or names the ring of each vertex. A column that the header calls ``name`` or ``side`` names
the segment that begins at the vertex. Rows after a ``#`` are comments. With semicolons, a comma is the decimal point.
Rings inside rings are holes.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from envs.polygons.drawing import Drawing, Line, Reading
from envs.polygons.rings import check_count
from envs.readers.file_check import text_of
from envs.readers.nesting import nested
from envs.types import DomainError, Floats

#: Lines without a vertex, at most.
MOST_OTHER_LINES = 100_000


@dataclass(frozen=True)
class Columns:
    """Which columns hold what; None: none does.

    Attributes:
        x, y: the coordinates.
        ring: the ring of each vertex.
        name: the name of the segment that begins at each vertex.
    """

    x: int
    y: int
    ring: int | None
    name: int | None


@dataclass(frozen=True)
class Ring:
    """A ring as a table states it.

    Attributes:
        points: n pairs x and y.
        names: n names of the segments that begin at them; empty: no name.
    """

    points: list[tuple[float, float]]
    names: list[str]


def drawing_of_file(path: Path, reading: Reading) -> Drawing:
    """What a table of vertices states."""
    source = str(path)
    rings = table_rings(text_of(path), source)
    polygons = nested([[[np.array(ring.points)]] for ring in rings], source)
    return Drawing(polygons, lines=[line for ring in rings for line in named_lines(ring)])


def rings_of_table(text: str, source: str) -> list[Floats]:
    """The rings of a table, each (n, 2) float64, in order of appearance."""
    return [np.array(ring.points) for ring in table_rings(text, source)]


def table_rings(text: str, source: str) -> list[Ring]:
    """The rings of a table, in order of appearance.

    Raises:
        DomainError: no rows, or one without two numbers.
    """
    check_count(text.count("\n") - MOST_OTHER_LINES, source)
    lines = [line.partition("#")[0].strip() for line in text.splitlines()]
    rows = [(number, cells(line)) for number, line in enumerate(lines, 1)]
    first = next((i for i, (_, row) in enumerate(rows) if row), None)
    if first is None:
        raise DomainError(f"{source}: no rows; give one 'x, y' row for each vertex")
    header = None
    if all(number_in(cell) is None for cell in rows[first][1]):
        header = [cell.strip("\"'").lower() for cell in rows[first][1]]
        rows = rows[first + 1 :]
    used = columns(header, max((len(row) for _, row in rows), default=0))
    rings: dict[tuple[int, str], Ring] = {}
    block = 0
    for number, row in rows:
        if not row:
            block += 1
            continue
        x, y = (number_in(row[column]) if column < len(row) else None for column in (used.x, used.y))
        if x is None or y is None:
            raise DomainError(
                f"{source}: line {number}: {' '.join(row)[:60]!r} where two numbers x and y are needed; correct the row"
            )
        label = cell_of(row, used.ring)
        ring = rings.setdefault((block, label) if used.ring is None else (0, label), Ring([], []))
        ring.points.append((x, y))
        ring.names.append(cell_of(row, used.name).strip("\"'"))
    if not rings:
        raise DomainError(f"{source}: no rows; give one 'x, y' row for each vertex")
    return list(rings.values())


def columns(header: list[str] | None, width: int) -> Columns:
    """Which columns hold what, by the header, or in a table of so many columns without one."""
    if header is None:
        return Columns(0, 1, 2 if width > 2 else None, None)
    at = {name: i for i, name in reversed(list(enumerate(header)))}
    return Columns(at.get("x", 0), at.get("y", 1), at.get("ring"), at.get("name", at.get("side")))


def cell_of(row: list[str], column: int | None) -> str:
    """A row's cell in a column; empty where it has none."""
    return row[column] if column is not None and column < len(row) else ""


def named_lines(ring: Ring) -> list[Line]:
    """The segments of a ring that have names, those with the same name that follow each other as one line."""
    points = np.array(ring.points)
    names = ring.names
    if len(points) > 1 and np.array_equal(points[0], points[-1]):
        points, names = points[:-1], names[:-1]
    starts = [i for i, name in enumerate(names) if name != names[i - 1] or i == 0]
    ends = [*starts[1:], len(names)]
    around = np.concatenate([points, points[:1]])
    return [
        Line(around[start : end + 1], name=names[start])
        for start, end in zip(starts, ends, strict=True)
        if names[start] and not np.array_equal(around[start], around[start + 1])
    ]


def cells(line: str) -> list[str]:
    """The cells of a row; with semicolons, decimal commas become points."""
    if ";" in line:
        return [with_decimal_point(cell.strip()) for cell in line.split(";")]
    for separator in (",", "\t"):
        if separator in line:
            return [cell.strip() for cell in line.split(separator)]
    return line.split()


def with_decimal_point(cell: str) -> str:
    """A number with a decimal comma as one with a point; any other cell as it is."""
    number = cell.replace(",", ".")
    return cell if number_in(number) is None else number


def number_in(cell: str) -> float | None:
    """The number in a cell, quotes aside; None when there is none."""
    try:
        return float(cell.strip("\"'"))
    except ValueError:
        return None
