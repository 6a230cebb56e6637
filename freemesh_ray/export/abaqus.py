"""Abaqus' and CalculiX' input deck, ``.inp``: the geometry, and names to hang supports and loads on.

Sets: nodes and elements ``ALL``, nodes ``BOUNDARY``, the elements along it ``BOUNDARY_ELEMENTS``, and the surface
``BOUNDARY`` of the element faces on it. Where the boundary has several loops, each has a node set and a surface of its
own: ``OUTER``, ``HOLE_1``, ...
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from envs.types import Ints
from freemesh_ray.export.finite_elements import Curve, FiniteElements

#: Most numbers on a data line of a set.
PER_LINE = 16


def write(mesh: FiniteElements, path: Path) -> None:
    """Write plane strain elements: CPE4, or CPE8 of eight nodes."""
    path.write_bytes("\n".join([*_deck(mesh), ""]).encode("ascii"))


def _deck(mesh: FiniteElements) -> Iterator[str]:
    yield from ("*HEADING", mesh.title)
    yield "*NODE, NSET=ALL"
    yield from (f"{i}, {_coordinate(x)}, {_coordinate(y)}" for i, (x, y) in enumerate(mesh.nodes.tolist(), 1))
    yield f"*ELEMENT, TYPE={'CPE8' if mesh.quadratic else 'CPE4'}, ELSET=ALL"
    yield from (f"{i}, {', '.join(map(str, nodes))}" for i, nodes in enumerate((mesh.elements + 1).tolist(), 1))
    yield "*ELSET, ELSET=BOUNDARY_ELEMENTS"
    yield from _lines(np.unique(mesh.boundary.elements) + 1)
    for curve in mesh.curves:
        yield f"*NSET, NSET={curve.name.upper()}"
        yield from _lines(curve.nodes + 1)
        yield f"*SURFACE, NAME={curve.name.upper()}, TYPE=ELEMENT"
        yield from _faces(curve)


def _coordinate(value: float) -> str:
    """The shortest text that reads back to the same bits, without an exponent.

    Solvers may read no more than 20 characters of a number. Cut there, a plain decimal loses digits that do not
    matter; one with an exponent would lose the exponent.
    """
    return np.format_float_positional(value, unique=True, trim="0")


def _lines(numbers: Ints) -> Iterable[str]:
    return (", ".join(map(str, numbers[i : i + PER_LINE].tolist())) for i in range(0, len(numbers), PER_LINE))


def _faces(curve: Curve) -> Iterable[str]:
    """``element, face`` of every element side on a curve; face Sk runs from corner k to the next."""
    pairs = zip((curve.elements + 1).tolist(), (curve.sides + 1).tolist(), strict=True)
    return (f"{element}, S{face}" for element, face in pairs)
