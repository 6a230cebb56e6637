"""Lowest-order finite elements on a mesh of quadrilaterals and triangles, by scikit-fem.

Degrees of freedom are those of the vertices, in their order, so that the matrices of both kinds of element add up.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import skfem
from scipy.sparse import csr_matrix
from skfem import Basis, ElementQuad1, ElementTriP1, ElementVector, MeshQuad, MeshTri

from envs.types import Floats
from freemesh_ray.compare.mixed_mesh import MixedMesh

#: Order of the quadrature: errors are integrated with it, too.
ORDER = 6


def bases(mesh: MixedMesh, *, components: int = 1) -> list[Basis]:
    """Bilinear on quadrilaterals, linear on triangles.

    Args:
        mesh: it; elements counter-clockwise.
        components: values at a vertex; of two those of vertex i are 2 i and 2 i + 1.
    """
    kinds = [(MeshQuad, ElementQuad1(), mesh.quads), (MeshTri, ElementTriP1(), mesh.triangles)]
    found = []
    for kind, element, elements in kinds:
        if len(elements):
            own = kind(mesh.vertices.T.copy(), elements.T.copy(), sort_t=False, validate=False)
            found.append(Basis(own, element if components == 1 else ElementVector(element, components), intorder=ORDER))
    return found


def matrix(form: Any, on: Sequence[Basis]) -> csr_matrix:
    """A bilinear form assembled over all elements."""
    parts = [skfem.asm(form, basis).tocsr() for basis in on]
    size = max(part.shape[0] for part in parts)
    for part in parts:  # scikit-fem knows no vertices behind the last that its elements use
        part.resize(size, size)
    return sum(parts)


def vector(form: Any, on: Sequence[Basis]) -> Floats:
    """A linear form assembled over all elements."""
    found = np.zeros(max(basis.N for basis in on))
    for basis in on:
        found[: basis.N] += skfem.asm(form, basis)
    return found


def integral(form: Any, on: Sequence[Basis], values: Floats) -> float:
    """A functional of a discrete function, ``values`` at its degrees of freedom, over all elements."""
    return float(sum(skfem.asm(form, basis, u=basis.interpolate(values[: basis.N])) for basis in on))


def solved(stiffness: csr_matrix, given: Floats, load: Floats, fixed: Floats) -> Floats:
    """The solution of a system some of whose degrees of freedom are given.

    Args:
        stiffness: (n, n).
        given: (n,) values, of which those of ``fixed`` count.
        load: (n,).
        fixed: (k,) indices.
    """
    found: Floats = skfem.solve(*skfem.condense(stiffness, load, x=given, D=fixed))
    return found
