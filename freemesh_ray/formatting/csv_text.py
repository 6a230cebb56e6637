"""Tables for spreadsheets and programs: no text in them is taken for a formula."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from io import StringIO
from typing import Any

from envs.printable import printable

#: What a formula begins with; a number may, too.
FORMULA = ("=", "+", "-", "@")


def csv_text(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A table as CSV; what is not finite, or None, is an empty cell."""
    text = StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow([cell(title) for title in header])
    writer.writerows([cell(value) for value in row] for row in rows)
    return text.getvalue()


def cell(value: Any) -> Any:
    """A value as it may stand in a cell: an apostrophe tells a spreadsheet that what follows is text."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    if not isinstance(value, str):
        return value
    text = printable(value)
    return f"'{text}" if text.lstrip().startswith(FORMULA) and text != "-" else text
