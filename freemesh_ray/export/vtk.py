"""VTK's XML format of unstructured grids, ``.vtu``.

The cells are the elements, then the sides and lines, then the points. The cell data ``group`` is the number of the part
that a cell is of, and the field data has an array of every part's name: its number and its dimension, as Gmsh's
physical groups have them. The cell data ``eta`` is the quality of the element, or of one behind it. Above order 2 the
elements are Lagrange's.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from envs.types import Ints
from freemesh_ray.export.element_kinds import Kind, Place
from freemesh_ray.export.finite_elements import FiniteElements

#: VTK's kinds of cells, by dimension and the number of their nodes.
TYPES = {
    (0, 1): 1, (1, 2): 3, (1, 3): 21, (1, 4): 68, (1, 5): 68,
    (2, 4): 9, (2, 8): 23, (2, 9): 28, (2, 16): 70, (2, 25): 70, (3, 8): 12, (3, 20): 25,
}  # fmt: skip
#: VTK's names of numbers.
NUMBERS = {"f8": "Float64", "i8": "Int64", "u1": "UInt8"}


def write(mesh: FiniteElements, path: Path) -> None:
    """Write the file, its arrays compressed."""
    path.write_bytes("\n".join([*_document(mesh), ""]).encode())


def _document(mesh: FiniteElements) -> Iterator[str]:
    blocks = list(_cells(mesh))
    counts = [len(nodes) for _, nodes, _ in blocks]
    sizes = np.repeat([nodes.shape[1] for _, nodes, _ in blocks], counts)
    types = np.repeat([TYPES[dimension, nodes.shape[1]] for dimension, nodes, _ in blocks], counts)
    groups = list(mesh.groups())
    group_of = np.empty(sum(counts), dtype=np.int64)
    for group, numbers in zip(groups, mesh.cell_numbers(), strict=True):
        group_of[numbers] = group.number
    yield '<?xml version="1.0"?>'
    yield (
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt32" '
        'compressor="vtkZLibDataCompressor">'
    )
    yield "<UnstructuredGrid>"
    yield "<FieldData>"
    for group in groups:
        yield _array(group.name, np.array([group.number, group.dimension]), tuples=2)
    yield "</FieldData>"
    yield f'<Piece NumberOfPoints="{len(mesh.nodes)}" NumberOfCells="{sum(counts)}">'
    yield from ("<Points>", _array("Points", mesh.places, components=3), "</Points>")
    yield "<Cells>"
    yield _array("connectivity", np.concatenate([nodes.ravel() for _, nodes, _ in blocks]))
    yield _array("offsets", np.cumsum(sizes))
    yield _array("types", types.astype(np.uint8))
    yield "</Cells>"
    yield "<CellData>"
    if mesh.eta is not None:
        yield _array("eta", np.concatenate([mesh.eta[behind] for _, _, behind in blocks]))
    yield _array("group", group_of)
    yield "</CellData>"
    yield from ("</Piece>", "</UnstructuredGrid>", "</VTKFile>")


def _cells(mesh: FiniteElements) -> Iterator[tuple[int, Ints, Ints]]:
    """Dimension and nodes of the elements, then of every side, line and point; and the elements behind the cells."""
    d = mesh.kind.dimension
    yield d, mesh.elements[:, mesh.kind.numbers(_places(mesh.kind))], np.arange(len(mesh.elements))
    yield from ((d - 1, part.facets, part.elements) for part in mesh.facets)
    yield from ((d - 2, point.cells, mesh.element_at(point.cells[:, 0])) for point in mesh.points)


def _places(kind: Kind) -> list[Place]:
    """Where an element's nodes lie, in VTK's order: opposite sides in one direction."""
    if kind.dimension == 3 or kind.order < 3:
        return list(kind.places)
    k, inner = kind.order, range(1, kind.order)
    sides = chain(((i, 0) for i in inner), ((k, i) for i in inner), ((i, k) for i in inner), ((0, i) for i in inner))
    return [*kind.places[:4], *sides, *((i, j) for j in inner for i in inner)]


def _array(name: str, values: np.ndarray, components: int = 0, tuples: int = 0) -> str:
    """An array: its bytes, compressed as one block, after the number of blocks, their sizes, and that compressed."""
    little = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<"))
    packed = zlib.compress(little.tobytes())
    header = np.array([1, little.nbytes, 0, len(packed)], dtype="<u4").tobytes()
    shape = f' NumberOfComponents="{components}"' if components else ""
    shape += f' NumberOfTuples="{tuples}"' if tuples else ""
    text = (base64.b64encode(header) + base64.b64encode(packed)).decode()
    kind = NUMBERS[f"{little.dtype.kind}{little.dtype.itemsize}"]
    return f'<DataArray type="{kind}" Name={quoteattr(name)}{shape} format="binary">{text}</DataArray>'
