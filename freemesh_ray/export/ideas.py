"""I-deas' universal file, ``.unv``: datasets of nodes, elements and groups.

A region's elements have its number as property and material. Each region, side and line is a group of elements, those
of sides and lines being rods or beams, or shells on hexahedra; each point is a group of nodes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

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
    """Regions, then sides and lines, then the edges of points, in the order of the groups."""
    number = 1
    for dimension, material, nodes in _blocks(mesh):
        kind = TYPES[dimension, nodes.shape[1]]
        walked = nodes[:, WALKS.get((dimension, nodes.shape[1]), range(nodes.shape[1]))] + 1
        for row in walked.tolist():
            yield _row([number, kind, material, material, 7, len(row)])
            if dimension == 1:
                yield _row([0, 1, 1])  # orientation and sections of a beam
            yield from (_row(row[i : i + 8]) for i in range(0, len(row), 8))
            number += 1


def _blocks(mesh: FiniteElements) -> Iterator[tuple[int, int, Ints]]:
    """Dimension, material and nodes of every part that has elements."""
    d = mesh.kind.dimension
    yield from ((d, i, mesh.elements[region.elements]) for i, region in enumerate(mesh.regions, 1))
    yield from ((d - 1, 1, part.facets) for part in mesh.facets)
    yield from ((1, 1, point.cells) for point in mesh.points if d == 3)


def _groups(mesh: FiniteElements) -> Iterator[str]:
    sizes = [len(nodes) for _, _, nodes in _blocks(mesh)]
    ends = np.cumsum(sizes)
    for i, group in enumerate(mesh.groups()):
        if i < len(sizes):
            entity, tags = ELEMENT, np.arange(ends[i] - sizes[i], ends[i])
        else:
            entity, tags = NODE, mesh.points[i - len(sizes)].nodes
        yield _row([group.number, 0, 0, 0, 0, 0, 0, len(tags)])
        yield group.name
        entries = [f"{entity:10}{tag:10}{0:10}{0:10}" for tag in (tags + 1).tolist()]
        yield from ("".join(entries[j : j + 2]) for j in range(0, len(entries), 2))


def _row(numbers: Iterable[int]) -> str:
    return "".join(f"{number:10}" for number in numbers)
