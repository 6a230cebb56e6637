"""Element quality: a square is best, shape alone counts, and valid means convex."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from envs.quality import angles_valid, convex_quality, element_quality, inner_angles
from envs.types import MAX_ELEMENT_ANGLE, MIN_ELEMENT_ANGLE, Floats

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@st.composite
def convex(draw: st.DrawFn) -> Floats:
    """A strictly convex counter-clockwise quadrilateral: four points of an ellipse."""
    gaps = np.array([draw(st.floats(0.2, 2.0)) for _ in range(4)])
    t = 2.0 * np.pi * np.cumsum(gaps) / gaps.sum()
    return np.stack([np.cos(t), draw(st.floats(0.2, 1.0)) * np.sin(t)], axis=1)


def eta(corners: Floats) -> float:
    return float(element_quality(corners, np.array([[0, 1, 2, 3]]))[0])


def valid(corners: Floats) -> bool:
    return bool(angles_valid(*inner_angles(*corners.ravel().tolist())))


@given(convex())
def test_quality_lies_between_0_and_1_and_follows_its_formula(corners: Floats) -> None:
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(edges, axis=1)
    diagonal = max(np.linalg.norm(corners[2] - corners[0]), np.linalg.norm(corners[3] - corners[1]))
    back = -np.roll(edges, 1, axis=0)
    angles = np.arccos((edges * back).sum(axis=1) / lengths / np.roll(lengths, 1))
    expected = np.sqrt(np.sqrt(2.0) * lengths.min() / diagonal * angles.min() / angles.max())
    assert eta(corners) == pytest.approx(expected, rel=1e-7)
    assert 0.0 < eta(corners) <= 1.0 + 1e-12


@given(
    convex(), st.floats(-7.0, 7.0), st.floats(1e-6, 1e6), st.tuples(st.floats(-9, 9), st.floats(-9, 9)),
    st.integers(0, 3),
)  # fmt: skip
def test_quality_is_of_the_shape_alone(
    corners: Floats, turn: float, scale: float, shift: tuple[float, float], first: int
) -> None:
    c, s = np.cos(turn), np.sin(turn)
    moved = scale * (corners @ np.array([[c, s], [-s, c]]) + shift)
    assert eta(np.roll(moved, first, axis=0)) == pytest.approx(eta(corners), rel=1e-9)
    assert eta(corners[::-1] * [-1.0, 1.0]) == pytest.approx(eta(corners), rel=1e-9)


def test_a_square_is_perfect_and_nothing_near_it_is() -> None:
    assert eta(SQUARE) == pytest.approx(1.0, abs=1e-15)
    assert eta(SQUARE * [2.0, 1.0]) == pytest.approx(np.sqrt(np.sqrt(2.0 / 5.0)))
    for i in range(8):
        pushed = SQUARE.copy()
        pushed.ravel()[i] += 0.01
        assert eta(pushed) < 1.0 - 1e-3


def test_a_flat_element_is_worthless() -> None:
    flat = [eta(SQUARE * [1.0, height]) for height in (0.1, 0.01, 0.001)]
    assert flat == sorted(flat, reverse=True)
    assert flat[-1] < 0.05


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=4, max_size=4))
def test_valid_means_convex_counter_clockwise_and_no_sharp_corner(points: list[tuple[int, int]]) -> None:
    corners = np.array(points, dtype=np.float64)
    ring = shapely.Polygon(corners)
    strictly_convex = ring.is_valid and len(ring.convex_hull.normalize().boundary.coords) == 5
    expected = strictly_convex and ring.exterior.is_ccw and ring.convex_hull.area == pytest.approx(ring.area)
    if expected:
        z = corners @ [1.0, 1.0j]
        inside = np.angle((np.roll(z, 1) - z) / (np.roll(z, -1) - z))
        assert inside.sum() == pytest.approx(2.0 * np.pi)
        expected = inside.min() > MIN_ELEMENT_ANGLE and inside.max() < MAX_ELEMENT_ANGLE
    assert valid(corners) == expected


@given(convex())
def test_only_one_order_of_the_corners_is_valid(corners: Floats) -> None:
    assert valid(corners) == valid(np.roll(corners, 1, axis=0))
    assert not valid(corners[::-1])
    assert not valid(corners[[0, 2, 1, 3]])


def test_convex_quality_is_eta_where_there_is_one() -> None:
    """Of random quadrilaterals: eta for those that shapely finds convex and counter-clockwise, -1 for the others."""
    rng = np.random.default_rng(5)
    vertices = rng.uniform(-1.0, 1.0, (4 * 400, 2))
    quads = np.arange(len(vertices)).reshape(-1, 4)
    found, plain = convex_quality(vertices, quads), element_quality(vertices, quads)
    rings = [shapely.LinearRing(vertices[quad]) for quad in quads]
    fine = np.array(
        [
            r.is_simple and r.is_ccw and shapely.Polygon(r).convex_hull.area <= shapely.Polygon(r).area * (1 + 1e-12)
            for r in rings
        ]
    )
    assert 20 < fine.sum() < 380
    np.testing.assert_array_equal(found[~fine], -1.0)
    np.testing.assert_allclose(found[fine], plain[fine], rtol=1e-12)
