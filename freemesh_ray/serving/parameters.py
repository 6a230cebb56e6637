"""The parameters of a request: what stands after the ``?``."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from envs.polygons.sizing import MOST_GRADING
from freemesh_ray.finish.refill import EFFORTS, USUAL
from freemesh_ray.policies.policy import DENSITY
from freemesh_ray.serving.formats import JSON, MEDIA_TYPES
from freemesh_ray.serving.limits import Limits

#: A number as JSON and everybody writes it, or nearly so.
PLAIN = re.compile(r"[+-]?[0-9.]+([eE][+-]?[0-9]+)?")
#: Characters of a client's text that are repeated to it.
QUOTED = 40


class ParameterError(ValueError):
    """A parameter that is not understood; one line with its name, what is wrong and the fix."""


@dataclass(frozen=True)
class Parameters:
    """How a polygon is to be meshed and answered; see api.mesh.

    Attributes:
        density: a key of the server's policies.
        format: a key of formats.MEDIA_TYPES.
    """

    density: str
    edge_length: float | None = None
    grading: float = 1.0
    fix_parity: bool = False
    seed: int = 0
    best_of: int = 1
    smooth: bool = True
    clean: bool = True
    effort: str = USUAL
    format: str = JSON


@dataclass(frozen=True)
class ValueType:
    """The values that a parameter takes.

    Attributes:
        wanted: what to give, for messages and the server's own description.
        read: a text's value; ValueError for one that the parameter does not take.
    """

    wanted: str
    read: Callable[[str], Any]


def number(low: float, high: float, wanted: str) -> ValueType:
    """A number in [low, high]."""

    def read(text: str) -> float:
        if not PLAIN.fullmatch(text) or not low <= (value := float(text)) <= high:
            raise ValueError
        return value

    return ValueType(wanted, read)


def whole(low: int, high: int) -> ValueType:
    """A whole number in [low, high]."""

    def read(text: str) -> int:
        if not PLAIN.fullmatch(text) or not low <= (value := int(text)) <= high:
            raise ValueError
        return value

    return ValueType(f"a whole number from {low} to {high}", read)


def choice(values: Sequence[str], meaning: Callable[[str], Any] = str) -> ValueType:
    """One of several words."""

    def read(text: str) -> Any:
        if text not in values:
            raise ValueError
        return meaning(text)

    return ValueType(values[0] if len(values) == 1 else f"one of {', '.join(values)}", read)


def value_types(densities: Sequence[str], limits: Limits) -> dict[str, ValueType]:
    """What every parameter takes, by its name, which is that of its field in `Parameters`."""
    switch = choice(("true", "false"), lambda text: text == "true")
    return {
        "edge_length": number(1e-300, 1e300, "a number from 1e-300 to 1e300, in the polygon's units"),
        "grading": number(1.0, MOST_GRADING, f"a ratio from 1 to {MOST_GRADING:g}"),
        "fix_parity": switch,
        "density": choice(densities),
        "seed": whole(0, 2**32 - 1),
        "best_of": whole(1, limits.best_of),
        "smooth": switch,
        "clean": switch,
        "effort": choice(tuple(EFFORTS)),
        "format": choice(tuple(MEDIA_TYPES)),
    }


def parameters(query: Iterable[tuple[str, str]], densities: Sequence[str], limits: Limits) -> Parameters:
    """The parameters that a query gives.

    Args:
        query: names and values, decoded.
        densities: those that the server has policies for; the default is ``medium``, or the only one.
        limits: of ``best_of``.

    Raises:
        ParameterError: a name that is not known or occurs twice, or a value out of its range.
    """
    known = value_types(densities, limits)
    values: dict[str, Any] = {}
    for name, text in query:
        if name not in known:
            raise ParameterError(unknown(name, list(known)))
        if name in values:
            raise ParameterError(f"parameter {name}: given twice: give it once")
        try:
            values[name] = known[name].read(text)
        except ValueError:
            raise ParameterError(f"parameter {name}={shortened(text)!r}: give {known[name].wanted}") from None
    if values.get("grading", 1.0) > 1.0 and "edge_length" not in values:
        raise ParameterError("parameter grading: means nothing alone: give edge_length, too")
    density = values.pop("density", DENSITY if DENSITY in densities else densities[0])
    return Parameters(density, **values)


def unknown(name: str, known: Sequence[str]) -> str:
    """The line for a name that is not known, with the nearest one."""
    near = difflib.get_close_matches(shortened(name), known, n=1)
    meant = f"did you mean {near[0]}? " if near else ""
    return f"parameter {shortened(name)!r}: not known; {meant}there are {', '.join(known)}"


def shortened(text: str) -> str:
    """A client's text as messages repeat it."""
    return text if len(text) <= QUOTED else f"{text[:QUOTED]}..."
