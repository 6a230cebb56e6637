"""LS-DYNA's keyword file, ``.k``: nodes, a part for each region, and node sets.

Section and material of a part are placeholders for the user's own. Sides, lines and points are node sets with titles.
A coordinate has sixteen characters, see `fixed_width`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from freemesh_ray.export.finite_elements import FiniteElements
from freemesh_ray.export.fixed_width import fitted

#: Characters of a node's coordinate.
COORDINATE = 16
#: Numbers on a line of a set.
PER_LINE = 8
#: Element formulations: a shell of four nodes and of eight, a solid of eight.
SHELL, SHELL_OF_8, SOLID = 2, 23, 1


def write(mesh: FiniteElements, path: Path) -> None:
    """Write shells of four or eight nodes, or solids of eight."""
    path.write_bytes("\n".join([*_deck(mesh), ""]).encode("ascii"))


def _deck(mesh: FiniteElements) -> Iterator[str]:
    yield from ("*KEYWORD", "*TITLE", mesh.title, "*NODE")
    for i, point in enumerate(mesh.places.tolist(), 1):
        yield f"{i:8}{''.join(f'{fitted(value, COORDINATE):>{COORDINATE}}' for value in point)}"
    plane = mesh.kind.dimension == 2
    yield "$ Section and material are placeholders"
    for i, region in enumerate(mesh.regions, 1):
        yield from ("*PART", region.name, _fields([i, i, i], 10))
        if plane:
            formulation = SHELL if mesh.kind.nodes == 4 else SHELL_OF_8
            yield from ("*SECTION_SHELL", _fields([i, formulation], 10), _fields(["1.0"] * 4, 10))
        else:
            yield from ("*SECTION_SOLID", _fields([i, SOLID], 10))
        yield from ("*MAT_ELASTIC", _fields([i, "1.0", "1.0", "0.3"], 10))
    yield "*ELEMENT_SHELL" if plane else "*ELEMENT_SOLID"
    for i, (region, nodes) in enumerate(zip(mesh.region_of.tolist(), (mesh.elements + 1).tolist(), strict=True), 1):
        yield _fields([i, region + 1, *nodes], 8)
    for i, (name, nodes) in enumerate(mesh.node_sets, 1):
        yield from ("*SET_NODE_LIST_TITLE", name, _fields([i], 10))
        yield from (_fields((nodes[j : j + PER_LINE] + 1).tolist(), 10) for j in range(0, len(nodes), PER_LINE))
    yield "*END"


def _fields(values: Sequence[int | str], width: int) -> str:
    return "".join(f"{value:>{width}}" for value in values)
