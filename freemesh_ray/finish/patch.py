"""A patch: the elements around the vertices near a seed, and a copy of them in which vertices are moved on trial.

Only the vertices up to RINGS edges from the seed move, so the rim of the patch stays as it is. Changes of connectivity
are made in the mesh itself; positions in it change only when what came out is kept.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from envs.kernels.jit import inlined, inner
from envs.mdp.size_field import SizeField
from envs.quality import eta_or_bent
from envs.types import Floats, Ints
from freemesh_ray.finish.halfedges import NONE, QUADS, VERTICES, Halfedges, after, around, before, origin
from freemesh_ray.finish.optimiser import Descent, cost_of, descend, descent

RINGS = 3
#: Vertices that may move, and elements, at most; further ones belong to the rim, or outside.
INNER, ELEMENTS = 96, 256
#: Vertices and elements that one sequence of changes may add, at most.
ADDED = 8
#: Rounds that take the moving vertices to the middle of the elements around them, and how far beyond that of their
#: neighbours, away from the opposite corners.
ROUNDS, SPREAD = 2, 0.2

# Entries of Patch.counts.
_STAMP, _INNER, _ELEMENTS, _FREE, _VERTICES, _QUADS, _COPY = range(7)


class Patch(NamedTuple):
    """Working memory.

    Attributes:
        inner: (INNER + ADDED,) int64, vertices that may move.
        elements: (ELEMENTS + ADDED,) int64, the elements around them.
        vertex_stamp, quad_stamp: (V,), (M,) int64, equal to the stamp of this patch where they belong to it.
        local: (V,) int64, where in ``vertices`` a vertex is.
        local_stamp: (V,) int64, equal to the stamp of the copy where ``local`` is valid.
        vertices: (4 (ELEMENTS + ADDED),) int64, the vertices of the copy, those first that may move.
        xy: as many, 2, float64, where they are on trial.
        quads: (ELEMENTS + ADDED, 4) int64, the elements of the copy, as indices into ``vertices``.
        total: (as many, 3) float64, working memory.
        descent: working memory.
        counts: (7,) int64: stamp; inner vertices, elements; of the copy moving vertices, vertices, elements; its stamp.
    """

    inner: Ints
    elements: Ints
    vertex_stamp: Ints
    quad_stamp: Ints
    local: Ints
    local_stamp: Ints
    vertices: Ints
    xy: Floats
    quads: Ints
    total: Floats
    descent: Descent
    counts: Ints


@inlined
def is_inner(patch: Patch, vertex: int) -> bool:
    """Whether all elements around a vertex belong to the patch."""
    return patch.vertex_stamp[vertex] == patch.counts[_STAMP]


@inlined
def inside(patch: Patch, quad: int) -> bool:
    """Whether an element belongs to the patch."""
    return patch.quad_stamp[quad] == patch.counts[_STAMP]


@inlined
def take_in(patch: Patch, vertex: int, quad: int) -> None:
    """Let a new vertex and a new element belong to the patch, too."""
    patch.vertex_stamp[vertex] = patch.quad_stamp[quad] = patch.counts[_STAMP]


@inner
def surround(mesh: Halfedges, patch: Patch, seed: int) -> None:
    """Gather the patch around a vertex."""
    patch.counts[_STAMP] += 1
    stamp = patch.counts[_STAMP]
    inner, elements, begin, room = 0, 0, 0, ELEMENTS
    if mesh.degree[seed] <= room:
        patch.inner[0], patch.vertex_stamp[seed] = seed, stamp
        inner, room = 1, room - mesh.degree[seed]
    for ring in range(RINGS + 1):
        end = inner
        for i in range(begin, end):
            v = patch.inner[i]
            spoke = mesh.out[v]
            for _ in range(mesh.degree[v]):
                quad = spoke >> 2
                if patch.quad_stamp[quad] != stamp:
                    patch.quad_stamp[quad], patch.elements[elements] = stamp, quad
                    elements += 1
                for w in (origin(mesh, after(spoke)), origin(mesh, before(spoke))):
                    fits = inner < INNER and mesh.degree[w] <= room
                    if ring < RINGS and fits and patch.vertex_stamp[w] != stamp:
                        patch.vertex_stamp[w], patch.inner[inner] = stamp, w
                        inner, room = inner + 1, room - mesh.degree[w]
                spoke = around(mesh, spoke)
        begin = end
    patch.counts[_INNER], patch.counts[_ELEMENTS] = inner, elements


@inlined
def newest(patch: Patch, notes: Ints) -> int:
    """The largest note on an element of the patch; (M,) int64, at least 0."""
    largest = 0
    for i in range(patch.counts[_ELEMENTS]):
        largest = max(largest, notes[patch.elements[i]])
    return largest


@inlined
def note(patch: Patch, notes: Ints, value: int) -> None:
    """Note something on all elements that the patch was gathered with."""
    for i in range(patch.counts[_ELEMENTS]):
        notes[patch.elements[i]] = value


@inlined
def _enter(mesh: Halfedges, patch: Patch, vertex: int, at: int) -> int:
    """Copy a vertex; how many there are."""
    patch.local[vertex], patch.local_stamp[vertex] = at, patch.counts[_COPY]
    patch.vertices[at], patch.xy[at, 0], patch.xy[at, 1] = vertex, mesh.xy[vertex, 0], mesh.xy[vertex, 1]
    return at + 1


@inner
def copy(mesh: Halfedges, patch: Patch, vertices_before: int, quads_before: int) -> None:
    """Copy what the patch has become; new vertices and elements are those from the given numbers on."""
    patch.counts[_COPY] += 1
    n = m = 0
    for i in range(patch.counts[_INNER]):
        v = patch.inner[i]
        if not mesh.fixed[v] and mesh.degree[v] > 0:
            n = _enter(mesh, patch, v, n)
    for v in range(vertices_before, mesh.counts[VERTICES]):
        if mesh.degree[v] > 0:
            n = _enter(mesh, patch, v, n)
    patch.counts[_FREE] = n
    old = patch.counts[_ELEMENTS]
    for i in range(old + mesh.counts[QUADS] - quads_before):
        quad = patch.elements[i] if i < old else quads_before + i - old
        if mesh.quads[quad, 0] == NONE:
            continue
        for corner in range(4):
            v = mesh.quads[quad, corner]
            if patch.local_stamp[v] != patch.counts[_COPY]:
                n = _enter(mesh, patch, v, n)
            patch.quads[m, corner] = patch.local[v]
        m += 1
    patch.counts[_VERTICES], patch.counts[_QUADS] = n, m


@inner
def spread(patch: Patch) -> None:
    """Take the moving vertices of the copy to the middle of the elements around them."""
    xy, quads, total = patch.xy, patch.quads[: patch.counts[_QUADS]], patch.total[: patch.counts[_VERTICES]]
    free = patch.counts[_FREE]
    for _ in range(ROUNDS):
        total[:] = 0.0
        for q in range(len(quads)):
            for corner in range(4):
                v, ahead = quads[q, corner], quads[q, (corner + 1) & 3]
                far, behind = quads[q, (corner + 2) & 3], quads[q, (corner + 3) & 3]
                total[v, 0] += xy[ahead, 0] + xy[behind, 0] - SPREAD * xy[far, 0]
                total[v, 1] += xy[ahead, 1] + xy[behind, 1] - SPREAD * xy[far, 1]
                total[v, 2] += 2.0 - SPREAD
        for v in range(free):
            xy[v, 0], xy[v, 1] = total[v, 0] / total[v, 2], total[v, 1] / total[v, 2]


@inner
def price(patch: Patch) -> float:
    """The cost of the elements of the copy."""
    n, m = patch.counts[_VERTICES], patch.counts[_QUADS]
    return cost_of(patch.xy[:n], patch.quads[:m], patch.descent)


@inner
def settle(patch: Patch, steps: int, least_fall: float) -> float:
    """Move the vertices of the copy to where they are best; the cost of its elements."""
    n, m = patch.counts[_VERTICES], patch.counts[_QUADS]
    return descend(patch.xy[:n], patch.quads[:m], patch.counts[_FREE], False, steps, least_fall, patch.descent)


@inlined
def size(patch: Patch) -> int:
    """How many elements the copy has."""
    return patch.counts[_QUADS]


@inlined
def rate(patch: Patch) -> float:
    """The least eta of the elements of the copy; -1 when one is not strictly convex."""
    least = 1.0
    for i in range(patch.counts[_QUADS]):
        a, b, c, d = patch.quads[i, 0], patch.quads[i, 1], patch.quads[i, 2], patch.quads[i, 3]
        xy = patch.xy
        eta = eta_or_bent(xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1], xy[d, 0], xy[d, 1])
        least = min(least, eta)
    return least


@inner
def write_back(mesh: Halfedges, patch: Patch) -> None:
    """Give the vertices of the mesh the positions of the copy."""
    for i in range(patch.counts[_FREE]):
        v = patch.vertices[i]
        mesh.xy[v, 0], mesh.xy[v, 1] = patch.xy[i, 0], patch.xy[i, 1]


def patch_of(mesh: Halfedges, wanted: SizeField) -> Patch:
    """Room for any patch of this mesh, for which such sizes are wanted."""
    n, m = len(mesh.xy), len(mesh.quads)
    most = 4 * (ELEMENTS + ADDED)
    return Patch(
        inner=np.zeros(INNER + ADDED, dtype=np.int64),
        elements=np.zeros(ELEMENTS + ADDED, dtype=np.int64),
        vertex_stamp=np.zeros(n, dtype=np.int64),
        quad_stamp=np.zeros(m, dtype=np.int64),
        local=np.zeros(n, dtype=np.int64),
        local_stamp=np.zeros(n, dtype=np.int64),
        vertices=np.zeros(most, dtype=np.int64),
        xy=np.zeros((most, 2)),
        quads=np.zeros((ELEMENTS + ADDED, 4), dtype=np.int64),
        total=np.zeros((most, 3)),
        descent=descent(most, wanted),
        counts=np.zeros(7, dtype=np.int64),
    )
