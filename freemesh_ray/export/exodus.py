"""Exodus II files, ``.e`` or ``.exo``, in netCDF's classic format, which needs no library beyond SciPy.

A region is a block of elements, a side or line a side set, a point a node set, each with its name. (Schoof, Yarberry:
Exodus II, SAND92-2137.)
"""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import netcdf_file

from envs.types import Ints
from freemesh_ray.export.finite_elements import FiniteElements

#: Elements by dimension and nodes.
TYPES = {(2, 4): "QUAD4", (2, 8): "QUAD8", (2, 9): "QUAD9", (3, 8): "HEX8", (3, 20): "HEX20"}
#: Bytes of a name, and of a line, with the zero at its end.
NAME, LINE = 33, 81
#: The numbers of a hexahedron's faces, from 1, in the order of `element_kinds.FACES`.
FACES = np.array([5, 6, 1, 2, 3, 4])
#: The middles of a hexahedron's edges in the file's order: below, between, above.
MIDDLES = [*range(8, 12), *range(16, 20), *range(12, 16)]


def write(mesh: FiniteElements, path: Path) -> None:
    """Write quadrilaterals of 4, 8 or 9 nodes, or hexahedra of 8 or 20."""
    path.write_bytes(_encoded(mesh))


def _encoded(mesh: FiniteElements) -> bytes:
    d, n, m = mesh.kind.dimension, len(mesh.nodes), len(mesh.elements)
    bytes_of = BytesIO()
    with netcdf_file(bytes_of, "w", version=2) as file:
        file.api_version = np.float32(8.11)
        file.version = np.float32(8.11)
        file.floating_point_word_size = np.int32(8)
        file.file_size = np.int32(1)
        file.maximum_name_length = np.int32(NAME - 1)
        file.title = mesh.title
        sizes = {"len_string": NAME, "len_name": NAME, "len_line": LINE, "four": 4, "num_dim": d, "num_nodes": n}
        for name, size in {"time_step": None, **sizes, "num_elem": m, "num_el_blk": len(mesh.regions)}.items():
            file.createDimension(name, size)
        file.createVariable("time_whole", "f8", ("time_step",))
        for axis, values in zip("xyz", mesh.nodes.T, strict=False):
            _put(file, f"coord{axis}", "f8", ("num_nodes",), values)
        _put(file, "coor_names", "c", ("num_dim", "len_name"), _texts(list("xyz"[:d])))
        _blocks(file, mesh)
        _side_sets(file, mesh)
        _node_sets(file, mesh)
        file.flush()
        return bytes_of.getvalue()


def _blocks(file: Any, mesh: FiniteElements) -> None:
    """The blocks of elements, and the number that every element has in the mesh."""
    elements = mesh.elements[:, [*range(8), *MIDDLES]] if mesh.kind.nodes == 20 else mesh.elements
    _numbers(file, "num_el_blk", "eb", [region.name for region in mesh.regions])
    for i, region in enumerate(mesh.regions, 1):
        file.createDimension(f"num_el_in_blk{i}", len(region.elements))
        file.createDimension(f"num_nod_per_el{i}", elements.shape[1])
        shape = (f"num_el_in_blk{i}", f"num_nod_per_el{i}")
        connect = _put(file, f"connect{i}", "i4", shape, elements[region.elements] + 1)
        connect.elem_type = TYPES[mesh.kind.dimension, mesh.kind.nodes]
    _put(file, "elem_num_map", "i4", ("num_elem",), np.concatenate([r.elements for r in mesh.regions]) + 1)


def _side_sets(file: Any, mesh: FiniteElements) -> None:
    """Elements are counted in the order of the blocks."""
    place = np.empty(len(mesh.elements), dtype=np.int64)
    place[np.concatenate([region.elements for region in mesh.regions])] = np.arange(len(mesh.elements))
    parts = [part for part in mesh.facets if len(part.elements)]
    if not parts:
        return
    file.createDimension("num_side_sets", len(parts))
    _numbers(file, "num_side_sets", "ss", [part.name for part in parts])
    for i, part in enumerate(parts, 1):
        file.createDimension(f"num_side_ss{i}", len(part.elements))
        sides = part.sides + 1 if mesh.kind.dimension == 2 else FACES[part.sides]
        _put(file, f"elem_ss{i}", "i4", (f"num_side_ss{i}",), place[part.elements] + 1)
        _put(file, f"side_ss{i}", "i4", (f"num_side_ss{i}",), sides)


def _node_sets(file: Any, mesh: FiniteElements) -> None:
    if not mesh.points:
        return
    file.createDimension("num_node_sets", len(mesh.points))
    _numbers(file, "num_node_sets", "ns", [point.name for point in mesh.points])
    for i, point in enumerate(mesh.points, 1):
        file.createDimension(f"num_nod_ns{i}", len(point.nodes))
        _put(file, f"node_ns{i}", "i4", (f"num_nod_ns{i}",), point.nodes + 1)


def _numbers(file: Any, dimension: str, kind: str, names: list[str]) -> None:
    """Status, number and name of blocks or sets."""
    _put(file, f"{kind}_status", "i4", (dimension,), np.ones(len(names)))
    _put(file, f"{kind}_prop1", "i4", (dimension,), np.arange(1, len(names) + 1)).name = "ID"
    _put(file, f"{kind}_names", "c", (dimension, "len_name"), _texts(names))


def _put(file: Any, name: str, kind: str, shape: tuple[str, ...], values: np.ndarray | Ints) -> Any:
    variable = file.createVariable(name, kind, shape)
    variable[:] = values
    return variable


def _texts(names: list[str]) -> np.ndarray:
    """(k, NAME) characters, filled up with zeros."""
    return np.array([name.encode("ascii").ljust(NAME, b"\0") for name in names]).view("S1").reshape(len(names), NAME)
