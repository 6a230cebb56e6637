"""A mesh as scikit-fem's, to solve on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from envs.errors import UserError
from envs.mesh import Mesh
from envs.types import Ints

if TYPE_CHECKING:
    from skfem import MeshQuad


def to_skfem(mesh: Mesh) -> MeshQuad:
    """A skfem.MeshQuad of the same vertices, number for number.

    Args:
        mesh: of quadrilaterals.

    Returns:
        The mesh with ``boundaries`` by the names of sides and lines, and ``subdomains`` by those of regions.

    Raises:
        UserError: scikit-fem is not installed.
    """
    try:
        from skfem import MeshQuad
    except ImportError:
        raise UserError("to_skfem: scikit-fem is not installed; install it: pip install scikit-fem") from None

    plain = MeshQuad(np.ascontiguousarray(mesh.vertices.T), np.ascontiguousarray(mesh.quads.T))
    number = {tuple(ends): i for i, ends in enumerate(np.sort(plain.facets.T, axis=1).tolist())}

    def facets(rows: Ints) -> Ints:
        return np.array([number[tuple(ends)] for ends in np.sort(rows, axis=1).tolist()], dtype=np.int64)

    sides = {name: facets(rows) for name, rows in {**mesh.groups.sides, **mesh.groups.lines}.items()}
    if sides:
        plain = plain.with_boundaries(sides)
    return plain.with_subdomains(dict(mesh.groups.regions)) if mesh.groups.regions else plain
