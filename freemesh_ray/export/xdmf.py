"""XDMF, ``.xdmf``, all data in the file itself.

Grids as DOLFINx takes them: ``mesh`` of the elements, and ``facets`` of the sides and lines, each with an attribute of
its name, the number of the part. What a number is called stands in the grid as ``Information``.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from envs.types import Ints
from freemesh_ray.export.finite_elements import FiniteElements, Group

#: Kinds of elements by dimension and nodes.
TYPES = {
    (1, 2): "Polyline", (1, 3): "Edge_3", (2, 4): "Quadrilateral", (2, 8): "Quadrilateral_8",
    (2, 9): "Quadrilateral_9", (3, 8): "Hexahedron", (3, 20): "Hexahedron_20",
}  # fmt: skip


def write(mesh: FiniteElements, path: Path) -> None:
    """Write quadrilaterals of 4, 8 or 9 nodes, or hexahedra of 8 or 20."""
    path.write_bytes("\n".join([*_document(mesh), ""]).encode())


def _document(mesh: FiniteElements) -> Iterator[str]:
    d, groups = mesh.kind.dimension, list(mesh.groups())
    regions, facets = groups[: len(mesh.regions)], groups[len(mesh.regions) : len(mesh.regions) + len(mesh.facets)]
    yield from ('<?xml version="1.0"?>', '<Xdmf Version="3.0">', "<Domain>")
    yield from _grid("mesh", mesh, d, mesh.elements, regions, mesh.region_of + 1)
    sides = [part.facets for part in mesh.facets]
    numbers = np.repeat([group.number for group in facets], [len(part) for part in sides])
    yield from _grid("facets", mesh, d - 1, np.concatenate(sides), facets, numbers)
    yield from ("</Domain>", "</Xdmf>")


def _grid(
    name: str, mesh: FiniteElements, dimension: int, cells: Ints, groups: list[Group], numbers: Ints
) -> Iterator[str]:
    kind = TYPES[dimension, cells.shape[1]]
    yield f'<Grid Name="{name}" GridType="Uniform">'
    yield from (f'<Information Name="{group.number}" Value={quoteattr(group.name)}/>' for group in groups)
    per = f' NodesPerElement="{cells.shape[1]}"' if kind == "Polyline" else ""
    yield f'<Topology TopologyType="{kind}" NumberOfElements="{len(cells)}"{per}>'
    yield from _data(cells, "Int", 8)
    yield "</Topology>"
    yield f'<Geometry GeometryType="{"XYZ"[: mesh.nodes.shape[1]]}">'
    yield from _data(mesh.nodes, "Float", 8)
    yield "</Geometry>"
    yield f'<Attribute Name="{name}" AttributeType="Scalar" Center="Cell">'
    yield from _data(numbers[:, None], "Int", 4)
    yield from ("</Attribute>", "</Grid>")


def _data(rows: np.ndarray, kind: str, precision: int) -> Iterator[str]:
    shape = f'Dimensions="{len(rows)} {rows.shape[1]}"'
    yield f'<DataItem {shape} NumberType="{kind}" DataType="{kind}" Precision="{precision}" Format="XML">'
    yield from (" ".join(map(repr, row)) for row in rows.tolist())
    yield "</DataItem>"
