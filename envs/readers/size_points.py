"""Points with sizes in a table: rows ``x, y, size``, separated as a polygon's table is."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from envs.readers.file_check import excerpt, text_of
from envs.readers.size_triangles import check_values
from envs.readers.table import cells, number_in
from envs.types import DomainError, Floats

COLUMNS = ("x", "y", "size")


def sizes_of_file(path: Path) -> Floats:
    """(m, 3) float64: x, y and a size.

    Raises:
        DomainError: a row without three numbers, or none at all; UserError: a size that is not positive.
    """
    source, order = str(path), [0, 1, 2]
    rows: list[list[float | None]] = []
    for number, line in enumerate(text_of(path).splitlines(), 1):
        row = cells(line.partition("#")[0].strip())
        if not any(row):
            continue
        values = [number_in(row[column]) if column < len(row) else None for column in order]
        if not rows and all(number_in(cell) is None for cell in row):
            names = [cell.strip("\"' ").lower() for cell in row]
            if set(COLUMNS) <= set(names):
                order = [names.index(column) for column in COLUMNS]
        elif None in values:
            raise DomainError(
                f"{source}: line {number}: {excerpt(line)!r} where x, y and a size are needed; correct it"
            )
        else:
            rows.append(values)
    if not rows:
        raise DomainError(f"{source}: no rows; give one 'x, y, size' row for each point")
    found = np.array(rows, dtype=np.float64)
    check_values(found[:, :2], found[:, 2], source)
    return found
