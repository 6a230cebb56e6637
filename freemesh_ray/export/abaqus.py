"""Abaqus' and CalculiX' input deck, ``.inp``: the geometry, and names to hang supports and loads on.

Every side, line and point is a node set, and every side and line a surface, of its name; the elements behind it are
``LEFT-ELEMENTS`` (CalculiX puts no load on a surface that has the name of an element set). Every region is an element
set and a node set. ``ALL`` are all nodes and elements. Where the boundary has several sides, ``BOUNDARY`` is all of it.

The two programs name the edges of shells differently in surfaces, but not in distributed loads. So in place of a
surface a side of shells has element sets ``LEFT-E1`` to ``LEFT-E4``: those whose edge of that number is on it, for
``EDNOR1`` to ``EDNOR4``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from envs.types import Ints
from freemesh_ray.export.abaqus_elements import USUAL
from freemesh_ray.export.finite_elements import Facets, FiniteElements

#: Most numbers on a data line of a set, or of an element's first line.
PER_LINE = 16
#: All of the boundary.
BOUNDARY = "BOUNDARY"


def write(mesh: FiniteElements, path: Path, element_type: str | None) -> None:
    """Write elements of a type that has as many nodes; by default plane strain, or solids."""
    kind = element_type or USUAL[mesh.kind.dimension, mesh.kind.nodes]
    path.write_bytes("\n".join([*_deck(mesh, kind), ""]).encode("ascii"))


def _deck(mesh: FiniteElements, kind: str) -> Iterator[str]:
    yield from ("*HEADING", mesh.title)
    yield "*NODE, NSET=ALL"
    yield from (f"{i}, {', '.join(map(_coordinate, point))}" for i, point in enumerate(mesh.nodes.tolist(), 1))
    yield f"*ELEMENT, TYPE={kind}, ELSET=ALL"
    for i, nodes in enumerate((mesh.elements + 1).tolist(), 1):
        # A line that ends in a comma goes on in the next.
        yield from _broken([i, *nodes])
    for region in mesh.regions:
        yield f"*ELSET, ELSET={region.name}"
        yield from _lines(region.elements + 1)
        yield f"*NSET, NSET={region.name}"
        yield from _lines(np.unique(mesh.elements[region.elements]) + 1)
    shells = kind.startswith("S")
    if len(mesh.sides) > 1 and all(group.name != BOUNDARY for group in mesh.groups()):
        yield from _facets(BOUNDARY, mesh.boundary, shells)
    for part in mesh.facets:
        yield from _facets(part.name, part, shells)
    for point in mesh.points:
        yield f"*NSET, NSET={point.name}"
        yield from _lines(point.nodes + 1)


def _coordinate(value: float) -> str:
    """The shortest text that reads back to the same bits, without an exponent.

    Solvers may read no more than 20 characters of a number. Cut there, a plain decimal loses digits that do not
    matter; one with an exponent would lose the exponent.
    """
    return np.format_float_positional(value, unique=True, trim="0")


def _broken(numbers: list[int]) -> Iterator[str]:
    for i in range(0, len(numbers), PER_LINE):
        last = i + PER_LINE >= len(numbers)
        yield ", ".join(map(str, numbers[i : i + PER_LINE])) + ("" if last else ",")


def _lines(numbers: Ints) -> Iterable[str]:
    return (", ".join(map(str, numbers[i : i + PER_LINE].tolist())) for i in range(0, len(numbers), PER_LINE))


def _facets(name: str, part: Facets, shells: bool) -> Iterator[str]:
    """Nodes, elements, and element sides; a side Sk of a plane element runs from corner k to the next."""
    yield f"*NSET, NSET={name}"
    yield from _lines(part.nodes + 1)
    if len(part.elements):
        yield f"*ELSET, ELSET={name}-ELEMENTS"
        yield from _lines(np.unique(part.elements) + 1)
        if shells:
            for side in np.unique(part.sides).tolist():
                yield f"*ELSET, ELSET={name}-E{side + 1}"
                yield from _lines(part.elements[part.sides == side] + 1)
            return
        yield f"*SURFACE, NAME={name}, TYPE=ELEMENT"
        pairs = zip((part.elements + 1).tolist(), (part.sides + 1).tolist(), strict=True)
        yield from (f"{element}, S{side}" for element, side in pairs)
