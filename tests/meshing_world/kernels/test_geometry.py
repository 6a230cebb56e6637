"""Plane geometry against shapely and the textbook."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

from envs.kernels.geometry import (
    TWO_PI,
    angle,
    distance2_to_segment,
    ray_hit,
    segments_touch,
    signed_angle,
    signed_angles,
)

Segment = tuple[float, float, float, float]

#: Rounded, because shapely's distances are not made for subnormal numbers.
coordinate = st.floats(-10.0, 10.0).map(lambda value: round(value, 7))
vector = st.tuples(coordinate, coordinate).filter(lambda v: math.hypot(*v) > 1e-3)
segment = st.tuples(coordinate, coordinate, coordinate, coordinate)
#: Few enough places that segments overlap, share an end, lie on one line or shrink to a point.
lattice = st.tuples(*[st.integers(-2, 2).map(float)] * 4)


def turned(v: tuple[float, float], by: float, scale: float = 1.0) -> tuple[float, float]:
    z = scale * complex(*v) * cmath.rect(1.0, by)
    return z.real, z.imag


def line(s: Segment) -> shapely.Geometry:
    a, b = s[:2], s[2:]
    return shapely.Point(a) if a == b else shapely.LineString([a, b])


def around(difference: float) -> float:
    """The distance of an angle from the nearest multiple of a full turn."""
    return abs((difference + math.pi) % TWO_PI - math.pi)


@given(vector, vector)
def test_angle_is_the_difference_of_directions(u: tuple[float, float], v: tuple[float, float]) -> None:
    turn = angle(*u, *v)
    assert 0.0 <= turn <= TWO_PI
    assert around(turn - (math.atan2(v[1], v[0]) - math.atan2(u[1], u[0]))) < 1e-9
    assert around(turn - signed_angle(*u, *v)) < 1e-12
    assert abs(signed_angle(*u, *v)) <= math.pi


@given(st.lists(st.tuples(vector, vector), min_size=1, max_size=5))
def test_signed_angles_are_signed_angle_of_each_pair(
    pairs: list[tuple[tuple[float, float], tuple[float, float]]],
) -> None:
    u, v = np.moveaxis(np.array(pairs), 1, 0)
    expected = [signed_angle(*a, *b) for a, b in pairs]
    np.testing.assert_array_max_ulp(signed_angles(u, v), np.array(expected), maxulp=2)
    np.testing.assert_array_equal(signed_angles(u[:, None], v[None])[range(len(u)), range(len(u))], signed_angles(u, v))


@given(vector, vector, st.floats(-7.0, 7.0), st.floats(1e-6, 1e6))
def test_angle_ignores_rotation_and_scale(
    u: tuple[float, float], v: tuple[float, float], by: float, scale: float
) -> None:
    turn = angle(*u, *v)
    assert around(angle(*turned(u, by), *turned(v, by, scale)) - turn) < 1e-9
    assert around(angle(*v, *u) + turn) < 1e-12
    mirrored = angle(u[0], -u[1], v[0], -v[1])
    assert around(mirrored + turn) < 1e-12


@given(st.floats(0.0, 6.28), vector)
def test_angle_measures_the_turn(turn: float, u: tuple[float, float]) -> None:
    assert around(angle(*u, *turned(u, turn)) - turn) < 1e-9


@given(segment, segment, st.sampled_from([1e-9, 1e-3, 0.3]))
def test_segments_touch_within_the_tolerance(s: Segment, t: Segment, tol: float) -> None:
    distance = shapely.distance(line(s), line(t))
    assume(abs(distance - tol) > 1e-12)
    touch = segments_touch(*s, *t, tol)
    if distance < tol:
        assert touch
    elif distance > 2.0 * tol + 1e-12:
        assert not touch


@given(lattice, lattice)
def test_segments_that_touch_in_every_degenerate_way(s: Segment, t: Segment) -> None:
    """On a lattice segments meet or stay 1e-2 apart: the answer is exact, and the same however they are named."""
    expected = shapely.distance(line(s), line(t)) < 1e-6
    flipped = (*t[2:], *t[:2])
    for p, q in ((s, t), (t, s), (s, flipped), (flipped, s)):
        assert segments_touch(*p, *q, 1e-9) == expected


@pytest.mark.parametrize("turn", np.linspace(0.0, 3.0, 7))
@pytest.mark.parametrize(
    ("t", "expected"),
    [
        ((1.0, 0.0, 2.0, 1.0), True),  # shares an end
        ((0.5, 0.0, 0.5, 1.0), True),  # a T
        ((0.25, 0.0, 0.75, 0.0), True),  # lies on it
        ((0.5, 0.0, 2.0, 0.0), True),  # overlaps it
        ((1.0, 0.0, 0.0, 0.0), True),  # runs back on it
        ((1.1, 0.0, 2.0, 0.0), False),  # on one line, apart
        ((0.0, 1e-6, 1.0, 1e-6), False),  # beside it
        ((0.5, 1e-6, 0.5, 1.0), False),  # all but a T
        ((0.5, 1e-10, 0.5, 1.0), True),  # a T up to the tolerance
    ],
)
def test_touching_survives_rotation(turn: float, t: Segment, expected: bool) -> None:
    s = (*turned((0.0, 0.0), turn), *turned((1.0, 0.0), turn))
    t = (*turned(t[:2], turn), *turned(t[2:], turn))
    assert segments_touch(*s, *t, 1e-9) == segments_touch(*t, *s, 1e-9) == expected


@given(coordinate, coordinate, segment | lattice)
def test_distance_to_a_segment(x: float, y: float, s: Segment) -> None:
    assert math.sqrt(distance2_to_segment(x, y, *s)) == pytest.approx(
        shapely.distance(shapely.Point(x, y), line(s)), abs=1e-9
    )


@given(coordinate, coordinate, st.floats(0.0, 6.28), segment)
def test_ray_meets_what_shapely_says_it_meets(x: float, y: float, direction: float, s: Segment) -> None:
    dx, dy = math.cos(direction), math.sin(direction)
    ray = shapely.LineString([(x, y), (x + 100.0 * dx, y + 100.0 * dy)])
    t = ray_hit(x, y, dx, dy, *s)
    if math.isfinite(t):
        assert t >= 0.0
        assert shapely.distance(line(s), shapely.Point(x + t * dx, y + t * dy)) < 1e-6
        assert shapely.distance(line(s), ray) < 1e-6
    else:
        # Near an end rounding may decide; through the middle it may not.
        middle = tuple(0.99 * s[i] + 0.01 * s[(i + 2) % 4] for i in range(4))
        parallel = abs(dx * (s[3] - s[1]) - dy * (s[2] - s[0])) < 1e-6
        assert parallel or not shapely.intersects(line(middle), ray)


def test_a_ray_along_a_segment_meets_nothing() -> None:
    assert ray_hit(0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 2.0, 0.0) == math.inf
    assert ray_hit(0.0, 0.0, 1.0, 0.0, -1.0, -1.0, -1.0, 1.0) == math.inf
    assert ray_hit(0.0, 0.0, 1.0, 0.0, 3.0, -1.0, 3.0, 1.0) == 3.0
