"""Numbers in fields of a fixed width, as near as their characters let them be.

Sixteen characters are fewer than every bit of a double may need. Numbers that fit are exact; others are rounded to 15
significant digits (negative ones: 14) between 0.1 and 1e14, to at least 13 (12) between 1e-9 and 0.1, and to at least
10 (9) anywhere, to 11 (10) without a letter before the exponent.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np


def fitted(value: float, width: int, exponent: str = "e") -> str:
    """The text of at most ``width`` characters that is nearest to a finite number; one equal to it if there is.

    Args:
        value: finite.
        width: 12 or more.
        exponent: the letter before an exponent; empty: its sign stands alone.
    """
    exact = np.format_float_positional(value, unique=True, trim="0")
    if len(exact) <= width:
        return exact
    candidates = [_longest(texts, width) for texts in (_decimals(value, width), _exponentials(value, width, exponent))]
    return min((text for text in candidates if text is not None), key=lambda text: abs(parsed(text) - value))


def parsed(text: str) -> float:
    """The number that a field holds, with a letter before its exponent or without."""
    text = text.lower()
    sign = max(text.rfind("+"), text.rfind("-"))
    bare = sign > 0 and text[sign - 1] not in "ed"
    return float(f"{text[:sign]}e{text[sign:]}" if bare else text.replace("d", "e"))


def _longest(texts: Iterable[str], width: int) -> str | None:
    """Of ever shorter texts the first that fits."""
    return next((text for text in texts if len(text) <= width), None)


def _decimals(value: float, width: int) -> Iterator[str]:
    """Plain decimals of ever fewer digits, without the zero before the point, which would cost one."""
    for digits in range(width, 0, -1):
        text = f"{value:.{digits}f}"
        yield text.replace("0.", ".", 1) if abs(value) < 1 else text
    yield f"{value:.0f}."


def _exponentials(value: float, width: int, letter: str) -> Iterator[str]:
    """Decimals with an exponent, of ever fewer digits."""
    for digits in range(width, 0, -1):
        mantissa, exponent = f"{value:.{digits}e}".split("e")
        yield f"{mantissa}{letter}{int(exponent):+d}"
