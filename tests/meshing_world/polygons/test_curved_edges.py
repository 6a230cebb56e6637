"""Which segments stand for pieces of curves, and vertices on the curves."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.mesh import CurvedEdges
from envs.polygons import curves
from envs.polygons.curved_edges import curved_edges, on_curves
from envs.polygons.drawing import Line
from envs.polygons.exact_curves import CircleArc, EllipseArc
from envs.polygons.validation import domains_of

FULL = 2.0 * np.pi

lengths = st.one_of(st.none(), st.floats(0.02, 0.6))


def line_of(arc: CircleArc, edge_length: float | None, name: str = "") -> Line:
    fineness = curves.flattening(2.8, edge_length)
    return Line(curves.arc(arc.centre, arc.radius, arc.start, arc.sweep, fineness), name, arc)


def upper(y: float) -> Line:
    """The arc from (1, 0) to (-1, 0) around (0, y), over the top."""
    start = float(np.arctan2(-y, 1.0))
    return line_of(CircleArc(np.array([0.0, y]), float(np.hypot(1.0, y)), start, np.pi - 2.0 * start), None)


def is_straight(points: np.ndarray, segments: np.ndarray, y: float) -> np.ndarray:
    return (np.abs(points[segments][:, :, 1] - y) < 1e-12).all(axis=1)


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(lengths, st.floats(0.0, 6.0), st.floats(0.3, 1.0))
def test_every_segment_of_a_ring_stands_for_a_piece_of_its_circle(
    edge_length: float | None, start: float, hole: float
) -> None:
    arcs = [CircleArc(np.zeros(2), 1.0, start), CircleArc(np.array([0.05, 0.0]), 0.6 * hole, start, -FULL)]
    lines = [line_of(arc, edge_length) for arc in arcs]
    rings = [line.points[:-1] for line in lines]
    (domain,) = domains_of([rings], "ring", "ring", edge_length=edge_length, fix_parity=True)
    found = curved_edges(domain.points, domain.segments, lines, rings)
    np.testing.assert_array_equal(found.edges, domain.segments)
    moved = on_curves(domain.points, found)
    for c, curve in enumerate(found.curves):
        vertices = np.unique(found.edges[found.curve_of == c])
        np.testing.assert_allclose(np.linalg.norm(moved[vertices] - curve.centre, axis=1), curve.radius, rtol=1e-14)
    assert np.linalg.norm(moved - domain.points, axis=1).max() <= 0.01 * (edge_length or 1.0)


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(lengths, st.floats(0.4, 5.8))
def test_the_chord_that_closes_an_arc_stays_straight(edge_length: float | None, sweep: float) -> None:
    arc = CircleArc(np.zeros(2), 1.0, 0.5 * np.pi - 0.5 * sweep, sweep)
    line = line_of(arc, edge_length)
    (domain,) = domains_of([[line.points]], "cap", "cap", edge_length=edge_length, fix_parity=True)
    found = curved_edges(domain.points, domain.segments, [line], [line.points])
    chord = is_straight(domain.points, domain.segments, line.points[0, 1])
    np.testing.assert_array_equal(found.edges, domain.segments[~chord])
    moved = on_curves(domain.points, found)
    np.testing.assert_array_equal(moved[domain.segments[chord]], domain.points[domain.segments[chord]])


def test_a_diameter_in_one_segment_is_no_half_circle() -> None:
    half = line_of(CircleArc(np.zeros(2), 1.0, 0.0, np.pi), None)
    square = np.array([[1.0, 0.0], [-1.0, 0.0], [-1.0, -1.0], [1.0, -1.0]])
    segments = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    assert not len(curved_edges(square, segments, [half]).edges)


def test_a_side_that_cuts_off_the_cap_of_another_region_stays_straight() -> None:
    """The arc's ends are joined by a side of a region that the arc does not bound: its outline tells."""
    cap = upper(-1.0)
    square = np.array([[1.0, 0.0], [-1.0, 0.0], [-1.0, -2.0], [1.0, -2.0]])
    segments = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    assert not len(curved_edges(square, segments, [cap], [square]).edges)
    rounded = np.concatenate([cap.points, square[2:]])
    around = np.stack([np.arange(len(rounded)), np.roll(np.arange(len(rounded)), -1)], axis=1)
    found = curved_edges(rounded, around, [cap], [rounded])
    np.testing.assert_array_equal(found.edges, around[: len(cap.points) - 1])
    # One segment for the whole arc, as a coarse edge length makes it.
    assert len(curved_edges(square, segments, [cap], [rounded]).edges) == 1


def test_of_two_curves_through_both_ends_the_outline_is_followed_else_the_closer_one() -> None:
    """A lens: two arcs between the same ends."""
    flat, round_ = upper(-2.0), upper(-0.5)
    square = np.array([[1.0, 0.0], [-1.0, 0.0], [-1.0, -2.0], [1.0, -2.0]])
    segments = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    for lines in ([flat, round_], [round_, flat]):
        assert curved_edges(square, segments, lines).curves == (flat.curve,)
        outline = np.concatenate([round_.points, square[2:]])
        assert curved_edges(square, segments, lines, [outline]).curves == (round_.curve,)


def test_curves_that_no_edge_lies_on_are_left_out_and_lines_without_a_curve_passed_over() -> None:
    near = line_of(CircleArc(np.zeros(2), 1.0), None)
    far = line_of(CircleArc(np.array([9.0, 0.0]), 1.0), None)
    points = near.points[:-1]
    ring = np.stack([np.arange(len(points)), np.roll(np.arange(len(points)), -1)], axis=1)
    found = curved_edges(points, ring, [far, Line(points, "straight"), near])
    assert found.curves == (near.curve,)
    np.testing.assert_array_equal(found.curve_of, np.zeros(len(points)))
    assert not curved_edges(points, ring, []).curves
    assert not len(curved_edges(points, ring, [far]).edges)


def test_both_sides_of_a_crack_along_a_curve_follow_it() -> None:
    line = line_of(CircleArc(np.zeros(2), 1.0, 0.0, 1.0), None)
    n = len(line.points)
    points = np.concatenate([line.points, line.points])
    first = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)
    edges = np.concatenate([first, first[:, ::-1] + n])
    np.testing.assert_array_equal(curved_edges(points, edges, [line]).edges, edges)


def test_a_vertex_of_two_curves_stays_where_they_meet() -> None:
    """Two arcs that meet with a gap that a drawing's digits leave."""
    first, second = CircleArc(np.zeros(2), 1.0), CircleArc(np.array([2.0 + 1e-7, 0.0]), 1.0)
    points = np.array([[0.0, 1.0 + 1e-7], [1.0, 0.0], [2.0, 1.0]])
    edges = np.array([[0, 1], [1, 2]])
    moved = on_curves(points, CurvedEdges(edges, np.array([0, 1]), (first, second)))
    np.testing.assert_array_equal(moved[1], points[1])
    assert moved[0, 1] == pytest.approx(1.0, abs=1e-15)
    assert points[0, 1] == 1.0 + 1e-7


def test_vertices_of_an_ellipse_drawn_as_a_block_land_on_it() -> None:
    """Its half diameters are conjugate, not square to each other."""
    curve = EllipseArc(np.zeros(2), np.array([1.0, 0.2]), np.array([0.3, 0.5]))
    fine = curves.sampled(curve.at, curve.bounds, curves.flattening(2.0, 0.2))
    (domain,) = domains_of([[fine[:-1]]], "ellipse", "ellipse", edge_length=0.2)
    found = curved_edges(domain.points, domain.segments, [Line(fine, curve=curve)], [fine[:-1]])
    assert len(found.edges) == len(domain.segments)
    moved = on_curves(domain.points, found)
    exact = shapely.linearrings(curve.at(np.linspace(0.0, FULL, 200_001)))
    assert shapely.distance(exact, shapely.points(domain.points)).max() > 1e-6
    assert shapely.distance(exact, shapely.points(moved)).max() < 1e-9
