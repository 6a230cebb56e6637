"""Quadrilateral meshes for tests: grids, bent and with holes, and names on their parts."""

from __future__ import annotations

import numpy as np

from envs.mesh import Groups, Mesh, edges_of
from envs.types import Floats, Ints
from freemesh_ray.mesh_geometry.index import boundary_of


def grid(columns: int, rows: int, low: tuple[float, float] = (0, 0), high: tuple[float, float] = (1, 1)) -> Mesh:
    """A rectangle in equal elements."""
    x, y = np.meshgrid(np.linspace(low[0], high[0], columns + 1), np.linspace(low[1], high[1], rows + 1), indexing="ij")
    number = np.arange(x.size).reshape(x.shape)
    corners = (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    return whole(np.stack([x.ravel(), y.ravel()], axis=1), np.stack([c.ravel() for c in corners], axis=1))


def whole(vertices: Floats, quads: Ints, groups: Groups | None = None) -> Mesh:
    """A complete mesh of these elements."""
    bare = Mesh("grid", vertices, quads, np.zeros((0, 2), dtype=np.int64), True)
    return Mesh("grid", vertices, quads, boundary_of(bare), True, groups=groups or Groups())


def random_mesh(seed: int) -> Mesh:
    """A bent grid some of whose elements are taken out, with names on some of its parts."""
    rng = np.random.default_rng(seed)
    even = grid(int(rng.integers(1, 7)), int(rng.integers(1, 7)))
    steps = 1.0 / np.sqrt(len(even.vertices))
    bent = even.vertices + rng.uniform(-0.2, 0.2, even.vertices.shape) * np.minimum(steps, 1 / 7)
    kept = rng.random(len(even.quads)) < rng.choice([0.7, 1.0])
    kept[rng.integers(len(kept))] = True
    used, quads = np.unique(even.quads[kept], return_inverse=True)
    mesh = whole(bent[used] * rng.uniform(0.1, 10.0, 2), quads.reshape(-1, 4))
    return whole(mesh.vertices, mesh.quads, random_groups(mesh, rng))


def random_groups(mesh: Mesh, rng: np.random.Generator) -> Groups:
    """Names on most sides, some edges inside, most elements and two points."""
    edges, counts = edges_of(mesh.quads)
    inner = edges[counts == 2]
    side, line = rng.integers(0, 4, len(mesh.segments)), rng.integers(0, 3, len(inner))
    region = rng.integers(0, 3, len(mesh.quads))
    first, second = rng.permutation(len(mesh.vertices))[:2].tolist()
    return Groups(
        {name: mesh.segments[side == i] for i, name in enumerate(["wall", "Top", "sides"]) if (side == i).any()},
        {"interface": inner[line == 0]} if (line == 0).any() else {},
        {name: np.flatnonzero(region == i) for i, name in enumerate(["steel", "copper"]) if (region == i).any()},
        {"gauge": first, "load": second},
    )
