"""Gmsh's ``.msh``, version 4.1 or 2.2, in ASCII.

Elements first, then the sides and lines, then the points. Each part is a physical group and an entity of its own, so
every element is in one group: readers that know one tag an element keep all names.

Version 4.1 has the element quality as element data ``eta``; that of a side's or a point's is that of an element behind
it, because meshio reads data of all elements or of none. Of version 2.2 it reads none if there is more than one kind of
element.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from envs.types import Floats, Ints
from freemesh_ray.export.element_kinds import Kind, Place
from freemesh_ray.export.finite_elements import FiniteElements

#: Gmsh's numbers for kinds of elements, by dimension and the number of their nodes.
TYPES = {
    (0, 1): 15, (1, 2): 1, (1, 3): 8, (1, 4): 26, (1, 5): 27,
    (2, 4): 3, (2, 8): 16, (2, 9): 10, (2, 16): 36, (2, 25): 37, (3, 8): 5, (3, 20): 17,
}  # fmt: skip

#: The edges of a hexahedron, by their middles in `element_kinds`, in Gmsh's order.
HEXAHEDRON_EDGES = (0, 3, 8, 1, 9, 2, 10, 11, 4, 7, 5, 6)


@dataclass(frozen=True)
class Block:
    """The elements of a part, which are an entity and a physical group.

    Attributes:
        dimension: of the entity.
        entity: its number among those of its dimension.
        group: the number of the physical group.
        name: of the part.
        numbers: (k,) int64, those of its elements in the file, from 1.
        nodes: (k, nodes of an element) int64, in Gmsh's order.
        behind: (k,) int64, the element whose quality each has.
        also: (j,) int64, nodes that belong to the part beside those of its elements.
    """

    dimension: int
    entity: int
    group: int
    name: str
    numbers: Ints
    nodes: Ints
    behind: Ints
    also: Ints

    @property
    def type(self) -> int:
        """Gmsh's number for the elements."""
        return TYPES[self.dimension, self.nodes.shape[1]]

    @property
    def members(self) -> Ints:
        """(n,) int64, ascending: its nodes."""
        return np.union1d(self.nodes, self.also)


def write(mesh: FiniteElements, path: Path, version: str) -> None:
    """Write version ``4.1`` or ``2.2`` of the format."""
    blocks = list(_blocks(mesh))
    body = _version_4(mesh, blocks) if version == "4.1" else _version_2(mesh, blocks)
    path.write_bytes("\n".join([*_section("MeshFormat", [f"{version} 0 8"]), *body, ""]).encode())


def _blocks(mesh: FiniteElements) -> Iterator[Block]:
    """Regions, then sides and lines, then points."""
    elements = mesh.elements[:, mesh.kind.numbers(_places(mesh.kind))]
    d, none = mesh.kind.dimension, np.zeros(0, dtype=np.int64)
    parts: list[tuple[Ints, Ints, Ints]] = [(elements[r.elements], r.elements, none) for r in mesh.regions]
    parts += [(part.facets, part.elements, part.nodes) for part in mesh.facets]
    parts += [(point.cells, mesh.element_at(point.cells[:, 0]), none) for point in mesh.points]
    counts = dict.fromkeys(range(d + 1), 0)
    for group, numbers, part in zip(mesh.groups(), mesh.cell_numbers(), parts, strict=True):
        counts[group.dimension] += 1
        yield Block(group.dimension, counts[group.dimension], group.number, group.name, numbers + 1, *part)


def _places(kind: Kind) -> list[Place]:
    """Where an element's nodes lie, in Gmsh's order."""
    if kind.dimension == 3:
        return [*kind.places[:8], *(kind.places[8 + i] for i in HEXAHEDRON_EDGES if kind.order == 2)]
    around = list(kind.places[: 4 * kind.order])
    return around if kind.serendipity else [*around, *_inside(1, kind.order - 1)]


def _inside(low: int, high: int) -> list[Place]:
    """The places within an element as those of an element: corners, sides, and so on inwards."""
    if low >= high:
        return [(low, low)] if low == high else []
    inner = range(low + 1, high)
    ring: list[Place] = [(low, low), (high, low), (high, high), (low, high)]
    ring += [(i, low) for i in inner] + [(high, i) for i in inner]
    ring += [(i, high) for i in reversed(inner)] + [(low, i) for i in reversed(inner)]
    return ring + _inside(low + 1, high - 1)


def _version_4(mesh: FiniteElements, blocks: list[Block]) -> Iterator[str]:
    yield from _section("PhysicalNames", _names(blocks))
    yield from _section("Entities", _entities(mesh, blocks))
    yield from _section("Nodes", _node_blocks(mesh, blocks))
    yield from _section("Elements", _element_blocks(blocks))
    if mesh.eta is not None:
        yield from _section("ElementData", _quality(mesh.eta, blocks))


def _version_2(mesh: FiniteElements, blocks: list[Block]) -> Iterator[str]:
    yield from _section("PhysicalNames", _names(blocks))
    nodes = (f"{i} {_point(point)}" for i, point in enumerate(mesh.places.tolist(), 1))
    yield from _section("Nodes", [str(len(mesh.nodes)), *nodes])
    # Tags of an element: how many, its physical group, its entity.
    rows = {
        number: f"{number} {block.type} 2 {block.group} {block.entity} {' '.join(map(str, row))}"
        for block in blocks
        for number, row in zip(block.numbers.tolist(), (block.nodes + 1).tolist(), strict=True)
    }
    yield from _section("Elements", [str(len(rows)), *(rows[number] for number in sorted(rows))])


def _section(name: str, lines: Iterable[str]) -> Iterator[str]:
    yield f"${name}"
    yield from lines
    yield f"$End{name}"


def _names(blocks: list[Block]) -> Iterator[str]:
    """Dimension, number and name of the physical groups."""
    yield str(len(blocks))
    ascending = sorted(blocks, key=lambda block: (block.dimension, block.group))
    yield from (f'{block.dimension} {block.group} "{block.name}"' for block in ascending)


def _entities(mesh: FiniteElements, blocks: list[Block]) -> Iterator[str]:
    """Number, bounding box, physical group and bounds of every part.

    Regions are bounded by the sides and lines that one element of theirs has; these are bounded by nothing.
    """
    yield " ".join(str(sum(block.dimension == d for block in blocks)) for d in range(4))
    bounds = _bounds(mesh, blocks)
    for d in range(4):
        for block in (block for block in blocks if block.dimension == d):
            points = mesh.places[block.members]
            # A point has its place where others have a box.
            box = _point(points[0].tolist()) if d == 0 else _box(points)
            ends = "" if d == 0 else f" {_list(bounds.get(block.group, []))}"
            yield f"{block.entity} {box} {_list([block.group])}{ends}"


def _bounds(mesh: FiniteElements, blocks: list[Block]) -> dict[int, list[int]]:
    """The entities that bound every region, by its group; negative where the region is on their right."""
    left = mesh.region_of
    found: dict[int, list[int]] = {region.group: [] for region in blocks[: len(mesh.regions)]}
    facets = blocks[len(mesh.regions) : len(mesh.regions) + len(mesh.facets)]
    for i, (block, part) in enumerate(zip(facets, mesh.facets, strict=True)):
        on_left = np.unique(left[part.elements])
        for region in on_left.tolist():
            found[region + 1].append(block.entity)
        if i >= len(mesh.sides):
            touching = np.isin(mesh.elements, part.facets).sum(axis=1) >= part.facets.shape[1]
            others = np.setdiff1d(np.unique(left[touching]), on_left)
            for region in others.tolist():
                found[region + 1].append(-block.entity)
    return found


def _node_blocks(mesh: FiniteElements, blocks: list[Block]) -> Iterator[str]:
    """Runs of nodes on one entity, so that the nodes of the file are in the order of their numbers.

    A node is on the entity of the fewest dimensions, the first of several.
    """
    owner = np.zeros(len(mesh.nodes), dtype=np.int64)
    for i, block in sorted(enumerate(blocks), key=lambda pair: (-pair[1].dimension, -pair[0])):
        owner[block.members] = i
    runs = np.split(np.arange(len(owner)), np.flatnonzero(np.diff(owner)) + 1)
    places = mesh.places
    yield f"{len(runs)} {len(owner)} 1 {len(owner)}"
    for run in runs:
        block = blocks[owner[run[0]]]
        yield f"{block.dimension} {block.entity} 0 {len(run)}"
        yield from map(str, (run + 1).tolist())
        yield from (_point(point) for point in places[run].tolist())


def _element_blocks(blocks: list[Block]) -> Iterator[str]:
    filled = [block for block in blocks if len(block.nodes)]
    total = sum(len(block.nodes) for block in filled)
    yield f"{len(filled)} {total} 1 {total}"
    for block in filled:
        yield f"{block.dimension} {block.entity} {block.type} {len(block.nodes)}"
        rows = zip(block.numbers.tolist(), (block.nodes + 1).tolist(), strict=True)
        yield from (f"{number} {' '.join(map(str, row))}" for number, row in rows)


def _quality(eta: Floats, blocks: list[Block]) -> Iterator[str]:
    """A view: its name, its time, then step, components and count, and a value an element, in the elements' order."""
    values = np.concatenate([eta[block.behind] for block in blocks]).tolist()
    numbers = np.concatenate([block.numbers for block in blocks]).tolist()
    yield from ("1", '"eta"', "1", "0.0", "3", "0", "1", str(len(values)))
    yield from (f"{number} {value!r}" for number, value in zip(numbers, values, strict=True))


def _box(points: Floats) -> str:
    return f"{_point(points.min(axis=0).tolist())} {_point(points.max(axis=0).tolist())}"


def _point(place: Iterable[float]) -> str:
    return " ".join(map(repr, place))


def _list(numbers: Iterable[int]) -> str:
    """How many, then they."""
    numbers = list(numbers)
    return " ".join(map(str, [len(numbers), *numbers]))
