"""The bound of the Jacobian determinant against its values on a fine grid."""

from __future__ import annotations

import numpy as np
import pytest
from curved_meshes import jacobians
from hypothesis import given, settings
from hypothesis import strategies as st

from freemesh_ray.mesh_geometry import lagrange
from freemesh_ray.mesh_geometry.high_order import HighOrder
from freemesh_ray.mesh_geometry.jacobian import least_jacobian


def element(order: int, nodes: np.ndarray) -> HighOrder:
    return HighOrder(order, nodes, np.arange(len(nodes))[None], lagrange.equal(order))


def square(order: int) -> np.ndarray:
    x = lagrange.equal(order)
    return np.stack([np.tile(x, order + 1), np.repeat(x, order + 1)], axis=1)


def sampled(mesh: HighOrder) -> float:
    """The least determinant on a fine grid over the mean."""
    points, weights = lagrange.gauss(mesh.order + 1)
    mean = float((jacobians(mesh, points)[2] @ np.outer(weights, weights).ravel())[0])
    return float(jacobians(mesh, np.linspace(0.0, 1.0, 61))[2].min()) / abs(mean)


@settings(max_examples=60)
@given(st.integers(2, 4), st.integers(0, 10**6), st.floats(0.0, 0.4))
def test_the_sign_is_the_one_that_a_fine_grid_shows(order: int, seed: int, size: float) -> None:
    nodes = square(order)
    nodes = nodes + np.random.default_rng(seed).uniform(-size, size, nodes.shape) / order
    mesh = element(order, nodes)
    bound, seen = float(least_jacobian(mesh.nodes, mesh.elements, mesh.stations)[0]), sampled(mesh)
    assert bound <= seen + 1e-9
    if seen < 0.0:
        assert bound < 0.0
    elif seen > 0.02:  # less may be negative between the grid's points
        assert bound > 0.0


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_a_parallelogram_has_one(order: int) -> None:
    nodes = square(order) @ np.array([[2.0, 0.3], [0.5, 1.0]]) + 7.0
    mesh = element(order, nodes)
    assert least_jacobian(mesh.nodes, mesh.elements, mesh.stations)[0] == pytest.approx(1.0, rel=1e-9)


def test_what_gauss_points_and_corners_do_not_see_is_found() -> None:
    rows = [[-0.07, -0.18, 0.48, 0.17, 1.11, -0.06], [-0.22, 0.74, 0.71, 0.61, 1.17, 0.61], [0.05, 1.03, 0.42, 0.79]]
    mesh = element(2, np.array([*rows[0], *rows[1], *rows[2], 0.92, 1.13]).reshape(-1, 2))
    points = np.concatenate([lagrange.gauss(3)[0], [0.0, 1.0]])
    assert jacobians(mesh, points)[2].min() > 0.0
    assert sampled(mesh) < 0.0
    assert least_jacobian(mesh.nodes, mesh.elements, mesh.stations)[0] < 0.0


def test_no_elements_have_no_bounds() -> None:
    assert least_jacobian(np.empty((0, 2)), np.empty((0, 9), dtype=np.int64), lagrange.equal(2)).shape == (0,)
