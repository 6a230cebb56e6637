"""Sizes on a background mesh: a ``.msh`` file with node data."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from envs.readers.file_check import excerpt
from envs.readers.msh import FLOAT, INT, Section, header_of, mesh_of, numbers_in
from envs.readers.size_triangles import Triangles
from envs.types import DomainError, Floats


def sizes_of_file(path: Path) -> Triangles:
    """The first node data of a mesh of triangles and quadrilaterals, linear on each triangle.

    Raises:
        DomainError: a broken file, no triangles, no node data, or data that leaves corners out.
        UserError: a size that is not positive.
    """
    source = str(path)
    content = path.read_bytes()
    try:
        mesh = mesh_of(content)
        if not mesh.corners:
            raise DomainError(f"{source}: no triangles or quadrilaterals; save the surfaces with the mesh")
        if b"$NodeData" not in content:
            raise DomainError(f"{source}: no node data; save the view of the sizes with the mesh, as $NodeData")
        values = np.full(len(mesh.points), np.nan)
        tags, found = node_data(content)
        values[mesh.index.rows(tags)] = found
    except (ValueError, OverflowError, IndexError, KeyError) as error:
        if isinstance(error, DomainError):
            raise
        raise DomainError(
            f"{source}: not a valid Gmsh mesh with node data ({excerpt(str(error), 80)}); save it again, version 4.1"
        ) from None
    corners = np.concatenate([
        block[:, chosen] for block in mesh.corners for chosen in ([0, 1, 2], [0, 2, 3])[: block.shape[1] - 2]
    ])  # fmt: skip
    return Triangles(np.ascontiguousarray(mesh.points[:, :2]), corners, values, source)


def node_data(content: bytes) -> tuple[np.ndarray, Floats]:
    """Tags and values of the first node data.

    Raises:
        ValueError: what is broken.
    """
    _, binary, order = header_of(content)
    inside = content.partition(b"$NodeData")[2].partition(b"$EndNodeData")[0].lstrip()
    lines = inside
    whole: list[int] = []
    for kind in range(3):  # texts, real numbers, whole numbers: a count, then a line each
        first, _, lines = lines.partition(b"\n")
        count = int(first)
        if not 0 <= count <= 1000:
            raise ValueError("a negative count")
        for _ in range(count):
            line, _, lines = lines.partition(b"\n")
            if kind == 2:
                whole.append(int(line))
    if len(whole) < 3:
        raise ValueError("node data without a number of nodes")
    components, nodes = whole[1:3]
    if components != 1:
        raise ValueError(f"node data of {components} components where one size is needed")
    if binary:
        stored = np.dtype([("tag", order + INT), ("value", order + FLOAT)])
        if not 0 <= nodes * stored.itemsize <= len(lines):
            raise ValueError("a section ends too early")
        table = np.frombuffer(lines[: nodes * stored.itemsize], dtype=stored)
        return table["tag"].astype(np.int64), table["value"].astype(np.float64)
    rows = Section(numbers_in(lines), b"", order).take(FLOAT, 2 * nodes).reshape(-1, 2)
    return rows[:, 0].astype(np.int64), rows[:, 1]
