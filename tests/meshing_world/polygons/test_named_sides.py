"""Names survive however a boundary is split: what lies on a line is called by it, whole and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.domains.load import object_geometry
from envs.polygons.drawing import Drawing, Line
from envs.types import DomainError, Floats

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def arc(radius: float, start: float, end: float, count: int = 91) -> Floats:
    t = np.linspace(start, end, count)
    return radius * np.stack([np.cos(t), np.sin(t)], axis=1)


def length(points: Floats, segments: np.ndarray) -> float:
    return float(np.linalg.norm(points[segments[:, 1]] - points[segments[:, 0]], axis=1).sum())


@given(
    a=st.floats(0.0, 0.45), b=st.floats(0.55, 1.0), side=st.integers(0, 3), h=st.floats(0.03, 0.4),
    angle=st.floats(0.0, 6.3),
)  # fmt: skip
@settings(deadline=None, max_examples=60)
def test_a_name_has_exactly_its_stretch_of_a_side(a: float, b: float, side: int, h: float, angle: float) -> None:
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    ring = 7.0 * SQUARE @ turn
    start, end = ring[side], ring[(side + 1) % 4]
    line = Line(np.array([start + a * (end - start), start + b * (end - start)]), "inlet")
    (region,) = object_geometry(Drawing([[ring]], lines=[line]), edge_length=7.0 * h).regions
    assert list(region.sides) == ["inlet"]
    assert length(region.domain.points, region.sides["inlet"]) == pytest.approx(7.0 * (b - a), rel=1e-5)


@given(radius=st.floats(0.15, 0.6), h=st.floats(0.02, 0.3))
@settings(deadline=None, max_examples=40)
def test_an_arc_and_its_chord_have_their_own_names(radius: float, h: float) -> None:
    half = arc(radius, 0.0, np.pi)
    chord = np.array([[-radius, 0.0], [radius, 0.0]])
    (region,) = object_geometry(
        Drawing([[half]], lines=[Line(half, "round"), Line(chord, "flat")]), edge_length=h, curvature=8
    ).regions  # fmt: skip
    assert sum(map(len, region.sides.values())) == len(region.domain.segments)
    assert length(region.domain.points, region.sides["flat"]) == pytest.approx(2 * radius, rel=1e-9)
    assert 2.8 * radius < length(region.domain.points, region.sides["round"]) <= np.pi * radius


def test_regions_share_the_segments_of_their_interface() -> None:
    left, right = SQUARE, SQUARE + np.array([1.0, 0.25])
    geometry = object_geometry(Drawing([[left], [right]], ["steel", "copper"]), edge_length=0.1)
    steel, copper = geometry.regions
    assert [region.name for region in geometry.regions] == ["steel", "copper"]
    shared = set(map(tuple, steel.domain.points.tolist())) & set(map(tuple, copper.domain.points.tolist()))
    on_side = sorted(y for x, y in shared)
    assert on_side[0] == 0.25
    assert on_side[-1] == 1.0
    assert len(on_side) >= 8


def test_a_box_offers_the_names_of_its_sides_and_holes() -> None:
    plate = np.concatenate([arc(0.3, np.pi / 2, 0.0), [[2.0, 0.0], [2.0, 1.0], [0.0, 1.0]]])
    hole = arc(0.1, 0.0, 2 * np.pi)[:-1] + np.array([1.2, 0.5])
    (region,) = object_geometry([plate, hole], edge_length=0.1).regions
    assert set(region.sides) == {"left", "right", "bottom", "top", "arc_1", "hole_1"}
    points = region.domain.points
    np.testing.assert_allclose(points[region.sides["left"], 0], 0.0, atol=1e-15)
    assert (points[region.sides["top"], 1] == 1.0).all()
    radii = np.linalg.norm(points[region.sides["arc_1"]], axis=-1)
    np.testing.assert_allclose(radii, 0.3, rtol=1e-3)
    assert sum(map(len, region.sides.values())) == len(region.domain.segments)


def test_a_disc_is_one_arc_and_a_turned_box_offers_nothing() -> None:
    (disc,) = object_geometry(arc(1.0, 0.0, 2 * np.pi)[:-1], edge_length=0.2).regions
    assert list(disc.sides) == ["arc_1"]
    assert len(disc.sides["arc_1"]) == len(disc.domain.segments)
    turned = SQUARE @ np.array([[0.8, 0.6], [-0.6, 0.8]])
    (region,) = object_geometry(turned, edge_length=0.2).regions
    assert region.sides == {}


def test_a_line_outside_is_told_with_its_place_unless_it_is_optional() -> None:
    outside = np.array([[2.0, 2.0], [3.0, 2.5]])
    with pytest.raises(DomainError, match=r"box: the line 'weld' from \(2\.0, 2\.0\) to \(3\.0, 2\.5\) is not inside"):
        object_geometry(Drawing([[SQUARE]], lines=[Line(outside, "weld")]), "box", edge_length=0.2)
    (region,) = object_geometry(
        Drawing([[SQUARE]], lines=[Line(outside, "axis", optional=True)]), edge_length=0.2
    ).regions  # fmt: skip
    assert set(region.sides) == {"left", "right", "bottom", "top"}  # as if nothing had been named


def test_given_vertices_stay_alone_without_an_edge_length() -> None:
    ring = np.array([[0, 0], [0.5, 0], [1, 0], [1, 1], [0.5, 1], [0, 1]], dtype=np.float64)
    (region,) = object_geometry(Drawing([[ring]], lines=[Line(ring[:2], "inlet")])).regions
    assert len(region.domain.points) == 6
    np.testing.assert_array_equal(region.domain.points[region.sides["inlet"][0]], ring[:2])
