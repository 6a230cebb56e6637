"""Grading: finer at re-entrant corners and in narrow places, and sizes that grow gently from there."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.domains.load import from_object
from envs.polygons.cones import Cones
from envs.polygons.gaps import gaps
from envs.polygons.sizing import GROWTH, Sizes
from envs.types import Floats

L_SHAPE = np.array([[-1, -1], [0, -1], [0, 0], [1, 0], [1, 1], [-1, 1]], dtype=np.float64)
CRACK = np.array([[0, 0], [4, 0], [4, 1.974], [1, 2], [4, 2.026], [4, 4], [0, 4]])


def box(x: float, y: float, width: float, height: float) -> Floats:
    """A rectangle by its lower left corner."""
    return np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])


def near(polygon: list[Floats], place: tuple[float, float], reach: float, **options: float) -> Floats:
    """Lengths of the segments whose middles lie within ``reach`` of a place."""
    (domain,) = from_object(polygon, **options)
    ends = domain.points[domain.segments]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[np.hypot(*(ends.mean(axis=1) - place).T) < reach]


@pytest.mark.parametrize(("outline", "tip", "edge_length"), [(L_SHAPE, (0, 0), 0.2), (CRACK, (1, 2), 0.4)])
@pytest.mark.parametrize("grading", [2.0, 5.0, 20.0])
def test_reentrant_corners_are_graded_down(
    outline: Floats, tip: tuple[float, float], edge_length: float, grading: float
) -> None:
    smallest = edge_length / grading
    sizes = near([outline], tip, smallest, edge_length=edge_length, grading=grading)
    assert len(sizes) >= 2
    assert smallest / 1.5 < sizes.min() <= sizes.max() < 1.5 * smallest
    everywhere = near([outline], tip, 99.0, edge_length=edge_length, grading=grading)
    assert everywhere.max() < 1.3 * edge_length


def test_convex_right_angles_and_even_boundaries_are_left_alone() -> None:
    square = box(0, 0, 10, 10)
    np.testing.assert_allclose(near([square], (0, 0), 99.0, edge_length=1.0, grading=9.0), 1.0)
    np.testing.assert_allclose(near([CRACK[[0, 1, 5, 6]]], (0, 0), 99.0, edge_length=1.0), 1.0)


@pytest.mark.parametrize(("polygon", "place"), [
    ([box(0, 0, 20, 1)], (10, 0)),
    ([box(0, 0, 20, 10), box(5, 1, 5, 5)], (7, 0)),
    ([box(0, 0, 20, 10), box(4, 3, 4, 4), box(9, 3, 4, 4)], (8, 5)),
])  # fmt: skip
def test_three_segments_fit_across_a_gap_of_one(polygon: list[Floats], place: tuple[float, float]) -> None:
    """A channel, a hole near a side, a hole near another."""
    sizes = near(polygon, place, 0.5, edge_length=2.0, grading=20.0)
    assert len(sizes) >= 2
    assert sizes == pytest.approx(1 / 3, rel=0.2)
    assert near(polygon, place, 0.9, edge_length=2.0, grading=3.0) == pytest.approx(2 / 3, rel=0.35), "no finer"


@settings(max_examples=40, deadline=None)
@given(
    width=st.floats(0.05, 5.9), edge_length=st.floats(0.5, 2.0), angle=st.floats(0, 7),
    scale=st.sampled_from([1e-5, 1.0, 1e5]),
)  # fmt: skip
def test_gaps_are_as_wide_as_they_are(width: float, edge_length: float, angle: float, scale: float) -> None:
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    rings = [scale * box(0, 0, 60, 30) @ turn, scale * box(20, width, 20, 10)[::-1] @ turn]
    found = gaps([rings], edge_length * scale, 0.1 * edge_length * scale)
    if width < 3 * edge_length * (1 - 1e-9):
        np.testing.assert_allclose(found[:, 2], width * scale / 3, rtol=1e-6)
    elif width > 3 * edge_length * (1 + 1e-9):
        assert len(found) == 0


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1000), m=st.integers(1, 60), slope=st.floats(0.05, 1.0))
def test_cones_are_the_least_of_all(seed: int, m: int, slope: float) -> None:
    random = np.random.default_rng(seed)
    sources = np.column_stack([random.uniform(-1, 1, (m, 2)), np.exp(random.uniform(-4, 0, m))])
    places = random.uniform(-1, 1, (50, 2))
    each = sources[:, 2] + slope * np.linalg.norm(places[:, None] - sources[None, :, :2], axis=2)
    least = np.minimum(each.min(axis=1), 0.5)
    found = Cones(sources, slope)(places, np.full(50, 0.5))
    assert (found >= least * (1 - 1e-12)).all()
    assert (found <= least * 1.0501).all()
    at_sources = np.linalg.norm(sources[:, None, :2] - sources[None, :, :2], axis=2)
    grown = (sources[:, 2] + slope * at_sources).min(axis=1)
    np.testing.assert_allclose(Cones(sources, slope)(sources[:, :2], sources[:, 2]), grown, rtol=0.0501)


@settings(max_examples=60)
@given(seed=st.integers(0, 1000), m=st.integers(2, 40), pieces=st.integers(1, 200))
def test_splits_are_even_in_the_integral(seed: int, m: int, pieces: int) -> None:
    random = np.random.default_rng(seed)
    at = np.append(0.0, np.cumsum(random.uniform(0.0, 1.0, m - 1) * (random.random(m - 1) < 0.8) + 1e-9))
    h = random.choice([0.1, 0.1, 0.3, 1.0], m)
    sizes = Sizes(at, h)
    stations = np.concatenate([[0.0], sizes.split(pieces), at[-1:]])
    assert (np.diff(stations) >= 0.0).all()
    fine = np.unique(np.concatenate([np.linspace(0.0, at[-1], 40_001), at]))
    measure = np.append(0.0, np.cumsum(np.diff(fine) / np.interp(0.5 * (fine[1:] + fine[:-1]), at, h)))
    assert sizes.measure == pytest.approx(measure[-1], rel=1e-4)
    np.testing.assert_allclose(
        np.diff(np.interp(stations, fine, measure)), measure[-1] / pieces, rtol=1e-3, atol=1e-4 * measure[-1]
    )


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 500), grading=st.floats(1.5, 20.0))
def test_neighbours_are_alike_on_long_sides(seed: int, grading: float) -> None:
    """No two neighbours on a side of many segments differ by much more than the growth."""
    random = np.random.default_rng(seed)
    notch = random.uniform(0.3, 3.0, 2)
    ring = np.array([[0, 0], [30, 0], [30, 20], [15 + notch[0], 20], [15 + notch[0], 20 - notch[1]],
                     [15, 20 - notch[1]], [15, 20], [0, 20]])  # fmt: skip
    (domain,) = from_object(ring, edge_length=1.0, grading=grading)
    low = np.sort(domain.points[domain.points[:, 1] == 20.0][:, 0])
    left = np.diff(low[low <= 15.0])
    assert np.maximum(left[1:] / left[:-1], left[:-1] / left[1:]).max() < GROWTH**1.6
