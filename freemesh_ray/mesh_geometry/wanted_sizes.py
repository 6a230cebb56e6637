"""How far a mesh has the edge lengths that are wanted: h, of any place, by a function.

Edges are measured against h in their middle, elements against h in their centroid. Elements are those of both kinds.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from envs.mesh import sides
from envs.types import Floats, Ints
from freemesh_ray.mesh_geometry.protocol import PlaneMesh

#: From places (k, 2) to the edge length wanted at each, (k,), above 0.
Sizes = Callable[[Floats], Floats]

#: An element has the size wanted when its mean edge is within this share of h.
NEAR = 0.25


def longest_edge(mesh: PlaneMesh, sizes: Sizes) -> float:
    """The largest edge / h; 1 where every edge is as wanted."""
    ends = mesh.vertices[mesh.edges[0]]
    return float((np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / sizes(ends.mean(axis=1))).max())


def elements_over_wanted(mesh: PlaneMesh, sizes: Sizes) -> float:
    """Elements over the squares of h that the meshed area holds, the integral of 1 / h^2; 1 is as wanted."""
    centres, areas, _ = _elements(mesh)
    return float(len(areas) / (areas / sizes(centres) ** 2).sum())


def sized_share(mesh: PlaneMesh, sizes: Sizes, near: float = NEAR) -> float:
    """The share of the elements whose mean edge is within ``near`` of h, in [0, 1]."""
    centres, _, edges = _elements(mesh)
    return float((np.abs(edges / sizes(centres) - 1.0) <= near).mean())


def neighbour_ratio(mesh: PlaneMesh, percentile: float = 99.0) -> float:
    """A percentile of the larger over the smaller mean edge of two elements that share an edge; 1 or more.

    1 where no two elements do.
    """
    _, _, edges = _elements(mesh)
    walked = [np.sort(sides(block).reshape(-1, 2), axis=1) for block in (mesh.quads, mesh.triangles)]
    owner = np.concatenate([
        np.repeat(np.arange(len(mesh.quads)), 4), len(mesh.quads) + np.repeat(np.arange(len(mesh.triangles)), 3)
    ])  # fmt: skip
    _, which = np.unique(np.concatenate(walked), axis=0, return_inverse=True)
    order = np.argsort(which.ravel(), kind="stable")
    ordered = which.ravel()[order]
    shared = np.flatnonzero(ordered[1:] == ordered[:-1])
    pairs = edges[owner[order][np.stack([shared, shared + 1], axis=1)]]
    return float(np.percentile(pairs.max(axis=1) / pairs.min(axis=1), percentile)) if len(pairs) else 1.0


def _elements(mesh: PlaneMesh) -> tuple[Floats, Floats, Floats]:
    """Centroids (m, 2), areas (m,) and mean edges (m,) of all elements, quadrilaterals first."""
    parts = [_block(mesh.vertices, block) for block in (mesh.quads, mesh.triangles)]
    centres, areas, edges = (np.concatenate(each) for each in zip(*parts, strict=True))
    return centres, areas, edges


def _block(vertices: Floats, elements: Ints) -> tuple[Floats, Floats, Floats]:
    corners = vertices[elements]
    middle = corners.mean(axis=1)
    off = corners - middle[:, None]
    ahead = np.roll(off, -1, axis=1)
    cut = 0.5 * (off[..., 0] * ahead[..., 1] - ahead[..., 0] * off[..., 1])
    areas = cut.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        shift = (cut[..., None] * (off + ahead)).sum(axis=1) / (3.0 * areas[:, None])
    centres = middle + np.where(np.isfinite(shift), shift, 0.0)
    return centres, np.abs(areas), np.linalg.norm(ahead - off, axis=-1).mean(axis=1)
