"""Valid meshes that need a finish: grids of unit cells, shaken, with irregular vertices put in by random changes."""

from __future__ import annotations

import numpy as np

from envs.mesh import Mesh, edges_of
from envs.types import Floats, Ints
from freemesh_ray.finish.changes import COLLAPSE, SPLIT, SWAP, collapse_cost, make, split_cost, swap_cost
from freemesh_ray.finish.halfedges import LOGGED, NONE, QUADS, VERTICES, Halfedges, build, commit, compact, undo
from freemesh_ray.finish.optimiser import NO_SIZES
from freemesh_ray.finish.patch import Patch, copy, patch_of, rate, settle, spread, surround, write_back

#: Cells of a plain square, a ring, an L, two cells that touch in a corner with a bridge around, and a single cell.
SHAPES = {
    "square": np.ones((7, 7), dtype=bool),
    "ring": np.pad(np.zeros((3, 3), dtype=bool), 3, constant_values=True),
    "L": np.array([[r < 4 or c < 4 for c in range(8)] for r in range(8)]),
    "pinch": np.array([[1, 1, 1, 1], [1, 1, 1, 1], [1, 1, 0, 1], [1, 1, 1, 0], [1, 1, 1, 1]], dtype=bool),
    "strip": np.ones((1, 6), dtype=bool),
    "cell": np.ones((1, 1), dtype=bool),
}


def mesh_of(name: str, vertices: Floats, quads: Ints) -> Mesh:
    """A mesh whose boundary vertices come first and in which all edges used once are given segments."""
    edges, counts = edges_of(quads)
    rim = np.unique(edges[counts == 1])
    order = np.concatenate([rim, np.setdiff1d(np.arange(len(vertices)), rim)])
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    once = {tuple(edge) for edge in edges[counts == 1].tolist()}
    ahead = np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2)
    segments = np.array([edge for edge in ahead.tolist() if tuple(sorted(edge)) in once])
    return Mesh(name, vertices[order], place[quads], place[segments], True)


def grid(shape: str, seed: int = 0, shake: float = 0.2) -> Mesh:
    """The cells of a shape, interior vertices moved by up to ``shake`` of a side (< 0.25)."""
    cells = SHAPES[shape]
    rows, columns = cells.shape
    number = np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1)
    corners = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1)
    used, quads = np.unique(corners[cells], return_inverse=True)
    plain = mesh_of(shape, np.stack([used % (columns + 1), used // (columns + 1)], axis=1) * 1.0, quads.reshape(-1, 4))
    noise = np.random.default_rng(seed).uniform(-shake, shake, plain.vertices.shape)
    noise[plain.on_boundary] = 0.0
    return Mesh(shape, plain.vertices + noise, plain.quads, plain.segments, True)


def fan(elements: int) -> Mesh:
    """One interior vertex with so many elements around it."""
    turn = np.pi * np.arange(2 * elements) / elements
    radius = np.where(np.arange(2 * elements) % 2 == 0, 1.0, 1.3)
    rim = radius[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    i = 2 * np.arange(elements)
    quads = np.stack([np.full(elements, 2 * elements), i, i + 1, (i + 2) % (2 * elements)], axis=1)
    return mesh_of(f"fan {elements}", np.concatenate([rim, np.zeros((1, 2))]), quads)


def halfedges(mesh: Mesh) -> Halfedges:
    """The half-edges of a mesh, its boundary fixed."""
    return build(mesh.vertices, mesh.quads, mesh.on_boundary, mesh.on_boundary)


def change(work: Halfedges, patch: Patch, rng: np.random.Generator) -> bool:
    """Make one random possible change near a random vertex; whether one was found."""
    for _ in range(50):
        surround(work, patch, int(rng.integers(work.counts[VERTICES])))
        h = int(rng.integers(4 * work.counts[QUADS]))
        kind, argument = int(rng.integers(3)), int(rng.integers(2))
        if work.quads[h >> 2, 0] == NONE:
            continue
        if kind == SWAP:
            possible = swap_cost(work, patch, h, argument, np.inf) < np.inf
        elif kind == COLLAPSE:
            possible = collapse_cost(work, patch, h, np.inf) < np.inf
        else:
            degree = work.degree[work.quads[h >> 2, h & 3]]
            argument = int(rng.integers(2, max(3, min(8, degree - 1))))
            possible = degree - argument >= 2 and split_cost(work, patch, h, argument, np.inf) < np.inf
        if possible:
            assert kind in (SWAP, COLLAPSE, SPLIT)
            make(work, patch, kind, h, argument, np.zeros(8, dtype=np.int64), 0)
            return True
    return False


def rough(shape: str, seed: int, changes: int = 12) -> Mesh:
    """A shaken grid in which random changes were made wherever all elements stayed convex."""
    return roughened(grid(shape, seed), seed, changes)


def roughened(mesh: Mesh, seed: int, changes: int = 12) -> Mesh:
    """A mesh, its boundary's vertices first, in which random changes were made wherever all elements stayed convex."""
    work, rng = halfedges(mesh), np.random.default_rng(seed)
    patch = patch_of(work, NO_SIZES)
    for _ in range(changes):
        commit(work)
        before = int(work.counts[VERTICES]), int(work.counts[QUADS])
        if change(work, patch, rng):
            copy(work, patch, *before)
            spread(patch)
            settle(patch, 3, 0.0)
            if rate(patch) > 0.05:
                write_back(work, patch)
            else:
                undo(work, 0)
        assert work.counts[LOGGED] < len(work.log)
    vertices, quads = compact(work, int(mesh.segments.max()) + 1)
    return Mesh(mesh.name, vertices, quads, mesh.segments, True)
