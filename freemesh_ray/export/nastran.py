"""Nastran's bulk data, ``.bdf``: grid points, shell or solid elements, and the points of named parts.

A region is a property (PSHELL, PSOLID) and a material (MAT1) of its number, placeholders for the user's own. A side,
line or point is a set of grid points (SET1) and constraints of all their components (SPC1), both of one number, which
case control may name. The names stand in comments. Where the boundary has several sides, set 1 is all of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from envs.types import Ints
from freemesh_ray.export.finite_elements import FiniteElements
from freemesh_ray.export.fixed_width import fitted

#: Characters of a field in the large format, which the grid points have, and in the small one, which all else has.
LARGE, SMALL = 16, 8
#: Fields with data on a line of the small format, between its name and the mark of its continuation.
PER_LINE = 8
#: All components of a grid point.
ALL_COMPONENTS = 123456
#: The middles of a hexahedron's edges in Nastran's order: below, between, above.
MIDDLES = [*range(8, 12), *range(16, 20), *range(12, 16)]


def write(mesh: FiniteElements, path: Path) -> None:
    """Write CQUAD4 elements, CQUAD8 of eight nodes, or CHEXA."""
    path.write_bytes("\n".join([*_bulk(mesh), ""]).encode("ascii"))


def _bulk(mesh: FiniteElements) -> Iterator[str]:
    yield from (f"$ {mesh.title}", "SOL 101", "CEND", "BEGIN BULK")
    yield "$ Thickness and material are placeholders" if mesh.kind.dimension == 2 else "$ Material is a placeholder"
    for i, region in enumerate(mesh.regions, 1):
        yield f"$ Property {i}: {region.name}"
        yield from _card("PSHELL", [i, i, "1.0", i]) if mesh.kind.dimension == 2 else _card("PSOLID", [i, i])
        yield from _card("MAT1", [i, "1.0", "", "0.3"])
    for i, (x, y, z) in enumerate(mesh.places.tolist(), 1):
        yield f"{'GRID*':8}{i:16}{'':16}{real(x):>16}{real(y):>16}"
        yield f"{'*':8}{real(z):>16}"
    elements = mesh.elements + 1
    if mesh.kind.nodes == 20:
        elements = elements[:, [*range(8), *MIDDLES]]
    card = {4: "CQUAD4"}.get(mesh.kind.nodes, "CQUAD8") if mesh.kind.dimension == 2 else "CHEXA"
    for i, (region, nodes) in enumerate(zip(mesh.region_of.tolist(), elements.tolist(), strict=True), 1):
        yield from _card(card, [i, region + 1, *nodes])
    for i, (name, nodes) in enumerate(_sets(mesh), 1):
        yield f"$ Set {i}: {name}"
        yield from _card("SET1", [i, *(nodes + 1).tolist()])
        yield from _card("SPC1", [i, ALL_COMPONENTS, *(nodes + 1).tolist()])
    yield "ENDDATA"


def _sets(mesh: FiniteElements) -> Iterator[tuple[str, Ints]]:
    if len(mesh.sides) > 1:
        yield "boundary, all of it", mesh.boundary.nodes
    yield from mesh.node_sets


def _card(name: str, fields: Sequence[int | str]) -> Iterable[str]:
    """An entry in the small format, continued on as many lines as it needs."""
    for i in range(0, len(fields), PER_LINE):
        yield f"{name if i == 0 else '+':8}{''.join(f'{field:>{SMALL}}' for field in fields[i : i + PER_LINE])}"


def real(value: float) -> str:
    """A number in the large format.

    Nastran knows a real by its point; an exponent needs a sign, but no letter: ``1.5-7`` is 1.5e-7.
    """
    return fitted(value, LARGE, "")
