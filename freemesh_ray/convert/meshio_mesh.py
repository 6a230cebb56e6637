"""A mesh as meshio's: quads, then edges of named sides and lines, then named points, with a cell set for each name."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from envs.mesh import Mesh
from envs.quality import element_quality

if TYPE_CHECKING:
    import meshio


def to_meshio(mesh: Mesh) -> meshio.Mesh:
    """A meshio.Mesh of the same vertices, number for number.

    Args:
        mesh: of quadrilaterals.

    Returns:
        Cells ``quad``, ``line`` and ``vertex``; ``cell_data["eta"]``, of edges and points not a number; ``cell_sets``
        by name: regions of quads, sides and lines of edges, points of vertices.
    """
    import meshio

    groups = mesh.groups
    edges = {**groups.sides, **groups.lines}
    lines = np.concatenate([np.zeros((0, 2), dtype=np.int64), *edges.values()])
    points = np.array(list(groups.points.values()), dtype=np.int64).reshape(-1, 1)
    blocks = [("quad", mesh.quads), ("line", lines), ("vertex", points)]
    present = [i for i, (_, cells) in enumerate(blocks) if i == 0 or len(cells)]
    none = np.zeros(0, dtype=np.int64)
    sets = {name: [quads, none, none] for name, quads in groups.regions.items()}
    first = 0
    for name, rows in edges.items():
        sets[name] = [none, np.arange(first, first + len(rows)), none]
        first += len(rows)
    for i, name in enumerate(groups.points):
        sets[name] = [none, none, np.array([i])]
    eta = [element_quality(mesh.vertices, mesh.quads), np.full(len(lines), np.nan), np.full(len(points), np.nan)]
    return meshio.Mesh(
        mesh.vertices.copy(),
        [blocks[i] for i in present],
        cell_data={"eta": [eta[i] for i in present]},
        cell_sets={name: [rows[i] for i in present] for name, rows in sets.items()},
    )
