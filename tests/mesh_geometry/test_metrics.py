"""Metrics: Verdict as the oracle, invariances, and meshes whose numbers are known by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.mesh import Mesh
from envs.quality import element_quality
from freemesh_ray.compare.mixed_mesh import assembled, of_mesh
from freemesh_ray.mesh_geometry.metrics import (
    angles_within,
    by_element,
    inner_angles,
    irregular,
    irregular_authors,
    measure,
    scaled_jacobian,
    stretch,
    taper,
    taper_by_triangles,
)


def grid(columns: int, rows: int, corner: float = 0.0) -> Mesh:
    """Unit squares; ``corner`` moves every vertex at random by up to that much."""
    x, y = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0))
    vertices = np.column_stack([x.ravel(), y.ravel()])
    vertices += np.random.default_rng(1).uniform(-corner, corner, vertices.shape)
    i = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    quads = np.column_stack([i, i + 1, i + columns + 2, i + columns + 1])
    edges, counts = Mesh("", vertices, quads, np.empty((0, 2), np.int64), False).edges
    return Mesh("grid", vertices, quads, edges[counts == 1], True)


def star(n: int) -> Mesh:
    """``n`` elements around one vertex, the valence of which is ``n``."""
    angles = np.pi * np.arange(2 * n) / n
    ring = np.column_stack([np.cos(angles), np.sin(angles)]) * np.where(np.arange(2 * n) % 2, 1.5, 1.0)[:, None]
    k = 2 * np.arange(n)
    quads = np.column_stack([np.full(n, 2 * n), k, k + 1, (k + 2) % (2 * n)])
    segments = np.column_stack([np.arange(2 * n), (np.arange(2 * n) + 1) % (2 * n)])
    return Mesh("star", np.vstack([ring, [0.0, 0.0]]), quads, segments, True)


def convex_quads(count: int, seed: int) -> np.ndarray:
    """(count, 4, 2) random convex counter-clockwise quadrilaterals of many shapes and sizes."""
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, (4 * count, 4)), axis=1)
    points = np.stack([np.cos(angles), np.sin(angles) * rng.uniform(0.2, 1, (4 * count, 1))], axis=-1)
    points = points + rng.normal(0, 0.1, points.shape)
    ahead, behind = np.roll(points, -1, 1) - points, np.roll(points, 1, 1) - points
    convex = (ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0] > 1e-4).all(axis=1)
    chosen = points[convex][:count]
    return chosen * 10 ** rng.uniform(-2, 2, (len(chosen), 1, 1)) + rng.normal(0, 5, (len(chosen), 1, 2))


def verdict(corners: np.ndarray, name: str) -> np.ndarray:
    """VTK's value of a metric of every quadrilateral."""
    vtk = pytest.importorskip("vtk")
    from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

    flat = np.column_stack([corners.reshape(-1, 2), np.zeros(4 * len(corners))])
    points = vtk.vtkPoints()
    points.SetData(numpy_to_vtk(flat, deep=True))
    cells = vtk.vtkCellArray()
    for i in range(len(corners)):
        cells.InsertNextCell(4, range(4 * i, 4 * i + 4))
    data = vtk.vtkPolyData()
    data.SetPoints(points)
    data.SetPolys(cells)
    quality = vtk.vtkMeshQuality()
    quality.SetInputData(data)
    getattr(quality, f"SetQuadQualityMeasureTo{name}")()
    quality.Update()
    return vtk_to_numpy(quality.GetOutput().GetCellData().GetArray("Quality"))


@pytest.mark.parametrize(
    ("ours", "name"),
    [
        (scaled_jacobian, "ScaledJacobian"),
        (stretch, "Stretch"),
        (taper, "Taper"),
        (lambda corners: inner_angles(corners).min(axis=1), "MinAngle"),
        (lambda corners: inner_angles(corners).max(axis=1), "MaxAngle"),
    ],
)
def test_verdict_says_the_same(ours, name: str):
    corners = convex_quads(5000, seed=7)
    assert len(corners) > 2000
    np.testing.assert_allclose(
        ours(corners), verdict(corners, name), rtol=0, atol=1e-9 if "Angle" not in name else 1e-6
    )


@pytest.mark.parametrize("limits", [(45.0, 135.0), (60.0, 120.0), (80.0, 100.0)])
def test_verdict_says_the_same_of_the_share_of_good_angles(limits: tuple[float, float]):
    low, high = limits
    corners = convex_quads(3000, seed=9)
    squarer = corners + 3 * np.ptp(corners, axis=1, keepdims=True) * [[0, 0], [1, 0], [1, 1], [0, 1]]
    for block in (corners, squarer):
        good = (verdict(block, "MinAngle") >= low) & (verdict(block, "MaxAngle") <= high)
        quads = np.arange(4 * len(block)).reshape(-1, 4)
        assert angles_within(of_blocks(block, quads), low, high) == pytest.approx(good.mean(), abs=1e-12)
    assert 0 < good.mean() < 1


def of_blocks(corners: np.ndarray, quads: np.ndarray) -> Mesh:
    return Mesh("", corners.reshape(-1, 2), quads, np.empty((0, 2), np.int64), True)


def test_an_angle_on_a_limit_is_within_it():
    rhombus = np.array([[[0, 0], [2, 0], [2 + np.sqrt(2), np.sqrt(2)], [np.sqrt(2), np.sqrt(2)]]])  # 45 and 135 degrees
    mesh = of_blocks(rhombus, np.array([[0, 1, 2, 3]]))
    assert angles_within(mesh, 45.0, 135.0) == 1.0
    assert angles_within(mesh, 46.0, 135.0) == angles_within(mesh, 45.0, 134.0) == 0.0
    assert math.isnan(angles_within(of_blocks(rhombus, np.empty((0, 4), np.int64)), 45.0, 135.0))


def test_verdict_says_the_same_of_clockwise_quads():
    corners = convex_quads(500, seed=8)[:, ::-1]
    np.testing.assert_allclose(scaled_jacobian(corners), verdict(corners, "ScaledJacobian"), rtol=0, atol=1e-9)


@settings(max_examples=25, deadline=None)
@given(
    turn=st.floats(0, 2 * math.pi), scale=st.floats(1e-3, 1e3), shift=st.tuples(*[st.floats(-100, 100)] * 2),
    seed=st.integers(0, 1000),
)  # fmt: skip
def test_motion_scale_and_order_change_nothing(turn: float, scale: float, shift: tuple[float, float], seed: int):
    mesh = grid(5, 4, corner=0.2)
    rng = np.random.default_rng(seed)
    c, s = math.cos(turn), math.sin(turn)
    vertices = (mesh.vertices @ np.array([[c, s], [-s, c]]) + shift) * scale
    new = rng.permutation(len(vertices))
    moved = np.empty_like(vertices)
    moved[new] = vertices
    quads = np.array([np.roll(quad, rng.integers(4)) for quad in rng.permutation(new[mesh.quads])])
    other = Mesh("other", moved, quads, new[mesh.segments], True)
    assert measure(other) == pytest.approx(measure(mesh), rel=1e-9, abs=1e-9)


def test_squares_are_perfect():
    assert measure(grid(3, 2)) == pytest.approx({
        "elements": 6, "triangles": 0, "non_convex": 0, "singularity": 0, "singularity_least": 0,
        "singularity_authors": 0,
        "eta": 1, "eta_p5": 1, "eta_min": 1, "min_angle": 0,
        "max_angle": 0, "min_angle_authors": 0, "max_angle_authors": 0,
        "scaled_jacobian": 1, "stretch": 1, "taper": 0, "taper_paper": 0,
    })  # fmt: skip


def test_a_trapezium_by_hand():
    corners = np.array([[[0.0, 0.0], [4.0, 0.0], [3.0, 1.0], [1.0, 1.0]]])
    np.testing.assert_allclose(inner_angles(corners), [[45, 45, 135, 135]])
    np.testing.assert_allclose(scaled_jacobian(corners), math.sqrt(0.5))
    np.testing.assert_allclose(stretch(corners), math.sqrt(2) * math.sqrt(2) / math.sqrt(10))
    np.testing.assert_allclose(taper(corners), 2 / 2)  # X12 = (-2, 0), X1 = (6, 0), X2 = (0, 2)
    mesh = Mesh("trapezium", corners[0], np.array([[0, 1, 2, 3]]), np.array([[0, 1], [1, 2], [2, 3], [3, 0]]), True)
    found = measure(mesh)
    assert (found["min_angle"], found["max_angle"]) == pytest.approx((45, 45))
    assert (found["min_angle_authors"], found["max_angle_authors"]) == pytest.approx((45, 45))


def test_both_definitions_of_the_angles_differ_as_they_should():
    corners = np.array([[[0.0, 0.0], [1.0, 0.0], [2.0, 1.0], [0.0, 1.0]]])  # angles 90, 135, 45, 90
    mesh = Mesh("", corners[0], np.array([[0, 1, 2, 3]]), np.array([[0, 1], [1, 2], [2, 3], [3, 0]]), True)
    found = measure(mesh)
    assert (found["min_angle"], found["max_angle"]) == pytest.approx((45, 45))
    assert (found["min_angle_authors"], found["max_angle_authors"]) == pytest.approx((0, 45))


@pytest.mark.parametrize("n", [3, 4, 5, 6])
def test_irregular_vertices_of_a_star(n: int):
    mesh = star(n)
    assert mesh.defects() == []
    assert irregular(mesh).tolist() == ([] if n == 4 else [2 * n])
    assert irregular_authors(mesh).tolist() == ([] if n == 4 else [2 * n])


def test_a_boundary_vertex_of_three_elements_counts_for_the_authors_only():
    whole = grid(2, 2)
    mesh = Mesh("L", whole.vertices, whole.quads[:3], np.array([[0, 1], [1, 2], [2, 5], [5, 4], [4, 7], [7, 6], [6, 3], [3, 0]]), True)  # fmt: skip  # noqa: E501
    assert irregular(mesh).tolist() == []
    assert irregular_authors(mesh).tolist() == [4]


def test_the_front_of_an_incomplete_mesh_is_not_judged():
    whole = grid(4, 4)
    part = Mesh("part", whole.vertices, whole.quads[:8], whole.segments, False)
    assert irregular(part).tolist() == []


def test_eta_figures_are_those_of_the_elements():
    mesh = grid(6, 5, corner=0.25)
    eta = element_quality(mesh.vertices, mesh.quads)
    found = measure(mesh)
    assert found["eta"] == pytest.approx(eta.mean())
    assert found["eta_min"] == eta.min() < found["eta_p5"] < found["eta"]
    assert np.mean(eta < found["eta_p5"]) == pytest.approx(0.05, abs=1 / len(eta))


def test_no_elements_is_no_error():
    empty = Mesh("none", np.zeros((4, 2)), np.empty((0, 4), np.int64), np.array([[0, 1]]), False)
    found = measure(empty)
    assert found["elements"] == found["triangles"] == found["singularity"] == found["singularity_authors"] == 0
    assert all(math.isnan(found[key]) for key in ("eta", "eta_p5", "eta_min", "taper", "min_angle", "scaled_jacobian"))


def test_a_collapsed_element_has_numbers():
    corners = np.array([[[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]])
    assert scaled_jacobian(corners).tolist() == [0.0]
    assert stretch(corners).tolist() == [0.0]


def test_all_values_are_plain_floats():
    assert {type(value) for value in measure(grid(2, 2)).values()} == {float}


@given(st.integers(0, 1000), st.floats(0, 2 * np.pi), st.floats(0.1, 10))
def test_the_papers_taper_does_not_see_motion_scale_or_first_corner(seed: int, turn: float, scale: float) -> None:
    corners = convex_quads(20, seed)
    c, s = np.cos(turn), np.sin(turn)
    moved = np.roll(scale * corners @ np.array([[c, s], [-s, c]]), seed % 4, axis=1)
    np.testing.assert_allclose(taper_by_triangles(moved), taper_by_triangles(corners), atol=1e-6)
    assert (taper_by_triangles(corners) >= 0).all()
    assert (taper_by_triangles(corners) <= 1).all()


def test_the_papers_taper_by_hand() -> None:
    parallelogram = [[0, 0], [2, 0], [3, 1], [1, 1]]
    trapezium = [[0, 0], [4, 0], [3, 1], [1, 1]]  # a diagonal cuts off 2 of 3 and leaves 1
    np.testing.assert_allclose(taper_by_triangles(np.array([parallelogram, trapezium], dtype=float)), [0.0, 0.5])


def test_measured_means_are_those_of_the_elements() -> None:
    mesh = grid(4, 3, corner=0.2)
    values, found = by_element(mesh), measure(mesh)
    assert set(values) < set(found)
    assert all(each.shape == (12,) and found[name] == each.mean() for name, each in values.items())


# ---- meshes with triangles -------------------------------------------------------------------------------------------


def test_a_mesh_of_quads_measures_the_same_as_a_mixed_one() -> None:
    for mesh in (grid(4, 3, corner=0.2), star(5)):
        assert measure(of_mesh(mesh, "x", 1.0)) == pytest.approx(measure(mesh), abs=1e-12)


def test_triangles_count_for_vertices_alone() -> None:
    angles = np.pi * np.arange(8) / 4
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    vertices = np.vstack([ring, [0.0, 0.0]])
    mesh = assembled("x", vertices, [[8, 0, 1, 2], [8, 2, 3, 4], [8, 4, 5, 6]], [[8, 6, 7], [8, 7, 0]], 1.0)
    assert irregular(mesh).tolist() == [8]  # five edges meet in the middle
    assert irregular_authors(mesh).tolist() == [8]
    found = measure(mesh)
    assert (found["elements"], found["triangles"]) == (5, 2)
    all_quads = assembled("x", vertices, [[8, 0, 1, 2], [8, 2, 3, 4], [8, 4, 5, 6], [8, 6, 7, 0]], [], 1.0)
    assert found["eta"] == pytest.approx(measure(all_quads)["eta"])


def test_a_bent_element_is_counted() -> None:
    mesh = assembled("x", [[0, 0], [2, 0], [0.5, 0.5], [0, 2], [3, 3]], [[0, 1, 2, 3], [1, 4, 3, 2]], [], 1.0)
    assert measure(mesh)["non_convex"] == 1


def test_triangles_only_have_no_element_figures() -> None:
    found = measure(assembled("x", [[0, 0], [1, 0], [0, 1]], [], [[0, 1, 2]], 1.0))
    assert np.isnan(found["eta"])
    assert np.isnan(found["taper"])
    assert (found["elements"], found["triangles"]) == (1, 1)
