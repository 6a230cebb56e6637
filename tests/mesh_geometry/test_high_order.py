"""Elements of order 2 to 4 on curves: their nodes, their area, and that none is turned over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from curved_meshes import FULL, area, blob, curved, ellipse, inside, jacobians, ring, straight, unit_circle
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.mesh import CurvedEdges, Groups, Mesh
from envs.polygons.exact_curves import CircleArc, EllipseArc
from envs.types import Curve
from freemesh_ray.export.plane import plane_elements
from freemesh_ray.mesh_geometry import lagrange
from freemesh_ray.mesh_geometry.high_order import HighOrder, high_order, spoiled

ORDERS = (2, 3, 4)
orders = st.sampled_from(ORDERS)


def least(mesh: HighOrder) -> float:
    """The least determinant at Gauss's points, the corners and a fine grid."""
    points = np.concatenate([lagrange.gauss(mesh.order + 1)[0], np.linspace(0.0, 1.0, 21)])
    return float(jacobians(mesh, points)[2].min())


@pytest.mark.parametrize("order", [1, *ORDERS])
def test_corners_come_first_and_straight_elements_have_their_nodes_as_far_apart(order: int) -> None:
    mesh = straight(inside(unit_circle(), 2))
    found = high_order(mesh, order)
    np.testing.assert_array_equal(found.nodes[: len(mesh.vertices)], mesh.vertices)
    np.testing.assert_array_equal(found.elements[:, [0, order, -1, -1 - order]], mesh.quads)
    a, b, c, d = (mesh.vertices[mesh.quads[:, i], None, None] for i in range(4))
    x, y = (np.arange(order + 1) / order)[:, None], (np.arange(order + 1) / order)[:, None, None]
    bilinear = (1 - y) * ((1 - x) * a + x * b) + y * ((1 - x) * d + x * c)
    np.testing.assert_allclose(found.nodes[found.grid], bilinear, atol=1e-14)


@pytest.mark.parametrize("order", ORDERS)
def test_elements_share_the_nodes_of_their_sides_and_each_node_is_used(order: int) -> None:
    mesh = inside(blob(), 3)
    found = high_order(mesh, order)
    edges = len(mesh.edges[0])
    assert len(found.nodes) == len(mesh.vertices) + edges * (order - 1) + len(mesh.quads) * (order - 1) ** 2
    np.testing.assert_array_equal(np.unique(found.elements), np.arange(len(found.nodes)))
    assert len(np.unique(np.round(found.nodes, 9), axis=0)) == len(found.nodes)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("curve", [unit_circle(), ellipse(), blob()])
def test_nodes_of_curved_sides_are_on_the_curve_as_far_apart(curve: Curve, order: int) -> None:
    centre = (0.2, -0.1) if isinstance(curve, EllipseArc) else (0.0, 0.0)
    mesh = inside(curve, 4, centre)
    found = high_order(mesh, order)
    sides = dict(zip(map(tuple, found.around[:, :4].tolist()), found.around.tolist(), strict=True))
    seen = 0
    for corners, around in sides.items():
        for i in range(4):
            if (corners[i], corners[(i + 1) % 4]) in set(map(tuple, mesh.segments.tolist())):
                inner = found.nodes[around[4 + i * (order - 1) : 4 + (i + 1) * (order - 1)]]
                np.testing.assert_allclose(curve.at(curve.nearest(inner)), inner, atol=1e-11)
                chain = np.concatenate([found.nodes[[corners[i]]], inner, found.nodes[[corners[(i + 1) % 4]]]])
                steps = np.linalg.norm(np.diff(chain, axis=0), axis=1)
                assert steps.max() < 1.05 * steps.min()
                seen += 1
    assert seen == len(mesh.segments)


def test_of_order_two_without_curves_the_eight_nodes_are_those_that_are_written() -> None:
    mesh = straight(inside(unit_circle(), 3))
    written = plane_elements(mesh, 8)
    nodes, elements = high_order(mesh, 2).serendipity
    np.testing.assert_array_equal(nodes, written.nodes)
    np.testing.assert_array_equal(elements, written.elements)


def test_other_stations_put_the_nodes_elsewhere_on_the_same_curve() -> None:
    bunched = 0.5 - 0.5 * np.cos(np.pi * np.arange(4) / 3)
    mesh = inside(unit_circle(), 2)
    found = high_order(mesh, 3, bunched)
    on = np.unique(found.elements[np.isin(found.elements, mesh.segments).sum(axis=1) == 2])
    radii = np.linalg.norm(found.nodes[on], axis=1)
    assert (np.abs(radii - 1.0) < 1e-14).sum() == 3 * len(mesh.segments)
    # Those of the Lobatto points integrate along a side exactly, as Gauss's do: order 2 k for the area.
    lobatto = np.array([0.0, 0.5 - 0.5 * np.sqrt(1 / 5), 0.5 + 0.5 * np.sqrt(1 / 5), 1.0])
    errors = [abs(area(high_order(inside(unit_circle(), n), 3, lobatto)) - np.pi) for n in (2, 4)]
    assert np.log2(errors[0] / errors[1]) > 5.5


def exact_area(curve: Curve) -> float:
    """Half the integral of x dy - y dx, by Gauss's points between the breaks."""
    breaks = getattr(curve, "bounds", np.linspace(0.0, FULL, 9))
    points, weights = lagrange.gauss(20)
    total = 0.0
    for low, high in zip(breaks[:-1], breaks[1:], strict=True):
        t, e = low + (high - low) * points, 1e-4 * (high - low)
        p = curve.at(t)
        slope = (curve.at(t - 2 * e) - 8 * curve.at(t - e) + 8 * curve.at(t + e) - curve.at(t + 2 * e)) / (12 * e)
        total += 0.5 * (high - low) * float(weights @ (p[:, 0] * slope[:, 1] - p[:, 1] * slope[:, 0]))
    return total


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("name", ["disc", "ellipse", "annulus", "blob"])
def test_the_area_falls_to_the_exact_one_at_order_k_plus_one_or_two(name: str, order: int) -> None:
    """Of even order one more: an odd polynomial more is integrated exactly by nodes that are symmetric."""
    hole = EllipseArc(np.array([0.1, 0.0]), np.array([0.4, 0.1]), np.array([-0.1, 0.3]))

    def made(n: int) -> Mesh:
        if name == "annulus":
            return ring(hole, unit_circle(), 4 * n)
        curve = {"disc": unit_circle(), "ellipse": ellipse(), "blob": blob()}[name]
        return inside(curve, n, (0.2, -0.1) if name == "ellipse" else (0.0, 0.0))

    # Where the blob's spline has breaks there are vertices: seven spans.
    sizes = (7, 14) if name == "blob" else (4, 8)
    exact = {"disc": np.pi, "ellipse": 0.6 * np.pi, "blob": exact_area(blob())}.get(name, np.pi - exact_area(hole))
    errors = [abs(area(high_order(made(n), order)) - exact) for n in sizes]
    chords = [abs(area(high_order(straight(made(n)), order)) - exact) for n in sizes]
    assert np.log2(errors[0] / errors[1]) >= 2 * ((order + 2) // 2) - 0.3
    assert np.log2(chords[0] / chords[1]) <= 2.2


@pytest.mark.slow
@settings(max_examples=40)
@given(orders, st.integers(1, 6), st.floats(0.15, 1.0), st.floats(0.3, 0.6))
def test_elements_in_discs_and_ellipses_are_not_turned_over(order: int, n: int, ratio: float, core: float) -> None:
    found = high_order(inside(EllipseArc(np.zeros(2), np.eye(2)[0], ratio * np.eye(2)[1]), n, core=core), order)
    assert not len(found.spoiled)
    assert least(found) > 0.0
    assert found.off_curve == 0.0


@pytest.mark.slow
@settings(max_examples=40)
@given(orders, st.integers(8, 24), st.floats(0.004, 0.3), st.integers(2, 20))
def test_thin_rows_beside_a_curve_bend_with_it(order: int, n: int, first: float, rows: int) -> None:
    """The first row may be thinner than the arc's height over its chord."""
    heights = np.cumsum(1.3 ** np.arange(rows))
    shares = np.append(0.0, first * heights / heights[0])
    shares = np.append(shares[shares < 0.7], 1.0)
    mesh = ring(unit_circle(), CircleArc(np.zeros(2), 3.0), n, shares)
    found = high_order(mesh, order)
    np.testing.assert_array_equal(found.nodes[: len(mesh.vertices)], mesh.vertices)
    if not len(found.spoiled):
        assert least(found) > 0.0
    if n >= 12 and first >= 0.01:
        assert not len(found.spoiled)


def thin(n: int, first: float) -> Mesh:
    return ring(unit_circle(), CircleArc(np.zeros(2), 2.0), n, np.append(0.0, np.linspace(first, 1.0, 12)))


@pytest.mark.parametrize("order", ORDERS)
def test_only_elements_near_those_that_were_turned_over_are_bent(order: int) -> None:
    mesh = thin(12, 0.02)
    found = high_order(mesh, order)
    assert not len(found.spoiled)
    assert least(found) > 0.0
    assert 12 <= len(found.bent) < len(mesh.quads) // 2
    rest = np.setdiff1d(np.arange(len(mesh.quads)), found.bent)
    plain = high_order(straight(mesh), order)
    inner = rest[~np.isin(mesh.quads[rest], mesh.segments).any(axis=1)]
    np.testing.assert_array_equal(found.nodes[found.elements[inner]], plain.nodes[plain.elements[inner]])


@pytest.mark.parametrize("order", [2, 3])
def test_elements_without_nodes_inside_are_looked_at_as_such(order: int) -> None:
    """Their map is bent rows' too: the node in the middle of eight is half of the sides' less a quarter of corners'."""
    mesh = thin(12, 0.02)
    found = high_order(mesh, order, serendipity=True)
    assert len(found.bent)
    assert not len(found.spoiled)
    assert least(found) > 0.0
    nodes, around = found.serendipity
    if order == 2:
        middle = 0.5 * nodes[around[:, 4:]].sum(axis=1) - 0.25 * nodes[around[:, :4]].sum(axis=1)
        np.testing.assert_allclose(found.nodes[found.elements[:, 4]], middle, atol=1e-14)
        assert np.abs(high_order(mesh, order).nodes[found.elements[:, 4]] - middle).max() > 1e-4
    else:
        local = found.nodes[found.elements].reshape(-1, 4, 4, 2)
        # The twelve polynomials hold x^3 y, but no x^2 y^2: the second differences of the second differences are 0.
        mixed = np.einsum("ai,bj,mjic->mbac", *2 * [np.diff(np.eye(4), n=2, axis=0)], local)
        np.testing.assert_allclose(mixed, 0.0, atol=1e-13)


def test_lines_inside_stay_straight_when_bends_are_carried_on() -> None:
    mesh = thin(12, 0.02)
    line = np.stack([np.arange(12, 24), np.roll(np.arange(12, 24), -1)], axis=1)
    with_line = replace(mesh, groups=Groups(lines={"weld": line}))
    found = high_order(with_line, 2)
    middles = 0.5 * (mesh.vertices[line[:, 0]] + mesh.vertices[line[:, 1]])
    off = np.linalg.norm(found.nodes[:, None] - middles, axis=2).min(axis=0)
    assert off.max() < 1e-14
    assert len(found.spoiled) == 12  # nothing else rights these
    assert not len(high_order(mesh, 2).spoiled)


@pytest.mark.parametrize("order", ORDERS)
def test_a_vertex_of_one_element_on_a_smooth_curve_gets_sides_that_meet_at_less_than_a_straight_angle(
    order: int,
) -> None:
    """A square's corners on the circle: exact sides would meet at 180 degrees, where the determinant is 0."""
    angles = np.pi / 4 + FULL * np.arange(4) / 4
    outer = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    middles = np.stack([np.cos(angles + np.pi / 4), np.sin(angles + np.pi / 4)], axis=1)
    points = np.concatenate([outer, middles, [[0.0, 0.0]]])
    quads = np.array([[8, 7, 0, 4], [8, 4, 1, 5], [8, 5, 2, 6], [8, 6, 3, 7]])
    found = high_order(curved(points, quads, (unit_circle(),)), order)
    assert not len(found.spoiled)
    assert least(found) >= 0.0
    if order == 2:
        assert found.off_curve == 0.0
    else:
        assert len(found.eased) == 4
        assert 0.0 < found.off_curve < 0.02


def test_nodes_leave_the_curve_by_less_than_the_orders_error() -> None:
    """Elements with two sides on the circle, of ever smaller size; see the test before."""
    for order in (3, 4):
        offs = []
        for n in (4, 8, 16):
            angles = FULL * np.arange(4 * n) / (4 * n)
            a, b, c = (np.array([np.cos(t), np.sin(t)]) for t in (-angles[1], 0.0, angles[1]))
            points = np.stack([a, b, c, b - 2.0 * angles[1] * np.array([1.0, 0.0])])
            mesh = Mesh(
                "corner", points, np.array([[3, 0, 1, 2]]), np.array([[3, 0], [0, 1], [1, 2], [2, 3]]), True,
                curved=CurvedEdges(np.array([[0, 1], [1, 2]]), np.zeros(2, dtype=np.int64), (unit_circle(),)),
            )  # fmt: skip
            found = high_order(mesh, order)
            assert len(found.eased) == 1
            offs.append(found.off_curve)
        assert np.log2(offs[0] / offs[-1]) / 2 >= order


def test_what_nothing_rights_is_told_and_stays_on_the_curve() -> None:
    """A circle of six sides with a row a thousandth thick, held by a line behind it."""
    mesh = ring(unit_circle(), CircleArc(np.zeros(2), 1.002), 6, np.array([0.0, 0.5, 1.0]))
    line = np.stack([np.arange(6, 12), np.roll(np.arange(6, 12), -1)], axis=1)
    mesh = replace(mesh, groups=Groups(lines={"line": line}))
    told = spoiled(mesh, 2)
    assert np.isin(np.arange(6), told).all()
    found = high_order(mesh, 2)
    assert found.off_curve == 0.0
    fine = ring(unit_circle(), CircleArc(np.zeros(2), 1.002), 96, np.array([0.0, 0.5, 1.0]))
    line = np.stack([np.arange(96, 192), np.roll(np.arange(96, 192), -1)], axis=1)
    assert not len(spoiled(replace(fine, groups=Groups(lines={"line": line})), 2))


def test_curves_inside_are_followed_from_both_sides() -> None:
    """A circle between two regions."""
    mesh = ring(CircleArc(np.zeros(2), 0.5), CircleArc(np.zeros(2), 2.0), 12, np.array([0.0, 1 / 3, 1.0]))
    line = np.stack([np.arange(12, 24), np.roll(np.arange(12, 24), -1)], axis=1)
    mesh = replace(
        mesh, curved=CurvedEdges(line[:, ::-1], np.zeros(12, dtype=np.int64), (unit_circle(),))
    )  # fmt: skip
    found = high_order(mesh, 3)
    radii = np.linalg.norm(found.nodes, axis=1)
    assert (np.abs(radii - 1.0) < 1e-14).sum() == 3 * 12
    assert least(found) > 0.0
