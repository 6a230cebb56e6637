"""MFEM's ``.mesh``, version 1.0: elements and boundary elements with attributes, and nodes of curved elements.

A region is an attribute, a side a boundary attribute, each counted from 1; their names stand in comments. Elements
above order 1 are said by a continuous grid function of the nodes' places: the values at the vertices, then those inside
the edges, in the order in which the elements have them first and from an edge's lower vertex on, then those inside the
elements.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from envs.types import Ints
from freemesh_ray.export.facets import numbered
from freemesh_ray.export.finite_elements import FiniteElements

#: MFEM's numbers of a segment, a square and a cube, by dimension.
GEOMETRIES = {1: 1, 2: 3, 3: 5}


def write(mesh: FiniteElements, path: Path) -> None:
    """Write quadrilaterals of 4, 9, 16 or 25 nodes, or hexahedra of 8."""
    path.write_bytes("\n".join([*_lines(mesh), ""]).encode("ascii"))


def _lines(mesh: FiniteElements) -> Iterator[str]:
    d, corners = mesh.kind.dimension, mesh.kind.corners
    yield from ("MFEM mesh v1.0", "", f"# {mesh.title}")
    yield from (f"# attribute {i}: {region.name}" for i, region in enumerate(mesh.regions, 1))
    yield from (f"# boundary attribute {i}: {side.name}" for i, side in enumerate(mesh.sides, 1))
    yield from ("", "dimension", str(d), "", "elements", str(len(mesh.elements)))
    rows = zip((mesh.region_of + 1).tolist(), mesh.elements[:, :corners].tolist(), strict=True)
    yield from (f"{region} {GEOMETRIES[d]} {' '.join(map(str, nodes))}" for region, nodes in rows)
    yield from ("", "boundary", str(sum(len(side.facets) for side in mesh.sides)))
    for i, side in enumerate(mesh.sides, 1):
        facets = side.facets[:, : 2 ** (d - 1)].tolist()
        yield from (f"{i} {GEOMETRIES[d - 1]} {' '.join(map(str, nodes))}" for nodes in facets)
    count = len(mesh.nodes) if mesh.kind.order == 1 else _vertices(mesh)
    yield from ("", "vertices", str(count))
    if mesh.kind.order == 1:
        yield str(d)
        yield from (" ".join(map(repr, point)) for point in mesh.nodes.tolist())
        return
    # Nodes apart evenly are those of MFEM's own basis at order 2, and have a name of their own above.
    basis = "H1" if mesh.kind.order == 2 else "H1@U"
    yield from ("", "nodes", "FiniteElementSpace", f"FiniteElementCollection: {basis}_2D_P{mesh.kind.order}")
    yield from ("VDim: 2", "Ordering: 1", "")
    yield from (" ".join(map(repr, point)) for point in mesh.nodes[_places(mesh)].tolist())


def _vertices(mesh: FiniteElements) -> int:
    """How many vertices: those come first among the nodes, whether an element has them or not."""
    return int(mesh.elements[:, 4:].min())


def _places(mesh: FiniteElements) -> Ints:
    """(n,) int64: the nodes in the order of the grid function."""
    k, corners = mesh.kind.order, mesh.elements[:, :4]
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2)
    number, _ = numbered(ends)
    _, first = np.unique(number, return_index=True)
    first = np.sort(first)
    along = mesh.elements[:, 4 : 4 * k].reshape(-1, k - 1)[first]
    along = np.where((ends[first, 0] > ends[first, 1])[:, None], along[:, ::-1], along)
    inside = mesh.elements[:, 4 * k :]
    return np.concatenate([np.arange(_vertices(mesh)), along.ravel(), inside.ravel()])
