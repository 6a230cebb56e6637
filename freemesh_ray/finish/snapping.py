"""Vertices go to places that a node is to sit on: the nearest one to each, everything around making way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from envs.mesh import Mesh
from envs.types import Floats, Ints

#: Vertices near a place that may go there.
NEAREST = 16


def renumbered(mesh: Mesh, held: Ints, places: Floats, kept: int) -> Mesh | None:
    """The mesh with the numbers of vertices changed, so that those nearest to places have the places' numbers.

    Args:
        mesh: its first ``kept`` vertices are all there; those in ``held`` may be no element's any more.
        held: (h,) int64, numbers below ``kept``, none on the boundary.
        places: (h, 2) float64.
        kept: how many vertices there are at least, in the elements or not.

    Returns:
        The mesh, its vertices where they were; None when two places have no vertices of their own nearby.
    """
    from scipy.spatial import cKDTree  # a quarter of a second that meshes without places need not wait

    n = len(mesh.vertices)
    free = np.zeros(n, dtype=np.bool_)
    free[mesh.quads.ravel()] = True
    free[mesh.segments.ravel()] = False
    inside = np.flatnonzero(free)
    if len(inside) < len(held):
        return None
    most = min(NEAREST, len(inside))
    distance, near = cKDTree(mesh.vertices[inside]).query(places, k=np.arange(1, most + 1))
    chosen: dict[int, int] = {}
    for at in np.argsort(distance, axis=None, kind="stable").tolist():
        which, vertex = at // most, int(inside[near.ravel()[at]])
        if which not in chosen and vertex not in chosen.values():
            chosen[which] = vertex
    if len(chosen) < len(held):
        return None
    vertices = [chosen[i] for i in range(len(held))]
    number = np.arange(n)
    displaced = [v for v in held.tolist() if v not in vertices]
    freed = [v for v in vertices if v not in held.tolist()]
    number[vertices] = held
    number[displaced] = freed
    moved = np.empty_like(mesh.vertices)
    moved[number] = mesh.vertices
    quads = number[mesh.quads]
    alive = np.zeros(n, dtype=np.bool_)
    alive[quads.ravel()] = True
    alive[:kept] = True
    return replace(mesh, vertices=moved[alive], quads=(np.cumsum(alive) - 1)[quads])
