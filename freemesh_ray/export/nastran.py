"""Nastran's bulk data, ``.bdf``: grid points, shell elements, and the boundary's points as sets.

Sets (SET1): 1 is the boundary; where that has several loops, 2 is the outer one, 3 and on are the holes. Property and
material (PSHELL, MAT1) are placeholders for the user's own.

A field holds sixteen characters, fewer than every bit of a double may need. Numbers that fit are exact; others are
rounded to 15 significant digits (negative ones: 14) between 0.1 and 1e14, to at least 13 (12) between 1e-9 and 0.1, and
to at least 11 (10) anywhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from freemesh_ray.export.finite_elements import FiniteElements

#: Characters of a field in the large format, which the grid points have, and in the small one, which all else has.
LARGE, SMALL = 16, 8
#: Fields with data on a line of the small format, between its name and the mark of its continuation.
PER_LINE = 8


def write(mesh: FiniteElements, path: Path) -> None:
    """Write CQUAD4 elements, or CQUAD8 of eight nodes."""
    path.write_bytes("\n".join([*_bulk(mesh), ""]).encode("ascii"))


def _bulk(mesh: FiniteElements) -> Iterator[str]:
    yield from (f"$ {mesh.title}", "SOL 101", "CEND", "BEGIN BULK")
    yield "$ Thickness and material are placeholders"
    yield from _card("PSHELL", [1, 1, "1.0", 1])
    yield from _card("MAT1", [1, "1.0", "", "0.3"])
    for i, (x, y) in enumerate(mesh.nodes.tolist(), 1):
        yield f"{'GRID*':8}{i:16}{'':16}{real(x):>16}{real(y):>16}"
        yield f"{'*':8}{'0.0':>16}"
    kind = "CQUAD8" if mesh.quadratic else "CQUAD4"
    for i, nodes in enumerate((mesh.elements + 1).tolist(), 1):
        yield from _card(kind, [i, 1, *nodes])
    for i, curve in enumerate(mesh.curves, 1):
        yield f"$ Set {i}: {curve.name}"
        yield from _card("SET1", [i, *(curve.nodes + 1).tolist()])
    yield "ENDDATA"


def _card(name: str, fields: Sequence[int | str]) -> Iterable[str]:
    """An entry in the small format, continued on as many lines as it needs."""
    for i in range(0, len(fields), PER_LINE):
        yield f"{name if i == 0 else '+':8}{''.join(f'{field:>{SMALL}}' for field in fields[i : i + PER_LINE])}"


def real(value: float) -> str:
    """The text of at most sixteen characters that is nearest to a finite number; one that is equal to it if there is.

    Nastran knows a real by its point; an exponent needs a sign, but no letter: ``1.5-7`` is 1.5e-7.
    """
    exact = np.format_float_positional(value, unique=True, trim="0")
    if len(exact) <= LARGE:
        return exact
    candidates = [text for text in map(_longest, (_decimals(value), _exponentials(value))) if text is not None]
    return min(candidates, key=lambda text: abs(parsed(text) - value))


def parsed(text: str) -> float:
    """The number that Nastran reads from a field."""
    sign = max(text.rfind("+"), text.rfind("-"))
    return float(f"{text[:sign]}e{text[sign:]}" if sign > 0 else text)


def _longest(texts: Iterable[str]) -> str | None:
    """Of ever shorter texts the first that fits."""
    return next((text for text in texts if len(text) <= LARGE), None)


def _decimals(value: float) -> Iterator[str]:
    """Plain decimals of ever fewer digits, without the zero before the point, which would cost one."""
    for digits in range(LARGE, 0, -1):
        text = f"{value:.{digits}f}"
        yield text.replace("0.", ".", 1) if abs(value) < 1 else text
    yield f"{value:.0f}."


def _exponentials(value: float) -> Iterator[str]:
    """Decimals with an exponent, of ever fewer digits."""
    for digits in range(LARGE, 0, -1):
        mantissa, exponent = f"{value:.{digits}e}".split("e")
        yield f"{mantissa}{int(exponent):+d}"
