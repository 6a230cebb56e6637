"""Metrics of mixed meshes: those of all-quad meshes where there are no triangles, and cases known by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.mesh import Mesh
from freemesh_ray.compare.element_metrics import by_element, figures, irregular, irregular_authors, taper_by_triangles
from freemesh_ray.compare.mixed_mesh import assembled, of_mesh
from freemesh_ray.metrics import measure


def grid(columns: int, rows: int, seed: int, shake: float = 0.2) -> Mesh:
    """Unit squares, every vertex moved at random by up to ``shake``."""
    x, y = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0))
    vertices = np.column_stack([x.ravel(), y.ravel()])
    vertices += np.random.default_rng(seed).uniform(-shake, shake, vertices.shape)
    i = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    quads = np.column_stack([i, i + 1, i + columns + 2, i + columns + 1])
    edges, counts = Mesh("", vertices, quads, np.empty((0, 2), np.int64), False).edges
    return Mesh("grid", vertices, quads, edges[counts == 1], True)


@given(st.integers(1, 6), st.integers(1, 6), st.integers(0, 1000))
def test_without_triangles_they_are_the_metrics_of_quad_meshes(columns: int, rows: int, seed: int) -> None:
    mesh = grid(columns, rows, seed)
    found, expected = figures(of_mesh(mesh, "x", 0.25)), measure(mesh)
    for key in expected:
        if key != "elements":
            assert found[key] == pytest.approx(expected[key], abs=1e-12), key
    assert found["quads"] == columns * rows
    assert found["non_convex"] == 0
    assert found["elements_per_second"] == pytest.approx(4 * columns * rows)
    assert all(values.shape == (columns * rows,) for values in by_element(of_mesh(mesh, "x", 0.25)).values())


@given(st.integers(0, 1000), st.floats(0, 2 * np.pi), st.floats(0.1, 10))
def test_the_papers_taper_does_not_see_motion_scale_or_first_corner(seed: int, turn: float, scale: float) -> None:
    mesh = grid(3, 3, seed)
    corners = mesh.vertices[mesh.quads]
    c, s = np.cos(turn), np.sin(turn)
    moved = np.roll(scale * corners @ np.array([[c, s], [-s, c]]) + [3.0, 4.0], seed % 4, axis=1)
    np.testing.assert_allclose(taper_by_triangles(moved), taper_by_triangles(corners), atol=1e-9)
    assert (taper_by_triangles(corners) >= 0).all()
    assert (taper_by_triangles(corners) <= 1).all()


def test_the_papers_taper_by_hand() -> None:
    parallelogram = [[0, 0], [2, 0], [3, 1], [1, 1]]
    trapezium = [[0, 0], [4, 0], [3, 1], [1, 1]]  # a diagonal cuts off 2 of 3 and leaves 1
    np.testing.assert_allclose(taper_by_triangles(np.array([parallelogram, trapezium], dtype=float)), [0.0, 0.5])


def test_triangles_count_for_vertices_alone() -> None:
    angles = np.pi * np.arange(8) / 4
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    vertices = np.vstack([ring, [0.0, 0.0]])
    mesh = assembled("x", vertices, [[8, 0, 1, 2], [8, 2, 3, 4], [8, 4, 5, 6]], [[8, 6, 7], [8, 7, 0]], 1.0)
    assert irregular(mesh).tolist() == [8]  # five edges meet in the middle
    assert irregular_authors(mesh).tolist() == [8]
    found = figures(mesh)
    assert (found["quads"], found["triangles"], found["elements_per_second"]) == (3, 2, 5)
    all_quads = assembled("x", vertices, [[8, 0, 1, 2], [8, 2, 3, 4], [8, 4, 5, 6], [8, 6, 7, 0]], [], 1.0)
    assert found["eta"] == pytest.approx(figures(all_quads)["eta"])


def test_a_bent_element_is_counted() -> None:
    mesh = assembled("x", [[0, 0], [2, 0], [0.5, 0.5], [0, 2], [3, 3]], [[0, 1, 2, 3], [1, 4, 3, 2]], [], 1.0)
    assert figures(mesh)["non_convex"] == 1


def test_triangles_only_have_no_element_figures() -> None:
    found = figures(assembled("x", [[0, 0], [1, 0], [0, 1]], [], [[0, 1, 2]], 1.0))
    assert np.isnan(found["eta"])
    assert np.isnan(found["taper"])
    assert found["triangles"] == 1
