"""Gmsh meshes, versions 2.2 and 4.1, ASCII or binary: the outline of the surfaces, or the loops of the lines.

Where there are triangles or quadrilaterals, each surface of the geometry is a polygon, its ring the edges that one
element has; where there are only line elements, they are chained into loops, and loops inside loops are holes.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from envs.polygons.rings import check_coordinates, check_rings, extent
from envs.readers.loops import faces
from envs.readers.nesting import nested
from envs.readers.source import excerpt
from envs.types import DomainError, Floats, Ints

#: Dimension, corners and nodes of Gmsh's element types.
ELEMENTS = {
    1: (1, 2, 2), 2: (2, 3, 3), 3: (2, 4, 4), 8: (1, 2, 3), 9: (2, 3, 6), 10: (2, 4, 9), 15: (0, 1, 1), 16: (2, 4, 8),
    21: (2, 3, 10), 26: (1, 2, 4), 27: (1, 2, 5), 36: (2, 4, 16),
}  # fmt: skip

#: Out of the plane by at most this share of the extent.
FLAT = 1e-6

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
class Mesh:
    """Nodes and elements of a mesh.

    Attributes:
        points: (p, 3) float64, the nodes' coordinates.
        index: the nodes' rows by their tags.
        lines: (l, 2) int64 nodes of line elements.
        corners: element corners, (e, 3 or 4) int64 blocks of nodes.
        surfaces: (e,) int64, the surface that each element of the same block lies on.
    """

    points: Floats
    index: Index
    lines: list[Ints] = field(default_factory=list)
    corners: list[Ints] = field(default_factory=list)
    surfaces: list[Ints] = field(default_factory=list)


def polygons_of_file(path: Path, edge_length: float | None = None) -> list[list[Any]]:
    """The rings of every surface in a mesh.

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
    used = np.concatenate([np.unique(block) for block in (*mesh.lines, *mesh.corners)] or [np.empty(0, np.int64)])
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
        edges = np.concatenate(mesh.lines)
        return nested(faces(list(points[edges]), edges, source), source)
    outlines = borders(mesh)
    check_rings(len(outlines), source)
    return [rings for edges in outlines for rings in nested(faces(list(points[edges]), edges, source), source)]


def borders(mesh: Mesh) -> list[Ints]:
    """For each surface the (b, 2) edges that one element of it has, in the order of the surfaces' tags."""
    edges = np.concatenate(
        [np.stack([block, np.roll(block, -1, axis=1)], axis=2).reshape(-1, 2) for block in mesh.corners]
    )
    surface = np.concatenate(
        [np.repeat(tags, block.shape[1]) for tags, block in zip(mesh.surfaces, mesh.corners, strict=True)]
    )
    rows = np.column_stack([surface, np.sort(edges, axis=1)])
    _, first, count = np.unique(rows, axis=0, return_index=True, return_counts=True)
    border = np.sort(first[count == 1])
    border = border[np.argsort(surface[border], kind="stable")]
    return np.split(edges[border], np.flatnonzero(np.diff(surface[border])) + 1)


def mesh_of(content: bytes) -> Mesh:
    """The mesh in a file's bytes.

    Raises:
        ValueError: what is broken; KeyError, IndexError, OverflowError: the same of a binary file's numbers.
    """
    version, binary, order = header_of(content)
    nodes, elements = (section(content, name, binary, order) for name in (b"Nodes", b"Elements"))
    if version.startswith("2"):
        points, index = nodes_2(nodes, binary)
        return elements_2(elements, binary, Mesh(points, index))
    if version in ("4", "4.1"):
        points, index = nodes_4(nodes)
        return elements_4(elements, Mesh(points, index))
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


def elements_2(data: Section, binary: bool, mesh: Mesh) -> Mesh:
    """The mesh with its elements of version 2.2: ``number type tags... nodes...`` each."""
    if binary:
        line, _, rows = data.content.partition(b"\n")
        data, total = Section(None, rows, data.order), int(line)
    else:
        total = data.one(SIZE)
    found: dict[int, tuple[list[Ints], list[Ints]]] = {}
    while total > 0:
        if binary:
            element_type, count, tags = data.take(INT, 3).tolist()
        else:
            (_, element_type, tags), count = data.take(INT, 3).tolist(), 1
        nodes = ELEMENTS[element_type][2] if element_type in ELEMENTS else unknown(element_type)
        if count < 1 or tags < 0:
            raise ValueError("a negative count")
        width = tags + nodes + binary
        block = data.take(INT, count * width).reshape(count, width)
        surface = block[:, binary + 1] if tags > 1 else np.zeros(count, dtype=np.int64)
        blocks, surfaces = found.setdefault(element_type, ([], []))
        blocks.append(block[:, binary + tags :])
        surfaces.append(surface)
        total -= count
    for element_type, (blocks, surfaces) in found.items():
        add(mesh, element_type, mesh.index.rows(np.concatenate(blocks)), np.concatenate(surfaces))
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
        _, surface, element_type = data.take(INT, 3).tolist()
        count = data.one(SIZE)
        nodes = ELEMENTS[element_type][2] if element_type in ELEMENTS else unknown(element_type)
        block = data.take(SIZE, count * (1 + nodes)).reshape(count, 1 + nodes)
        if count:
            add(mesh, element_type, mesh.index.rows(block[:, 1:]), np.full(count, surface, dtype=np.int64))
    return mesh


def unknown(element_type: int) -> int:
    """Refuse an element type."""
    raise ValueError(f"elements of type {element_type}; lines, triangles and quadrilaterals are read")


def add(mesh: Mesh, element_type: int, nodes: Ints, surface: Ints) -> None:
    """Take (e, nodes) elements of a type into the mesh: their corners, and of curved lines the nodes between too."""
    dimension, corners, _ = ELEMENTS[element_type]
    if dimension == 1:
        along = np.concatenate([nodes[:, :1], nodes[:, 2:], nodes[:, 1:2]], axis=1)
        mesh.lines.append(np.stack([along[:, :-1], along[:, 1:]], axis=2).reshape(-1, 2))
    elif dimension == 2:
        mesh.corners.append(nodes[:, :corners])
        mesh.surfaces.append(surface)
