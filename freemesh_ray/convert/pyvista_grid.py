"""A mesh as PyVista's, to be looked at in a notebook and measured with VTK."""

from __future__ import annotations

from typing import Any

import numpy as np

from envs.errors import UserError
from envs.mesh import Mesh
from envs.quality import element_quality


def to_pyvista(mesh: Mesh) -> Any:
    """A pyvista.MultiBlock.

    Args:
        mesh: of quadrilaterals.

    Returns:
        The block ``elements``, an UnstructuredGrid of all vertices, number for number, with ``eta`` and ``region`` of
        each quad, the region's number from 1, 0 for none; then a block of lines for each side and line, by its name.

    Raises:
        UserError: PyVista is not installed.
    """
    try:
        import pyvista
    except ImportError:
        raise UserError("to_pyvista: PyVista is not installed; install it: pip install pyvista") from None

    places = np.column_stack([mesh.vertices, np.zeros(len(mesh.vertices))])
    grid = pyvista.UnstructuredGrid({pyvista.CellType.QUAD: mesh.quads}, places)
    grid.cell_data["eta"] = element_quality(mesh.vertices, mesh.quads)
    region = np.zeros(len(mesh.quads), dtype=np.int64)
    for i, quads in enumerate(mesh.groups.regions.values(), 1):
        region[quads] = i
    grid.cell_data["region"] = region
    blocks = pyvista.MultiBlock({"elements": grid})
    for name, rows in {**mesh.groups.sides, **mesh.groups.lines}.items():
        lines = np.column_stack([np.full(len(rows), 2), rows])
        blocks.append(pyvista.PolyData(places, lines=lines.ravel()), name)
    return blocks
