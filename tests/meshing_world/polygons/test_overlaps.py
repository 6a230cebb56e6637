"""Polygons beside each other: overlaps and slits are found wherever they are, and shared sides are neither."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

from envs.polygons.overlaps import check_overlaps, gaps_between, overlaps
from envs.types import DomainError, Floats

Rings = list[Floats]


def box(x: float, y: float, width: float, height: float) -> Rings:
    """A rectangle."""
    return [np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]], dtype=np.float64)]


def turned(polygons: list[Rings], angle: float) -> list[Rings]:
    """Polygons turned about the origin."""
    matrix = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return [[ring @ matrix.T for ring in rings] for rings in polygons]


@given(
    dx=st.floats(-3, 3), dy=st.floats(-3, 3), angle=st.floats(0, 6), scale=st.sampled_from([1e-6, 1.0, 1e6]),
)  # fmt: skip
def test_overlaps_are_those_of_areas_in_common(dx: float, dy: float, angle: float, scale: float) -> None:
    pair = turned([box(0, 0, 2, 1), box(dx, dy, 2, 1)], angle)
    pair = [[scale * ring for ring in rings] for rings in pair]
    exact = max(0.0, 2 - abs(dx)) * max(0.0, 1 - abs(dy))
    assume(exact == 0.0 or exact > 1e-5)
    found = list(overlaps(pair, 1e-6 * scale))
    assert len(found) == (exact > 0)
    for i, j, common in found:
        assert (i, j) == (0, 1)
        assert common.area == pytest.approx(exact * scale**2, rel=1e-6)


def test_the_line_names_place_and_area() -> None:
    with pytest.raises(DomainError, match=r"^b: overlaps polygon 0 at \(.*\), by an area of 1; cut it off") as raised:
        check_overlaps([box(0, 0, 2, 2), box(1, 1, 2, 2)], ["a", "b"], 1e-9)
    x, y = map(float, str(raised.value).partition("(")[2].partition(")")[0].split(","))
    assert 1 < x < 2
    assert 1 < y < 2


@pytest.mark.parametrize(
    ("polygons", "pairs"),
    [
        ([box(0, 0, 1, 1), box(1, 0, 1, 1), box(0, 1, 2, 1)], []),
        ([box(0, 0, 1, 1), box(1, 1, 1, 1)], []),
        ([box(0, 0, 1, 1), box(0, 0, 1, 1)], [(0, 1)]),
        ([box(0, 0, 4, 4), box(1, 1, 1, 1)], [(0, 1)]),
        ([[*box(0, 0, 4, 4), *box(1, 1, 1, 1)], box(1, 1, 1, 1)], []),
        ([box(2, 0, 2, 1), box(8, 0, 1, 1), box(3, 0, 2, 1), box(1, 0, 1.5, 1)], [(0, 2), (0, 3)]),
    ],
    ids=["shared sides", "shared corner", "copies", "one inside", "one in a hole", "several"],
)
def test_what_overlaps(polygons: list[Rings], pairs: list[tuple[int, int]]) -> None:
    assert [(i, j) for i, j, _ in overlaps(polygons, 1e-9)] == pairs


@given(angle=st.floats(0, 6), off=st.floats(-1e-12, 1e-12))
def test_rounding_is_no_overlap_and_no_gap(angle: float, off: float) -> None:
    pair = turned([box(0, 0, 1, 3), box(1 + off, 1, 1, 1)], angle)
    check_overlaps(pair, ["a", "b"], 1e-9)
    assert gaps_between(pair, 1e-3) == []


@given(width=st.floats(1e-5, 0.2), angle=st.floats(0, 6), tolerance=st.floats(1e-6, 0.2))
def test_gaps_up_to_the_tolerance_are_found(width: float, angle: float, tolerance: float) -> None:
    assume(abs(width - tolerance) > 1e-9)
    pair = turned([box(0, 0, 1, 3), box(1 + width, 1, 1, 1)], angle)
    found = gaps_between(pair, tolerance)
    assert len(found) == (width < tolerance)
    for gap in found:
        assert (gap.first, gap.second) == (0, 1)
        assert gap.width == pytest.approx(width, rel=1e-6)
        assert all(shapely.Polygon(rings[0]).distance(shapely.Point(gap.x, gap.y)) <= width * 1.01 for rings in pair)


def test_of_a_wedge_the_widest_place_is_told() -> None:
    slanted = [np.array([[1.0, 0.0], [3.0, 0.0], [3.0, 2.0], [1.05, 2.0]])]
    (gap,) = gaps_between([box(0, 0, 1, 2), slanted, box(9, 9, 1, 1)], 0.1)
    assert (gap.x, gap.y) == (1.05, 2.0)
    assert gap.width == pytest.approx(0.05)
