"""Halves: what is cut off at an axis is the other half, and what is not symmetric is told with its place."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.polygons.axis import Axis, axis_of
from envs.polygons.halves import halves
from envs.types import DomainError, Floats

SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=float)


def rings_of(shape: shapely.Polygon) -> list[Floats]:
    return [np.asarray(ring.coords)[:-1] for ring in (shape.exterior, *shape.interiors)]


def shape_of(rings: list[Floats]) -> shapely.Polygon:
    return shapely.Polygon(rings[0], rings[1:])


def symmetric(seed: int, axis: Axis) -> shapely.Polygon:
    """A comb whose teeth, holes and slots lie on both sides of an axis, or across it."""
    rng = np.random.default_rng(seed)
    parts = [shapely.box(-5.0, rng.uniform(0.5, 2.0), 5.0, 2.5)]
    for x in np.arange(-4.5, 5.0, 1.5)[rng.random(7) < 0.6]:
        parts.append(shapely.box(x, -1.0, x + rng.uniform(0.3, 1.0), 2.2))
    upper = shapely.union_all(parts)
    holes = [shapely.Point(x, rng.uniform(0.0, 2.0)).buffer(0.15, quad_segs=3) for x in (-4.0, -1.0, 1.0, 3.0)]
    upper = shapely.intersection(shapely.difference(upper, shapely.union_all(holes)), shapely.box(-9.0, 0.0, 9.0, 9.0))
    frame = np.array([axis.along, axis.left])
    placed = shapely.transform(upper, lambda p: axis.start + p @ frame)
    both = shapely.union(placed, shapely.transform(placed, axis.mirrored), grid_size=1e-7)
    return max(shapely.get_parts(both), key=lambda part: part.area)


AXES = st.one_of(
    st.sampled_from(["x", "y"]),
    st.tuples(st.floats(-9, 9), st.floats(-9, 9), st.floats(10, 20), st.floats(-20, 20)).map(
        lambda numbers: ",".join(map(repr, numbers))
    ),
)


@settings(max_examples=80)
@given(seed=st.integers(0, 10_000), given_axis=AXES, turned=st.booleans())
def test_the_half_and_its_mirror_image_are_the_whole(seed: int, given_axis: str, turned: bool) -> None:
    axis = axis_of(given_axis, "test")
    whole = symmetric(seed, axis)
    rings = [ring[::-1] if turned else ring for ring in rings_of(whole)]
    (half,) = halves([rings], axis, "comb")
    assert (half.of, half.image) == (0, 0)
    part = shape_of(half.rings)
    assert part.is_valid
    assert part.area == pytest.approx(whole.area / 2.0, rel=1e-6)
    again = shapely.union(part, shapely.transform(part, axis.mirrored), grid_size=1e-7)
    assert shapely.symmetric_difference(again, whole).area < 1e-4
    given_points = {tuple(point) for ring in rings for point in ring.tolist()}
    for ring in half.rings:
        off = axis.offsets(ring)
        assert off.min() > -1e-12
        new = [i for i, point in enumerate(ring.tolist()) if tuple(point) not in given_points]
        assert np.abs(off[new]).max(initial=0.0) < 1e-12, "all but what lies on the axis as given"
        assert (off[new] == 0.0).all() or given_axis not in "xy", "on a coordinate axis exactly"


def test_a_ring_around_the_axis_becomes_an_arch() -> None:
    (arch,) = halves([[SQUARE, 0.5 * SQUARE]], axis_of("x", "test"), "frame")
    assert [ring.tolist() for ring in arch.rings] == [
        [[1, 0], [1, 1], [-1, 1], [-1, 0], [-0.5, 0], [-0.5, 0.5], [0.5, 0.5], [0.5, 0]]
    ]
    slots = shapely.union(shapely.box(-0.9, 0.6, 0.9, 0.9), shapely.box(-0.9, -0.9, 0.9, -0.6))
    frame = shapely.difference(shape_of([SQUARE, 0.5 * SQUARE]), slots)
    (slotted,) = halves([rings_of(frame)], axis_of("x", "test"), "frame")
    assert len(slotted.rings) == 2, "a hole away from the axis stays one"
    assert shape_of(slotted.rings).area == pytest.approx(frame.area / 2.0)


def test_several_polygons_are_symmetric_together() -> None:
    apart = np.array([3.0, 0.0])
    left, right = SQUARE - apart, SQUARE + apart
    found = halves([[left], [SQUARE], [right]], axis_of("y", "test"), "three")
    assert [(half.of, half.image) for half in found] == [(1, 1), (2, 0)]
    np.testing.assert_array_equal(found[1].rings[0], right)
    assert shape_of(found[0].rings).area == 2.0
    rings = [k * SQUARE for k in range(1, 6)]
    nested = [[b, a] for a, b in zip(rings[:-1], rings[1:], strict=True)]
    assert [(half.of, half.image) for half in halves(nested, axis_of("x", "test"), "around")] == [
        (i, i) for i in range(4)
    ]


@settings(max_examples=40)
@given(seed=st.integers(0, 1000), share=st.floats(3e-6, 1e-2))
def test_where_it_is_not_symmetric_is_told(seed: int, share: float) -> None:
    axis = axis_of("x", "test")
    rings = rings_of(symmetric(seed, axis))
    rng = np.random.default_rng(seed)
    ring = rings[0].copy()
    moved = int(np.abs(ring[:, 1]).argmax() if seed % 2 else rng.choice(np.flatnonzero(np.abs(ring[:, 1]) > 2.4)))
    diameter = float(np.hypot(*np.ptp(ring, axis=0)))
    ring[moved] *= 1.0 + share * diameter
    with pytest.raises(DomainError) as told:
        halves([[ring, *rings[1:]]], axis, "comb")
    message = str(told.value)
    assert message.startswith("comb: not symmetric to the axis 0,0,1,0: (")
    x, y = (float(word) for word in message.partition("(")[2].partition(")")[0].split(","))
    assert min(np.hypot(x - ring[moved, 0], abs(y) - abs(ring[moved, 1])), 9) < 1e-6 + 0.1 * share * diameter
    assert "\n" not in message
    halves([[ring, *rings[1:]]], axis, "comb", tolerance=10.0 * share * diameter)


def test_the_axis_that_would_do_is_offered() -> None:
    with pytest.raises(DomainError, match=r"it is to 0,0\.5,1,0\.5: give that axis$"):
        halves([[SQUARE + 0.5]], axis_of("x", "test"), "square")
    with pytest.raises(DomainError, match=r"give another axis, or mesh it whole$"):
        halves([[np.array([[0.0, 0.0], [3.0, 0.0], [1.0, 2.0]])]], axis_of("x", "test"), "triangle")
    (half,) = halves([[SQUARE + 0.5]], axis_of("0,0.5,1,0.5", "test"), "square")
    assert shape_of(half.rings).bounds == (-0.5, 0.5, 1.5, 1.5)


@pytest.mark.parametrize("given_axis", ["z", "", "1,2,3", "1,2,1,2", "0,0,nan,1", "0,0,1e999,1", [[0, 0]], None, "x,y"])
def test_what_is_no_axis_is_told(given_axis: object) -> None:
    with pytest.raises(DomainError, match=r"^part: .* is no axis; give x, y, or x0,y0,x1,y1, two different points$"):
        axis_of(given_axis, "part")  # type: ignore[arg-type]


def test_the_named_axes_keep_what_is_positive() -> None:
    assert axis_of("x", "t").offsets(np.array([[3.0, 2.0]])) == 2.0
    assert axis_of(" Y ", "t").offsets(np.array([[3.0, 2.0]])) == 3.0
    np.testing.assert_array_equal(axis_of("y", "t").mirrored(np.array([[0.1, 0.3]])), [[-0.1, 0.3]])
