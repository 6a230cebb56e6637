"""Arcs keep their shape when an outline is split; what is none, corners and small zigzags, is left alone."""

from __future__ import annotations

from pathlib import Path

import ezdxf
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.domains.load import from_object, load
from envs.polygons.sizing import GROWTH
from envs.types import Domain, DomainError, Floats

#: Sizes are met up to whole numbers of segments, and up to the odd one.
WHOLE = 1.3


def circle(vertices: int, radius: float = 1.0, centre: tuple[float, float] = (0.0, 0.0)) -> Floats:
    """A regular polygon."""
    t = 2 * np.pi * np.arange(vertices) / vertices
    return np.array(centre) + radius * np.stack([np.cos(t), np.sin(t)], axis=1)


def naca(points: int) -> Floats:
    """A symmetrical airfoil of 12 % thickness, its points dense at the nose."""
    x = 0.5 * (1 - np.cos(np.linspace(0, np.pi, points // 2 + 1)))
    y = 0.6 * (0.2969 * np.sqrt(x) - 0.1260 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
    return np.concatenate([np.stack([x, y], axis=1), np.stack([x, -y], axis=1)[-2:0:-1]])


def lengths(domain: Domain) -> Floats:
    """(s,) of its boundary segments."""
    ends = domain.points[domain.segments]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


def inner(domain: Domain, outside: float) -> Floats:
    """The boundary points nearer to the origin than ``outside``."""
    return domain.points[np.unique(domain.segments)][np.hypot(*domain.points[np.unique(domain.segments)].T) < outside]


@pytest.mark.slow
@settings(max_examples=80, deadline=None)
@given(
    vertices=st.integers(19, 2000), curvature=st.floats(6.0, 64.0), angle=st.floats(0, 7),
    scale=st.sampled_from([1e-6, 1.0, 1e6]),
)  # fmt: skip
def test_a_circle_has_the_segments_of_a_full_turn(vertices: int, curvature: float, angle: float, scale: float) -> None:
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    ring = scale * circle(vertices) @ turn
    (domain,) = from_object(ring, edge_length=10.0 * scale, curvature=curvature, fix_parity=True)
    count = len(domain.segments)
    if 360.0 / vertices > min(20.0, 360.0 / curvature) * (1 - 1e-6):
        assert count in (vertices, vertices + 1), "its vertices are corners"
    else:
        # A coarse polygon looks rounder or flatter than its circle by a part of a segment.
        assert 0.93 * min(curvature, vertices) - 1 <= count <= max(1.1 * curvature, 4) + 2
    bound = 0.5 * np.tan(np.pi / curvature) * lengths(domain).max()
    assert domain.deviation <= bound * (1 + 1e-6)
    off = shapely.hausdorff_distance(shapely.LinearRing(ring), shapely.LinearRing(domain.points[domain.ring]), 0.01)
    assert domain.deviation <= off * (1 + 1e-9) + 1e-9 * scale


@pytest.mark.parametrize("vertices", [3, 4, 5, 6, 8, 12, 16, 17])
def test_what_has_corners_is_not_rounded(vertices: int) -> None:
    plate = [4.0 * circle(4), circle(vertices)]
    (domain,) = from_object(plate, edge_length=10.0)
    kept = {tuple(point) for point in inner(domain, 2.0).tolist()}
    assert {tuple(point) for point in circle(vertices).tolist()} <= kept
    assert len(kept) <= vertices + 1
    assert domain.deviation == 0.0


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 1000), n=st.integers(30, 400), edge_length=st.floats(0.05, 5.0), curvature=st.floats(4, 64))
def test_no_segment_is_far_from_the_outline(seed: int, n: int, edge_length: float, curvature: float) -> None:
    random = np.random.default_rng(seed)
    t = 2 * np.pi * np.arange(n) / n
    r = 1 + sum(random.uniform(0, 0.2) * np.cos(k * t + random.uniform(0, 6)) for k in (2, 3, 5))
    ring = np.stack([r * np.cos(t), r * np.sin(t)], axis=1)
    (domain,) = from_object(ring, edge_length=edge_length, curvature=curvature)
    outline = shapely.LinearRing(domain.points[domain.ring])
    nearest = shapely.STRtree(shapely.linestrings(domain.points[domain.segments])).nearest(shapely.points(ring))
    share = shapely.distance(outline, shapely.points(ring)) / lengths(domain)[nearest]
    # The one segment more of an odd total moves the others.
    assert share.max() <= 0.5 * np.tan(np.pi / curvature) * 1.2 + 1e-12
    assert domain.deviation == pytest.approx(shapely.distance(outline, shapely.points(ring)).max(), abs=1e-8)


def test_an_airfoil_keeps_its_nose() -> None:
    far = np.array([[-5.0, -5], [8, -5], [8, 5], [-5, 5]])
    (domain,) = from_object([far, naca(200)], edge_length=0.5)
    nose = inner(domain, 0.02)
    radius = 1.1019 * 0.12**2
    assert len(nose) >= 5
    assert domain.deviation < 0.1 * radius
    assert abs(130.0 - domain.area - shapely.Polygon(naca(200)).area) < 0.02 * shapely.Polygon(naca(200)).area
    (square,) = from_object([far, naca(200)], edge_length=0.5, curvature=4.0)
    assert len(inner(square, 0.02)) < len(nose)


def test_arcs_of_a_drawing_are_arcs(tmp_path: Path) -> None:
    drawing = ezdxf.new()
    space = drawing.modelspace()
    space.add_lwpolyline([(0, 0), (20, 0), (20, 10), (0, 10)], close=True)
    space.add_circle((5, 5), 0.5)
    # A slot: half circles between straight sides.
    space.add_lwpolyline([(12, 4, 0), (15, 4, 1), (15, 6, 0), (12, 6, 1)], format="xyb", close=True)
    path = tmp_path / "plate.dxf"
    drawing.saveas(path)
    domain = load(path, edge_length=4.0)
    points = domain.points[np.unique(domain.segments)]
    on_circle = np.abs(np.hypot(*(points - [5, 5]).T) - 0.5) < 1e-3
    assert on_circle.sum() in (16, 17)
    on_slot = (np.abs(points - [13.5, 5]) < [3, 1.1]).all(axis=1)
    assert on_slot.sum() >= 16
    assert domain.deviation < 0.05 * lengths(domain).max()


def test_sizes_grow_away_from_an_arc() -> None:
    """The side beside a small hole is finer than the others, and neighbours are alike."""
    (domain,) = from_object([[[0, 0], [10, 0], [10, 10], [0, 10]], circle(64, 0.2, (5.0, 0.5))], edge_length=1.0)
    size, ends = lengths(domain), domain.points[domain.segments]
    middle = ends.mean(axis=1)
    low = (middle[:, 1] == 0.0) & (np.abs(middle[:, 0] - 5.0) < 0.5)
    assert size[low].max() < 0.25
    assert size[middle[:, 1] == 10.0] == pytest.approx(1.0, rel=0.1)
    side = np.sort(middle[middle[:, 1] == 0.0][:, 0])
    steps = np.diff(side)
    assert np.maximum(steps[1:] / steps[:-1], steps[:-1] / steps[1:]).max() < GROWTH**1.5


@pytest.mark.parametrize("amplitude", [0.002, 0.008])
def test_small_zigzags_are_no_arcs(amplitude: float) -> None:
    x = np.linspace(0.0, 10.0, 201)
    side = np.stack([x, amplitude * (-1.0) ** np.arange(201) / 2], axis=1)
    (domain,) = from_object(np.concatenate([side, [[10, 5], [0, 5]]]), edge_length=0.5)
    assert len(domain.segments) == pytest.approx(60, abs=4)


@pytest.mark.parametrize("curvature", [3.9, 181.0, float("nan"), -1.0])
def test_a_curvature_that_is_none(curvature: float) -> None:
    with pytest.raises(
        DomainError,
        match=r"^polygon: curvature .*; give --curvature \(curvature= in Python\) the segments of a full turn",
    ):
        from_object(circle(40), edge_length=1.0, curvature=curvature)
