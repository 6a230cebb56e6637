"""Boundary layers and the mesher's mesh of what they leave, as one mesh."""

from __future__ import annotations

import numpy as np
import pytest

from envs.errors import UserError
from envs.polygons.boundary_layers import Layers, boundary_layers
from envs.polygons.layer_loops import Rows
from envs.polygons.validation import from_rings
from envs.types import Floats
from freemesh_ray.mesh_geometry.layered import with_layers
from freemesh_ray.mesher.polygon_to_mesh import Mesh


def meshed(rings: list[Floats], carries: list[np.ndarray], rows: Rows) -> tuple[Layers, Mesh]:
    layers = boundary_layers(rings, carries, rows, "part")
    outer, *holes = (layers.vertices[ring] for ring in layers.rings)
    return layers, Mesh.from_domain(from_rings(outer, holes, "part"), effort="quick")


def test_rows_and_the_mesh_inside_are_one_conforming_mesh() -> None:
    x = np.linspace(0.0, 4.0, 17)
    ring = np.concatenate([
        np.stack([x, 0 * x], axis=1)[:-1], [[4, 0], [4, 0.5], [4, 1], [4, 1.5]],
        np.stack([x, 0 * x + 2], axis=1)[:0:-1], [[0, 2], [0, 1.5], [0, 1], [0, 0.5]],
    ])  # fmt: skip
    turn = 2.0 * np.pi * np.arange(16) / 16
    hole = np.array([2.0, 1.0]) + 0.4 * np.stack([np.cos(turn), -np.sin(turn)], axis=1)
    floor = ring[:, 1] + np.roll(ring, -1, axis=0)[:, 1] == 0.0
    layers, inside = meshed([ring, hole], [floor, np.ones(16, dtype=bool)], Rows(4, 0.02, 1.3))
    mesh = with_layers(layers, inside)
    area = 8.0 - 0.5 * 16 * 0.4**2 * np.sin(2 * np.pi / 16)
    assert mesh.defects(area) == []
    assert len(mesh.quads) == len(layers.quads) + len(inside.quads)
    np.testing.assert_array_equal(mesh.vertices[: len(layers.vertices)], layers.vertices)
    np.testing.assert_array_equal(mesh.quads[: len(layers.quads)], layers.quads)
    with pytest.raises(UserError, match=r"^part: \(.*\) is on no boundary layer"):
        with_layers(boundary_layers([ring, hole], [floor, np.ones(16, dtype=bool)], Rows(4, 0.03, 1.3), "p"), inside)
