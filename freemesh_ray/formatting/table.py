"""Tables in plain text and in Markdown."""

from __future__ import annotations

import math
from collections.abc import Sequence

from envs.printable import printable
from freemesh_ray.formatting.markdown import in_cell


def table(header: Sequence[str], rows: Sequence[Sequence[str]], left: Sequence[int] = (0,)) -> str:
    """Columns aligned: those numbered in ``left`` to the left, the others to the right."""
    lines = [[printable(cell) for cell in line] for line in (header, *rows)]
    return "\n".join("  ".join(line).rstrip() for line in aligned(lines, left=left))


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """The same in Markdown, which lines up as plain text, too; cells are escaped unless they are Markdown already."""
    lines = aligned([[in_cell(cell) for cell in line] for line in (header, *rows)], least=3)
    first, *others = (len(cell) for cell in lines[0])
    rule = "|".join(["-" * (first + 2), *("-" * (width + 1) + ":" for width in others)])
    head, *body = (f"| {' | '.join(line)} |" for line in lines)
    return "\n".join([head, f"|{rule}|", *body])


def aligned(lines: Sequence[Sequence[str]], least: int = 0, left: Sequence[int] = (0,)) -> list[list[str]]:
    """Cells filled up to the width of their column, at least ``least``, on the left of the columns in ``left``."""
    widths = [max(least, *map(len, column)) for column in zip(*lines, strict=True)]
    sides = ["<" if i in left else ">" for i in range(len(widths))]
    return [[f"{cell:{side}{width}}" for cell, side, width in zip(line, sides, widths, strict=True)] for line in lines]


def number(value: float, form: str) -> str:
    """The value in the given format; a dash when there is none."""
    return format(value, form) if math.isfinite(value) else "-"


def duration(seconds: float) -> str:
    """1:05 or 1:02:05; a dash when unknown."""
    if not math.isfinite(seconds):
        return "-"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
