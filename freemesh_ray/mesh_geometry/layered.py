"""Boundary layers and the mesh of what they leave, as one."""

from __future__ import annotations

import numpy as np

from envs.errors import UserError
from envs.mesh import Mesh
from envs.polygons.boundary_layers import Layers
from envs.polygons.rings import place


def with_layers(layers: Layers, inside: Mesh) -> Mesh:
    """One mesh: the layers' vertices, then those that the mesh inside has beyond its boundary; quads likewise.

    Args:
        layers: of a domain.
        inside: the mesh of the domain inside of their rings; its boundary vertices are theirs, number for number.

    Returns:
        A mesh without names, its segments those of the layers: the whole boundary.

    Raises:
        UserError: a boundary vertex that the layers do not have.
    """
    known = {(x, y): i for i, (x, y) in enumerate(layers.vertices.tolist())}
    on_boundary = inside.on_boundary
    number = np.full(len(inside.vertices), -1)
    for i in np.flatnonzero(on_boundary).tolist():
        x, y = inside.vertices[i].tolist()
        if (x, y) not in known:
            raise UserError(
                f"{inside.name}: {place(inside.vertices[i])} is on no boundary layer; mesh the layers' rings"
            )
        number[i] = known[x, y]
    number[~on_boundary] = len(layers.vertices) + np.arange(int((~on_boundary).sum()))
    return Mesh(
        inside.name,
        np.concatenate([layers.vertices, inside.vertices[~on_boundary]]),
        np.concatenate([layers.quads, number[inside.quads]]),
        layers.segments,
        inside.complete,
    )
