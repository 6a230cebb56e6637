"""I-deas' universal file, ``.unv``: datasets of nodes, elements and groups.

Each region, side and line is a group of elements, those of sides and lines being rods or beams, or shells on hexahedra;
each point is a group of nodes, of swept ones of beams. A group's number is its elements' property and material, too.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from envs.types import Ints
from freemesh_ray.export.finite_elements import FiniteElements

#: Numbers of the datasets.
NODES, ELEMENTS, GROUPS = 2411, 2412, 2467
#: Kinds of elements by dimension and nodes: rod, parabolic beam, plane elements and bricks.
TYPES = {(1, 2): 11, (1, 3): 24, (2, 4): 44, (2, 8): 45, (3, 8): 115, (3, 20): 116}
#: Entities of groups.
NODE, ELEMENT = 7, 8
#: The nodes of a side or an edge, an element or a brick of order 2 in the file's order: as they are walked.
WALKS = {
    (1, 3): [0, 2, 1],
    (2, 8): [0, 4, 1, 5, 2, 6, 3, 7],
    (3, 20): [0, 8, 1, 9, 2, 10, 3, 11, 16, 17, 18, 19, 4, 12, 5, 13, 6, 14, 7, 15],
}


def write(mesh: FiniteElements, path: Path) -> None:
    """Write elements of order 1 or 2."""
    path.write_bytes("\n".join([*_datasets(mesh), ""]).encode("ascii"))


def _datasets(mesh: FiniteElements) -> Iterator[str]:
    yield from _dataset(NODES, _nodes(mesh))
    yield from _dataset(ELEMENTS, _elements(mesh))
    yield from _dataset(GROUPS, _groups(mesh))


def _dataset(number: int, lines: Iterable[str]) -> Iterator[str]:
    yield from ("    -1", f"{number:6}")
    yield from lines
    yield "    -1"


def _nodes(mesh: FiniteElements) -> Iterator[str]:
    for i, point in enumerate(mesh.places.tolist(), 1):
        yield _row([i, 1, 1, 11])
        # Seventeen digits are every bit; the exponent of a double is said with a D.
        yield "".join(f"{value:25.16E}".replace("E", "D") for value in point)


def _elements(mesh: FiniteElements) -> Iterator[str]:
    """Of every part, its number as property and material."""
    for (dimension, nodes), group, numbers in zip(_blocks(mesh), mesh.groups(), mesh.cell_numbers(), strict=False):
        kind = TYPES[dimension, nodes.shape[1]]
        walked = nodes[:, WALKS.get((dimension, nodes.shape[1]), range(nodes.shape[1]))] + 1
        for number, row in zip((numbers + 1).tolist(), walked.tolist(), strict=True):
            yield _row([number, kind, group.number, group.number, 7, len(row)])
            if dimension == 1:
                yield _row([0, 1, 1])  # orientation and sections of a beam
            yield from (_row(row[i : i + 8]) for i in range(0, len(row), 8))


def _blocks(mesh: FiniteElements) -> Iterator[tuple[int, Ints]]:
    """Dimension and nodes of every part that has elements, in the order of the groups."""
    d = mesh.kind.dimension
    yield from ((d, mesh.elements[region.elements]) for region in mesh.regions)
    yield from ((d - 1, part.facets) for part in mesh.facets)
    yield from ((1, point.cells) for point in mesh.points if d == 3)


def _groups(mesh: FiniteElements) -> Iterator[str]:
    entities = [(ELEMENT, numbers) for numbers in mesh.cell_numbers()]
    if mesh.kind.dimension == 2:
        entities[len(entities) - len(mesh.points) :] = [(NODE, point.nodes) for point in mesh.points]
    for group, (entity, tags) in zip(mesh.groups(), entities, strict=True):
        yield _row([group.number, 0, 0, 0, 0, 0, 0, len(tags)])
        yield group.name
        entries = [f"{entity:10}{tag:10}{0:10}{0:10}" for tag in (tags + 1).tolist()]
        yield from ("".join(entries[j : j + 2]) for j in range(0, len(entries), 2))


def _row(numbers: Iterable[int]) -> str:
    return "".join(f"{number:10}" for number in numbers)
