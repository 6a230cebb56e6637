"""Gmsh meshes, versions 2.2 and 4.1, ASCII or binary: the outline of the surfaces, or the loops of the lines.

Where there are triangles or quadrilaterals, each surface of the geometry is a polygon, its ring the edges that one
element has; where there are only line elements, they are chained into loops, and loops inside loops are holes.
Physical groups become names: of surfaces regions, of line elements lines, of point elements places. Line and point
elements inside a surface are lines and places inside, with and without a name.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from envs.polygons.drawing import Drawing, Line, Place, Reading
from envs.polygons.rings import check_coordinates, check_rings, extent
from envs.readers.closed_loops import faces
from envs.readers.file_check import excerpt
from envs.readers.nesting import nested
from envs.readers.physical import names_of
from envs.types import DomainError, Floats, Ints

#: Dimension, corners and nodes of Gmsh's element types.
ELEMENTS = {
    1: (1, 2, 2), 2: (2, 3, 3), 3: (2, 4, 4), 8: (1, 2, 3), 9: (2, 3, 6), 10: (2, 4, 9), 15: (0, 1, 1), 16: (2, 4, 8),
    21: (2, 3, 10), 26: (1, 2, 4), 27: (1, 2, 5), 36: (2, 4, 16),
}  # fmt: skip

#: Out of the plane by at most this share of the extent.
FLAT = 1e-6

#: Entities of the geometry at most that are asked for their physical groups: each is read by itself.
MOST_ENTITIES = 200_000

#: Dimension and number of a physical group.
Group = tuple[int, int]

#: Whole numbers up to here are exact as floats.
LARGEST_WHOLE = 2.0**53

INT, SIZE, FLOAT = "i4", "u8", "f8"


@dataclass
class Section:
    """The numbers between ``$Name`` and ``$EndName``, taken one after another.

    Attributes:
        numbers: (n,) float64, those of an ASCII section; None for a binary one.
        content: the bytes of a binary section.
        order: ``<`` or ``>``, the byte order of a binary section.
        at: numbers or bytes already taken.
    """

    numbers: Floats | None
    content: bytes
    order: str
    at: int = 0

    def take(self, dtype: str, count: int) -> np.ndarray:
        """The next numbers of a type, (count,).

        Raises:
            ValueError: the section ends before, or holds something else.
        """
        if count < 0:
            raise ValueError("a negative count")
        if self.numbers is not None:
            numbers = self.numbers[self.at : self.at + count]
            self.at += count
            if dtype != FLOAT:
                if not (np.abs(numbers) <= LARGEST_WHOLE).all() or (numbers != np.floor(numbers)).any():
                    raise ValueError("a number that is not whole")
                numbers = numbers.astype(np.int64)
        else:
            stored = np.dtype(self.order + dtype)
            size = count * stored.itemsize
            numbers = np.frombuffer(self.content[self.at : self.at + size], dtype=stored)
            self.at += size
            numbers = numbers.astype(np.float64 if dtype == FLOAT else np.int64)
        if len(numbers) != count:
            raise ValueError("a section ends too early")
        return numbers

    def one(self, dtype: str) -> int:
        """The next whole number."""
        return int(self.take(dtype, 1)[0])


@dataclass
class Elements:
    """Elements of one kind.

    Attributes:
        nodes: (e, k) int64, corners in order; of lines all nodes, from one end to the other.
        entities: (e,) int64, the point, curve or surface of the geometry that each lies on.
        groups: (e,) int64, the physical group of each; 0: none.
    """

    nodes: Ints
    entities: Ints
    groups: Ints


@dataclass
class Mesh:
    """Nodes and elements of a mesh.

    Attributes:
        points: (p, 3) float64, the nodes' coordinates.
        index: the nodes' rows by their tags.
        elements: those of dimensions 0, 1 and 2.
        names: of physical groups, by dimension and number.
        notes: what was read in another way than it was stated, a line each.
    """

    points: Floats
    index: Index
    elements: tuple[list[Elements], list[Elements], list[Elements]] = field(default_factory=lambda: ([], [], []))
    names: dict[Group, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    @property
    def corners(self) -> list[Ints]:
        """Corners of the surface elements, (e, 3 or 4) int64 blocks of nodes."""
        return [block.nodes for block in self.elements[2]]

    def called(self, dimension: int, group: int) -> str:
        """The name of a physical group; one without is called by its number, none by nothing."""
        kind = ("point", "curve", "surface")[dimension]
        return self.names.get((dimension, group), f"{kind}_{group}") if group else ""


def drawing_of_file(path: Path, reading: Reading) -> Drawing:
    """The outline of every surface in a mesh, and what is named in it.

    Raises:
        DomainError: a broken file, another version, no boundary, or one that is not in the x, y plane.
    """
    source = str(path)
    try:
        mesh = mesh_of(path.read_bytes())
    except (ValueError, OverflowError, IndexError, KeyError) as error:
        raise DomainError(
            f"{source}: not a valid Gmsh mesh ({excerpt(str(error), 80)}); save it again, version 4.1"
        ) from None
    blocks = [block.nodes for elements in mesh.elements[1:] for block in elements]
    used = np.unique(np.concatenate([block.ravel() for block in blocks])) if blocks else np.empty(0, np.int64)
    if not len(used):
        raise DomainError(f"{source}: no line and no surface elements; save the boundary with the mesh")
    check_coordinates(mesh.points[used], source, lambda _: "a node")
    heights = mesh.points[used, 2]
    if np.ptp(heights) > FLAT * extent(mesh.points[used, :2]):
        raise DomainError(
            f"{source}: heights from {heights.min():g} to {heights.max():g}; give a mesh in the x, y plane"
        )
    points = np.ascontiguousarray(mesh.points[:, :2])
    if not mesh.corners:
        edges = np.concatenate([edges_along(block.nodes) for block in mesh.elements[1]])
        polygons = nested(faces(list(points[edges]), edges, source), source)
        return Drawing(polygons, lines=lines_of(mesh, points, np.empty((0, 2), np.int64)), notes=mesh.notes)
    outlines, inside, regions = borders(mesh)
    check_rings(len(outlines), source)
    polygons, names = [], []
    for edges, region in zip(outlines, regions, strict=True):
        found = nested(faces(list(points[edges]), edges, source), source)
        polygons += found
        names += [region] * len(found)
    return Drawing(
        polygons,
        regions=names if any(names) else (),
        lines=lines_of(mesh, points, inside),
        places=places_of(mesh, points, outlines, inside),
        notes=mesh.notes,
    )


def polygons_of_file(path: Path, edge_length: float | None = None) -> list[list[Any]]:
    """The rings of every surface in a mesh."""
    return [list(rings) for rings in drawing_of_file(path, Reading(edge_length)).polygons]


def edges_along(nodes: Ints) -> Ints:
    """(e, k) nodes of lines -> (e (k - 1), 2) edges from one to the next."""
    return np.stack([nodes[:, :-1], nodes[:, 1:]], axis=2).reshape(-1, 2)


def borders(mesh: Mesh) -> tuple[list[Ints], Ints, list[str]]:
    """What surfaces are bounded by.

    Returns:
        For each surface, in the order of their tags, the (b, 2) edges that one element of it has; the (i, 2) edges
        that two of one surface have, sorted; the name of each surface.
    """
    edges = np.concatenate(
        [np.stack([block, np.roll(block, -1, axis=1)], axis=2).reshape(-1, 2) for block in mesh.corners]
    )
    pairs = np.concatenate([np.column_stack([block.entities, block.groups]) for block in mesh.elements[2]])
    distinct, number = np.unique(pairs, axis=0, return_inverse=True)
    sides = np.concatenate([np.full(len(block), block.shape[1]) for block in mesh.corners])
    surface = np.repeat(number.ravel(), sides)
    rows = np.column_stack([surface, np.sort(edges, axis=1)])
    found, first, count = np.unique(rows, axis=0, return_index=True, return_counts=True)
    border = np.sort(first[count == 1])
    border = border[np.argsort(surface[border], kind="stable")]
    outlines = np.split(edges[border], np.flatnonzero(np.diff(surface[border])) + 1)
    names = [mesh.called(2, int(distinct[surface[i], 1])) for i in border[starts_of(surface[border])]]
    return outlines, found[count > 1, 1:], names


def starts_of(numbers: Ints) -> Ints:
    """Where each stretch of equal numbers begins."""
    return np.append(0, np.flatnonzero(np.diff(numbers)) + 1)


def lines_of(mesh: Mesh, points: Floats, inside: Ints) -> list[Line]:
    """The line elements that have a name, or are among the (i, 2) edges inside, end to end.

    Where there are surfaces, lines go straight from corner to corner, as their elements do.
    """
    edges, called = [], []
    for block in mesh.elements[1]:
        nodes = block.nodes[:, [0, -1]] if mesh.corners else block.nodes
        edges.append(edges_along(nodes))
        called.append(np.repeat(block.groups, nodes.shape[1] - 1))
    if not edges:
        return []
    every, group = np.concatenate(edges), np.concatenate(called)
    within = among(every, inside)
    lines = []
    for number in np.unique(group[(group > 0) | within]).tolist():
        chosen = (group == number) & (within if number == 0 else True)
        name = mesh.called(1, number)
        lines += [Line(points[path], name) for path in chained(every[chosen])]
    return lines


def among(edges: Ints, others: Ints) -> np.ndarray:
    """(m,) bool: which of (m, 2) edges are among others, whose ends are in ascending order."""
    base = int(max(edges.max(initial=0), others.max(initial=0))) + 1
    return np.isin(np.sort(edges, axis=1) @ np.array([base, 1]), others @ np.array([base, 1]))


def chained(edges: Ints) -> list[list[int]]:
    """Paths of nodes along (m, 2) edges, each edge once; paths end where other than two edges meet."""
    at: dict[int, list[int]] = {}
    for i, ends in enumerate(edges.tolist()):
        for node in ends:
            at.setdefault(node, []).append(i)
    ends_of = edges.tolist()
    left = dict.fromkeys(range(len(edges)))
    branching = [node for node, met in at.items() if len(met) != 2]
    paths = []
    for start in (*branching, *at):
        for first in at[start]:
            if first not in left:
                continue
            path, edge, node = [start], first, start
            while True:
                del left[edge]
                a, b = ends_of[edge]
                node = b if a == node else a
                path.append(node)
                following = [other for other in at[node] if other in left] if len(at[node]) == 2 else []
                if not following or node == start:
                    break
                edge = following[0]
            paths.append(path)
    return paths


def places_of(mesh: Mesh, points: Floats, outlines: list[Ints], inside: Ints) -> list[Place]:
    """The point elements that have a name, or lie inside a surface and off all lines."""
    found: dict[int, str] = {}
    for block in mesh.elements[0]:
        for node, group in zip(block.nodes[:, 0].tolist(), block.groups.tolist(), strict=True):
            found[node] = found.get(node) or mesh.called(0, group)
    on_lines = [block.nodes.ravel() for block in mesh.elements[1]]
    off = set(inside.ravel().tolist()).difference(*(edges.ravel().tolist() for edges in (*outlines, *on_lines)))
    chosen = {node: name for node, name in found.items() if name or node in off}
    return [Place(float(points[node, 0]), float(points[node, 1]), name) for node, name in chosen.items()]


def mesh_of(content: bytes) -> Mesh:
    """The mesh in a file's bytes.

    Raises:
        ValueError: what is broken; KeyError, IndexError, OverflowError: the same of a binary file's numbers.
    """
    version, binary, order = header_of(content)
    nodes, elements = (section(content, name, binary, order) for name in (b"Nodes", b"Elements"))
    if version.startswith("2"):
        points, index = nodes_2(nodes, binary)
        mesh = elements_2(elements, binary, Mesh(points, index, names=group_names(content)))
        without_copies(mesh)
        return mesh
    if version in ("4", "4.1"):
        points, index = nodes_4(nodes)
        mesh = elements_4(elements, Mesh(points, index, names=group_names(content)))
        if b"$Entities" in content:
            take_groups(mesh, groups_4(section(content, b"Entities", binary, order)))
        return mesh
    raise ValueError(f"version {version[:10]}; 2.2 and 4.1 are read")


def header_of(content: bytes) -> tuple[str, bool, str]:
    """The version of a file, whether it is binary, and its byte order.

    Raises:
        ValueError: it says none.
    """
    header = content.partition(b"$MeshFormat")[2].lstrip().split(b"\n", 1)
    words = header[0].split()
    if len(words) < 3 or len(header) < 2:
        raise ValueError("no $MeshFormat")
    binary = words[1] == b"1"
    return words[0].decode("ascii", "replace"), binary, ">" if binary and header[1][:4] == b"\0\0\0\1" else "<"


def section(content: bytes, name: bytes, binary: bool, order: str) -> Section:
    """The section of a name."""
    _, found, rest = content.partition(b"$" + name)
    inside, closed, _ = rest.partition(b"$End" + name)
    if not found or not closed:
        raise ValueError(f"no ${name.decode()} section")
    if not binary:
        return Section(numbers_in(inside), b"", order)
    return Section(None, inside.partition(b"\n")[2], order)


def numbers_in(text: bytes) -> Floats:
    """(n,) the numbers in an ASCII section."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # what NumPy says when it stops before the end
        try:
            return np.fromstring(text.strip(), sep=" ")
        except DeprecationWarning:
            raise ValueError("something else than numbers") from None


class Index:
    """Rows of nodes by their tags, which may be any whole numbers."""

    def __init__(self, tags: Ints) -> None:
        self.order = np.argsort(tags, kind="stable")
        self.tags = tags[self.order]

    def rows(self, tags: Ints) -> Ints:
        """The rows of tags, of the same shape."""
        at = np.minimum(np.searchsorted(self.tags, tags), len(self.tags) - 1)
        if not len(self.tags) or (self.tags[at] != tags).any():
            raise ValueError("an element of a node that does not exist")
        return self.order[at]


def nodes_2(data: Section, binary: bool) -> tuple[Floats, Index]:
    """Points and tags of version 2.2: a count, then ``tag x y z`` each."""
    if not binary:
        count = data.one(SIZE)
        table = data.take(FLOAT, 4 * count).reshape(-1, 4)
        tags = table[:, 0].astype(np.int64)
        if (tags != table[:, 0]).any():
            raise ValueError("a node tag that is no whole number")
        return table[:, 1:], Index(tags)
    line, _, rows = data.content.partition(b"\n")
    count = int(line)
    if not 0 <= count * 28 <= len(rows):
        raise ValueError("a section ends too early")
    table = np.frombuffer(rows[: count * 28], dtype=[("tag", data.order + "i4"), ("x", data.order + "f8", 3)])
    return table["x"].astype(np.float64), Index(table["tag"].astype(np.int64))


def group_names(content: bytes) -> dict[Group, str]:
    """Names of physical groups: a count, then ``dimension number "name"`` each."""
    inside = content.partition(b"$PhysicalNames")[2].partition(b"$EndPhysicalNames")[0]
    names: dict[Group, str] = {}
    for line in inside.splitlines():
        words = line.split(maxsplit=2)
        if len(words) == 3:
            name = words[2].strip().strip(b'"').decode("utf-8", "replace")
            names[int(words[0]), int(words[1])] = name
    return names


def without_copies(mesh: Mesh) -> None:
    """Take out elements that come again in another group, as version 2.2 writes those of several."""
    for dimension, blocks in enumerate(mesh.elements):
        for block in blocks:
            _, first = np.unique(np.sort(block.nodes, axis=1), axis=0, return_index=True)
            if len(first) == len(block.nodes):
                continue
            kept = np.sort(first)
            kind = ("point", "curve", "surface")[dimension]
            twice = len(block.nodes) - len(kept)
            mesh.notes.append(f"{twice} elements of {kind}s are in several physical groups; the first names them")
            block.nodes, block.entities, block.groups = block.nodes[kept], block.entities[kept], block.groups[kept]


def groups_4(data: Section) -> dict[Group, list[int]]:
    """Physical groups of the entities of version 4.1, by dimension and tag of the entity."""
    counts = data.take(SIZE, 4).tolist()
    found: dict[Group, list[int]] = {}
    if sum(counts[:3]) > MOST_ENTITIES:
        return found
    for dimension, count in enumerate(counts[:3]):
        for _ in range(count):
            tag = data.one(INT)
            data.take(FLOAT, 3 if dimension == 0 else 6)
            found[dimension, tag] = data.take(INT, data.one(SIZE)).tolist()
            if dimension:
                data.take(INT, data.one(SIZE))
    return found


def take_groups(mesh: Mesh, groups: dict[Group, list[int]]) -> None:
    """Note for each element the physical group of its entity, the first of several."""
    for dimension, blocks in enumerate(mesh.elements):
        kind = ("point", "curve", "surface")[dimension]
        of_kind = [(number, tag) for (d, tag), numbers in groups.items() if d == dimension for number in numbers]
        members = ((abs(number), mesh.called(dimension, abs(number)), [tag]) for number, tag in of_kind)
        mesh.notes += names_of(kind, members)[1]
        first = {tag: abs(numbers[0]) for (d, tag), numbers in groups.items() if d == dimension and numbers}
        for block in blocks:
            distinct, number = np.unique(block.entities, return_inverse=True)
            block.groups = np.array([first.get(tag, 0) for tag in distinct.tolist()], dtype=np.int64)[number.ravel()]


def elements_2(data: Section, binary: bool, mesh: Mesh) -> Mesh:
    """The mesh with its elements of version 2.2: ``number type tags... nodes...`` each."""
    if binary:
        line, _, rows = data.content.partition(b"\n")
        data, total = Section(None, rows, data.order), int(line)
    else:
        total = data.one(SIZE)
    found: dict[int, list[tuple[Ints, Ints, Ints]]] = {}
    while total > 0:
        if binary:
            element_type, count, tags = data.take(INT, 3).tolist()
        else:
            (_, element_type, tags), count = data.take(INT, 3).tolist(), 1
        nodes = ELEMENTS[element_type][2] if element_type in ELEMENTS else unknown(element_type)
        if count < 1 or tags < 0:
            raise ValueError("a negative count")
        before = int(binary)  # the element's number
        width = before + tags + nodes
        block = data.take(INT, count * width).reshape(count, width)
        none = np.zeros(count, dtype=np.int64)
        entities = block[:, before + 1] if tags > 1 else none
        groups = np.abs(block[:, before]) if tags > 0 else none
        found.setdefault(element_type, []).append((block[:, before + tags :], entities, groups))
        total -= count
    for element_type, blocks in found.items():
        joined = [np.concatenate(column) for column in zip(*blocks, strict=True)]
        add(mesh, element_type, mesh.index.rows(joined[0]), joined[1], joined[2])
    return mesh


def nodes_4(data: Section) -> tuple[Floats, Index]:
    """Points and tags of version 4.1: blocks of tags, then of coordinates."""
    blocks = data.take(SIZE, 4)[0]
    points, tags = [np.empty((0, 3))], [np.empty(0, np.int64)]
    for _ in range(blocks):
        dimension, _, parametric = data.take(INT, 3)
        count = data.one(SIZE)
        tags.append(data.take(SIZE, count))
        width = 3 + (int(dimension) if parametric else 0)
        points.append(data.take(FLOAT, count * width).reshape(count, width)[:, :3])
    return np.concatenate(points), Index(np.concatenate(tags))


def elements_4(data: Section, mesh: Mesh) -> Mesh:
    """The mesh with its elements of version 4.1: blocks of one type on one entity, ``number nodes...`` each."""
    blocks = data.take(SIZE, 4)[0]
    for _ in range(blocks):
        _, entity, element_type = data.take(INT, 3).tolist()
        count = data.one(SIZE)
        nodes = ELEMENTS[element_type][2] if element_type in ELEMENTS else unknown(element_type)
        block = data.take(SIZE, count * (1 + nodes)).reshape(count, 1 + nodes)
        if count:
            none = np.zeros(count, dtype=np.int64)
            add(mesh, element_type, mesh.index.rows(block[:, 1:]), none + entity, none)
    return mesh


def unknown(element_type: int) -> int:
    """Refuse an element type."""
    raise ValueError(f"elements of type {element_type}; lines, triangles and quadrilaterals are read")


def add(mesh: Mesh, element_type: int, nodes: Ints, entities: Ints, groups: Ints) -> None:
    """Take (e, nodes) elements of a type into the mesh: their corners, and of curved lines the nodes between too."""
    dimension, corners, _ = ELEMENTS[element_type]
    if dimension == 1:
        nodes = np.concatenate([nodes[:, :1], nodes[:, 2:], nodes[:, 1:2]], axis=1)
    else:
        nodes = nodes[:, :corners]
    mesh.elements[dimension].append(Elements(nodes, entities, groups))
