"""Curves: nearest places against fine polylines, ways along them against measured lengths."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly, BSpline, CubicSpline

from envs.polygons.exact_curves import CircleArc, EllipseArc, ParametricCurve, Rational, arc_between
from envs.types import Curve

FULL = 2.0 * np.pi

places = st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)).map(np.array)
sweeps = st.one_of(st.sampled_from([FULL, -FULL]), st.floats(0.2, 6.0), st.floats(-6.0, -0.2))


@st.composite
def curves(draw: Any) -> Curve:
    kind = draw(st.sampled_from(["circle", "ellipse", "spline", "closed spline"]))
    centre, start, sweep = draw(places), draw(st.floats(-7.0, 7.0)), draw(sweeps)
    if kind == "circle":
        return CircleArc(centre, draw(st.floats(0.01, 100.0)), start, sweep)
    if kind == "ellipse":
        angle, size, ratio = draw(st.floats(0.0, FULL)), draw(st.floats(0.1, 10.0)), draw(st.floats(0.1, 1.0))
        major = size * np.array([np.cos(angle), np.sin(angle)])
        return EllipseArc(centre, major, ratio * np.array([-major[1], major[0]]), start, sweep)
    return spline(draw(st.integers(0, 10**6)), closed=kind == "closed spline")


def spline(seed: int, closed: bool) -> ParametricCurve:
    """Once round the origin, or most of the way; its parameter runs down."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, FULL, 9)
    turned = t if closed else 0.9 * t
    points = rng.uniform(0.8, 1.2, 9)[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=1)
    if closed:
        points = np.concatenate([points[:-1], points[:1]])
    function = CubicSpline(t, points, bc_type="periodic" if closed else "natural")
    return ParametricCurve(function, t[::-1])


def span(curve: Any) -> tuple[float, float]:
    if isinstance(curve, CircleArc):
        return curve.start, curve.start + curve.sweep
    return curve.bounds[0], curve.bounds[-1]


def parameters(curve: Any, seed: int, count: int = 40) -> np.ndarray:
    low, high = span(curve)
    return low + (high - low) * np.random.default_rng(seed).random(count)


def size(curve: Any) -> float:
    return float(np.abs(curve.at(parameters(curve, 0))).max())


@settings(max_examples=60)
@given(curves(), st.integers(0, 10**6))
def test_a_place_on_a_curve_is_its_own_nearest(curve: Curve, seed: int) -> None:
    on = curve.at(parameters(curve, seed))
    np.testing.assert_allclose(curve.at(curve.nearest(on)), on, rtol=0.0, atol=1e-12 * size(curve))


@settings(max_examples=60)
@given(curves(), st.integers(0, 10**6), st.sampled_from([1e-3, 0.3, 10.0]))
def test_no_place_of_a_fine_polyline_is_nearer(curve: Any, seed: int, off: float) -> None:
    low, high = span(curve)
    fine = shapely.linestrings(curve.at(np.linspace(low, high, 4001)))
    rng = np.random.default_rng(seed)
    points = curve.at(parameters(curve, seed)) + off * rng.uniform(-1.0, 1.0, (40, 2))
    found = curve.nearest(points)
    assert ((found >= min(low, high) - 1e-9) & (found <= max(low, high) + 1e-9)).all()
    mine = np.linalg.norm(curve.at(found) - points, axis=1)
    # As chords the polyline may be nearer by their sagitta.
    assert (mine - shapely.distance(fine, shapely.points(points))).max() <= 1e-5 * size(curve)


@pytest.mark.slow
@settings(max_examples=60)
@given(curves(), st.integers(0, 10**6))
def test_places_between_are_on_the_curve_at_equal_lengths(curve: Any, seed: int) -> None:
    low, high = span(curve)
    near = low + (high - low) * np.random.default_rng(seed).uniform(0.3, 0.5)
    ends = curve.at(np.array([near, near + 0.06 * (high - low)]))
    found = curve.between(ends[:1], ends[1:], np.arange(9) / 8)[0]
    np.testing.assert_allclose(found[[0, -1]], ends, rtol=0.0, atol=1e-11 * size(curve))
    np.testing.assert_allclose(curve.at(curve.nearest(found)), found, rtol=0.0, atol=1e-11 * size(curve))
    lengths = [
        np.linalg.norm(np.diff(curve.at(np.linspace(*curve.nearest(pair), 2000)), axis=0), axis=1).sum()
        for pair in np.stack([found[:-1], found[1:]], axis=1)
    ]
    np.testing.assert_allclose(lengths, np.mean(lengths), rtol=1e-5)


@settings(max_examples=60)
@given(curves(), st.integers(0, 10**6))
def test_the_way_back_is_the_same(curve: Any, seed: int) -> None:
    ends = curve.at(parameters(curve, seed, 2))
    fractions = np.array([0.1, 0.25, 0.7])
    there = curve.between(ends[:1], ends[1:], fractions)[0]
    back = curve.between(ends[1:], ends[:1], 1.0 - fractions)[0]
    np.testing.assert_allclose(back, there, rtol=0.0, atol=1e-9 * size(curve))


@pytest.mark.parametrize(
    "curve",
    [
        CircleArc(np.zeros(2), 1.0, 0.3),
        CircleArc(np.zeros(2), 1.0, 0.3, -FULL),
        EllipseArc(np.zeros(2), np.array([1.0, 0.0]), np.array([0.0, 0.7]), 0.3, FULL),
        EllipseArc(np.zeros(2), np.array([1.0, 0.0]), np.array([0.0, 0.7]), 0.3, -FULL),
        spline(3, closed=True),
    ],
)
def test_the_way_on_a_closed_curve_is_the_shorter_one_over_its_ends_too(curve: Any) -> None:
    low, high = span(curve)
    share = (high - low) / 20.0
    ends = curve.at(np.array([low + share, high - share]))
    found = curve.between(ends[:1], ends[1:], np.linspace(0.0, 1.0, 5))[0]
    start = curve.at(np.array([low]))[0]
    assert np.linalg.norm(found - start, axis=1).max() <= 1.5 * np.linalg.norm(ends - start, axis=1).max()
    np.testing.assert_allclose(found[[0, -1]], ends, atol=1e-9)


@pytest.mark.parametrize("curve", [CircleArc(np.zeros(2), 1.0, 0.0, 5.5), EllipseArc(
    np.zeros(2), np.array([1.0, 0.0]), np.array([0.0, 0.7]), 0.0, 5.5
)])  # fmt: skip
def test_the_way_on_an_open_arc_does_not_leave_it(curve: Any) -> None:
    ends = curve.at(np.array([0.1, 5.4]))
    middle = curve.between(ends[:1], ends[1:], np.array([0.5]))[0, 0]
    np.testing.assert_allclose(middle, curve.at(np.array([2.75]))[0], atol=0.05)


def test_a_parameter_that_stands_still_does_not_bunch_the_places() -> None:
    at = BPoly(np.array([[[0.0, 0.0]], [[0.0, 0.0]], [[1.0, 0.0]], [[1.0, 1.0]]]), [0.0, 1.0])
    curve = ParametricCurve(at, np.array([0.0, 1.0]))
    found = curve.between(np.array([[0.0, 0.0]]), np.array([[1.0, 1.0]]), np.linspace(0.0, 1.0, 9))[0]
    steps = np.linalg.norm(np.diff(found, axis=0), axis=1)
    assert steps.max() / steps.min() < 1.02
    bunched = np.linalg.norm(np.diff(at(np.linspace(0.0, 1.0, 9)), axis=0), axis=1)
    assert bunched.max() / bunched.min() > 5.0


def test_a_rational_spline_is_the_circle_that_it_states() -> None:
    """The usual circle of four quarters of degree two."""
    corners = np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]], dtype=float)
    weights = np.array([1.0, np.sqrt(0.5)] * 4 + [1.0])[:, None]
    knots = np.array([0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4], dtype=float)
    curve = ParametricCurve(Rational(BSpline(knots, np.hstack([corners * weights, weights]), 2)), np.arange(5.0))
    angles = np.random.default_rng(0).uniform(0.0, FULL, 50)
    circle = CircleArc(np.zeros(2), 1.0)
    on = circle.at(angles)
    np.testing.assert_allclose(curve.at(curve.nearest(2.0 * on)), on, atol=1e-9)
    fractions = np.linspace(0.0, 1.0, 5)
    a, b = circle.at(np.array([-0.4, 1.4])), circle.at(np.array([0.4, 2.9]))
    np.testing.assert_allclose(curve.between(a, b, fractions), circle.between(a, b, fractions), atol=1e-12)


@given(places, places, st.one_of(st.floats(0.01, 6.2), st.floats(-6.2, -0.01)))
def test_an_arc_between_places_is_the_one_of_a_bulge(a: np.ndarray, b: np.ndarray, sweep: float) -> None:
    ezdxf_math = pytest.importorskip("ezdxf.math")
    if np.linalg.norm(b - a) < 1e-3:
        return
    arc = arc_between(a, b, sweep)
    centre, _, _, radius = ezdxf_math.bulge_to_arc(a, b, np.tan(sweep / 4.0))
    scale = radius + 1.0
    np.testing.assert_allclose(arc.centre, np.array(centre), atol=1e-9 * scale)
    assert arc.radius == pytest.approx(radius, rel=1e-9)
    np.testing.assert_allclose(arc.at(np.array([arc.start, arc.start + sweep])), [a, b], atol=1e-9 * scale)


def test_coordinates_far_from_the_origin_keep_their_digits() -> None:
    shift = np.array([500_000.0, 5_400_000.0])
    there = EllipseArc(shift, np.array([3.0, 1.0]), np.array([-0.4, 1.2]))
    on = there.at(np.linspace(0.1, 6.0, 50))
    np.testing.assert_allclose(there.at(there.nearest(on)), on, rtol=0.0, atol=5e-9)
    here = EllipseArc(np.zeros(2), np.array([3.0, 1.0]), np.array([-0.4, 1.2]))
    fractions = np.array([0.25, 0.5, 0.75])
    np.testing.assert_allclose(
        there.between(on[:-1], on[1:], fractions) - shift,
        here.between(on[:-1] - shift, on[1:] - shift, fractions),
        atol=1e-8,
    )


def test_curves_pickle_also_after_they_were_asked() -> None:
    for curve in (CircleArc(np.zeros(2), 1.0), EllipseArc(np.zeros(2), np.eye(2)[0], np.eye(2)[1]), spline(0, True)):
        points = np.array([[1.0, 0.2], [-0.5, 2.0]])
        told = curve.nearest(points)
        np.testing.assert_array_equal(pickle.loads(pickle.dumps(curve)).nearest(points), told)


def test_no_points_have_no_nearest_places() -> None:
    for curve in (CircleArc(np.zeros(2), 1.0), spline(0, True)):
        assert curve.nearest(np.empty((0, 2))).shape == (0,)
        assert curve.between(np.empty((0, 2)), np.empty((0, 2)), np.array([0.5])).shape == (0, 1, 2)
