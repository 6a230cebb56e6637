"""VTK's XML format of unstructured grids, ``.vtu``."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np

from freemesh_ray.export.finite_elements import FiniteElements


def write(mesh: FiniteElements, path: Path) -> None:
    """Write the elements with their quality as cell data ``eta``."""
    points = np.column_stack([mesh.nodes, np.zeros(len(mesh.nodes))])
    cells = [("quad8" if mesh.quadratic else "quad", mesh.elements)]
    meshio.Mesh(points, cells, cell_data={"eta": [mesh.eta]}).write(path, file_format="vtu")
