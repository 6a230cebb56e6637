"""Plain Laplacian smoothing, beside which our finish is set: a vertex moves to the mean of its neighbours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array, csr_array

from envs.mesh import Mesh, edges_of
from envs.quality import convex_quality
from envs.types import Floats, Ints

#: Sweeps over all vertices.
SWEEPS = 20


def smoothed(mesh: Mesh, sweeps: int = SWEEPS) -> Mesh:
    """The mesh with its interior vertices moved, all at once in every sweep; connectivity and boundary stay.

    A vertex of an element that would not be strictly convex then stays where it was in that sweep.

    Args:
        mesh: complete, without defects.
        sweeps: how often all vertices move; >= 0.
    """
    vertices, free = mesh.vertices.copy(), ~mesh.on_boundary
    towards = _means(mesh.quads, len(vertices))
    for _ in range(sweeps):
        moved = np.where(free[:, None], towards @ vertices, vertices)
        vertices = _kept_convex(vertices, moved, mesh.quads)
    return replace(mesh, vertices=vertices)


def _means(quads: Ints, count: int) -> csr_array:
    """(count, count): what takes points to the means of their neighbours; of a vertex without any, to 0."""
    ends, _ = edges_of(quads)
    rows, columns = np.concatenate([ends, ends[:, ::-1]]).T
    valence = np.bincount(rows, minlength=count)
    return coo_array((1.0 / valence[rows], (rows, columns)), shape=(count, count)).tocsr()


def _kept_convex(before: Floats, after: Floats, quads: Ints) -> Floats:
    """The vertices moved, but for those whose moves bend an element."""
    vertices = after.copy()
    while (bent := convex_quality(vertices, quads) <= 0.0).any():
        held = np.unique(quads[bent])
        vertices[held] = before[held]
    return vertices
