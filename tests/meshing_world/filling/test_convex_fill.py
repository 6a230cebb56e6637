"""Any even ring is filled: strictly convex elements, the ring's edges whole, nothing uncovered, and within bounds."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
from hard_rings import FAMILIES, Ring, drawn, plain, polar
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.filling.chords import by_chords
from envs.filling.convex_fill import Fill, FillError, fill
from envs.filling.diagonals import by_diagonals
from envs.filling.fitness import fitnesses
from envs.filling.partition import partition
from envs.filling.smoothing import smooth, stars_of
from envs.filling.triangulation import triangulate
from envs.kernels.orientation import turns_left
from envs.mesh import Mesh
from envs.quality import element_quality
from envs.types import Floats, Ints


def turns(points: Floats, polygons: Ints) -> list[int]:
    """The exact sign of the turn at every corner of polygons, in rational arithmetic where rounding leaves a doubt."""
    a, b, c = (points[np.roll(polygons, shift, axis=1)] for shift in (1, 0, -1))
    u, v = b - a, c - b
    cross = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    size = np.abs(u[..., 0] * v[..., 1]) + np.abs(u[..., 1] * v[..., 0])
    signs = np.sign(cross).astype(int)
    for i, k in np.argwhere(np.abs(cross) <= 1e-14 * size).tolist():
        signs[i, k] = exact_turn(a[i, k].tolist(), b[i, k].tolist(), c[i, k].tolist())
    return signs.ravel().tolist()


def exact_turn(a: list[float], b: list[float], c: list[float]) -> int:
    """The sign of the turn a -> b -> c in rational arithmetic."""
    (ax, ay), (bx, by), (cx, cy) = ((Fraction(x), Fraction(y)) for x, y in (a, b, c))
    cross = (bx - ax) * (cy - by) - (by - ay) * (cx - bx)
    return (cross > 0) - (cross < 0)


def area(vertices: Floats) -> float:
    """Shoelace area of an (n, 2) ring."""
    x, y = (vertices - vertices[0]).T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def walked(ring: Ints) -> list[tuple[int, int]]:
    """The directed edges of a ring."""
    return list(zip(ring.tolist(), np.roll(ring, -1).tolist(), strict=True))


def assert_filled(points: Floats, ring: Ints, filled: Fill) -> None:
    """What holds of every filling."""
    n, m = len(ring), len(filled.quads)
    assert filled.points.dtype == np.float64
    assert filled.quads.dtype == np.int64
    np.testing.assert_array_equal(filled.points[: len(points)], points)
    assert set(turns(filled.points, filled.quads)) == {1}
    # Every directed edge once: the ring's, and both directions of all others.
    edges = [edge for quad in filled.quads for edge in walked(quad)]
    assert len(set(edges)) == len(edges)
    outside = {(b, a) for a, b in edges} - set(edges)
    assert {(b, a) for a, b in outside} == {(a, b) for a, b in walked(ring) if (b, a) not in set(walked(ring))}
    assert set(walked(ring)) <= set(edges)
    mesh = Mesh("fill", filled.points, filled.quads, np.array([(a, b) for b, a in outside]), complete=True)
    assert mesh.defects(area(points[ring])) == []
    # Euler: a disc, whose seams' two sides count as different edges.
    assert m == n // 2 - 1 + len(filled.points) - len(points)
    assert m <= 4 * (n - 2)


@pytest.mark.slow
@pytest.mark.parametrize("family", range(len(FAMILIES)), ids=[family.__name__ for family in FAMILIES])
@pytest.mark.parametrize("size", [16, 60])
def test_every_ring_is_filled(family: int, size: int) -> None:
    for i in range(20):
        points, ring = drawn(family + i * len(FAMILIES), size)
        assert_filled(points, ring, fill(points, ring))


@settings(max_examples=100)
@given(st.integers(0, 10**9))
def test_the_construction_alone_fills_every_ring_as_the_theorem_says(seed: int) -> None:
    points, ring = drawn(seed, 40)
    n, triangulation = len(ring), triangulate(points[ring])
    assert triangulation is not None
    filling = by_diagonals(points[ring], *triangulation)
    assert filling is not None
    new, quads = filling
    number = np.concatenate([ring, len(points) + np.arange(len(new))])
    assert_filled(points, ring, Fill(np.concatenate([points, new]), number[quads]))
    assert len(quads) <= max(5, 3 * n - 10)


@pytest.mark.slow
@pytest.mark.parametrize("n", [1000, 1600])
def test_long_rings(n: int) -> None:
    angle = np.linspace(0.0, 6.0 * np.pi, n // 2)
    points, ring = plain(np.concatenate([polar(1.0 + angle, angle), polar(0.7 + angle, angle)[::-1]])[::-1].copy())
    points = points if area(points) > 0 else points[::-1].copy()
    filled = fill(points, ring)
    assert_filled(points, ring, filled)
    assert element_quality(filled.points, filled.quads).min() > 0.1


def test_a_convex_quadrilateral_is_its_own_filling() -> None:
    points, ring = np.array([(9.0, 9.0), (0.0, 0.0), (3.0, 0.0), (2.0, 1.0), (0.0, 1.0)]), np.array([1, 2, 3, 4])
    filled = fill(points, ring)
    np.testing.assert_array_equal(filled.points, points)
    assert filled.quads.tolist() == [[1, 2, 3, 4]]


@pytest.mark.parametrize("corner", [(1.0, 0.0), (1.0, 0.1), (1.0, 1e-9), (1.0, 0.9), (1.0, -1e-15)])
def test_quadrilaterals_that_are_not_strictly_convex(corner: tuple[float, float]) -> None:
    points, ring = plain(np.array([(0.0, 0.0), corner, (2.0, 0.0), (1.0, 1.0)]))
    filled = fill(points, ring)
    assert_filled(points, ring, filled)
    assert len(filled.quads) in (1, 5)


@pytest.mark.parametrize(("width", "height"), [(2, 1), (3, 1), (2, 2), (5, 1)])
def test_grids_are_found(width: int, height: int) -> None:
    sides = [(x, 0) for x in range(width)] + [(width, y) for y in range(height)]
    points, ring = plain(np.array([*sides, *((width - x, height - y) for x, y in sides)], dtype=np.float64))
    filled = fill(points, ring)
    assert len(filled.quads) == width * height
    assert element_quality(filled.points, filled.quads).min() > 0.99


@given(st.integers(0, 10**6), st.integers(-30, 30))
@settings(max_examples=30)
def test_fillings_repeat_scale_and_ignore_other_points(seed: int, power: int) -> None:
    points, ring = drawn(seed, 40)
    filled = fill(points, ring)
    again = fill(points, ring)
    np.testing.assert_array_equal(again.points, filled.points)
    np.testing.assert_array_equal(again.quads, filled.quads)
    scaled = fill(points * 2.0**power, ring)
    np.testing.assert_array_equal(scaled.points, filled.points * 2.0**power)
    np.testing.assert_array_equal(scaled.quads, filled.quads)
    more = fill(np.concatenate([points[:1] + 5.0, points]), ring + 1)
    np.testing.assert_array_equal(more.points[1:], filled.points)
    np.testing.assert_array_equal(more.quads, filled.quads + 1)


BAD = {
    "odd": (plain(polar(np.ones(5), np.arange(5.0))), "a ring of 5 vertices: only even ones"),
    "two": (plain(polar(np.ones(2), np.arange(2.0))), "a ring of 2 vertices: only even ones"),
    "clockwise": (plain(polar(np.ones(6), -np.arange(6.0))), "no triangulation: .*runs clockwise"),
    "without area": (plain(np.stack([np.arange(6.0), np.arange(6.0)], axis=1)), "no triangulation"),
    "crossing": (
        plain(np.array([(0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)])),
        "no triangulation: it meets itself",
    ),
    "not a number": (plain(polar(np.ones(6), np.arange(6.0)) * np.nan), "no triangulation"),
}


@pytest.mark.parametrize(("ring", "message"), BAD.values(), ids=BAD.keys())
def test_what_cannot_be_filled_is_named(ring: Ring, message: str) -> None:
    with pytest.raises(FillError, match=message):
        fill(*ring)


# The parts


@given(st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), min_size=3, max_size=3), st.integers(0, 3))
def test_a_certain_turn_is_a_left_turn(lattice: list[tuple[int, int]], exponent: int) -> None:
    a, b, c = ([1.0 / 3.0 + x * 10.0**-exponent, 1e6 + y * 10.0**-exponent] for x, y in lattice)
    exact = exact_turn(a, b, c)
    assert not turns_left(*a, *b, *c) or exact > 0
    assert turns_left(*map(float, lattice[0]), *map(float, lattice[1]), *map(float, lattice[2])) == (
        exact_turn(*(list(map(float, point)) for point in lattice)) > 0
    )


@given(st.integers(0, 10**9))
def test_triangles_and_pieces_part_the_ring(seed: int) -> None:
    points, ring = drawn(seed, 80)
    xy = points[ring]
    n, triangulation = len(ring), triangulate(xy)
    assert triangulation is not None
    triangles, across = triangulation
    assert set(turns(xy, triangles)) == {1}
    assert_parted(n, triangles)
    assert np.sum([area(xy[t]) for t in triangles]) == pytest.approx(area(xy), rel=1e-9)
    for t, k in np.argwhere(across >= 0).tolist():
        assert set(triangles[t, [k, (k + 1) % 3]].tolist()) <= set(triangles[across[t, k]].tolist())

    whole, pieces = partition(xy, triangles, across)
    np.testing.assert_array_equal(whole[:n], xy)
    assert all(len(piece) % 2 == 0 for piece in pieces)
    assert len(whole) - n <= n / 15
    assert_parted(n, pieces)
    assert np.sum([area(whole[piece]) for piece in pieces]) == pytest.approx(area(xy), rel=1e-9)


def assert_parted(n: int, polygons: Ints | list[Ints]) -> None:
    """Polygons use the edges of the ring 0 .. n - 1 once, all others once in each direction."""
    edges = [edge for polygon in polygons for edge in walked(np.asarray(polygon))]
    assert len(set(edges)) == len(edges)
    assert {(a, b) for a, b in edges if (b, a) not in set(edges)} == set(walked(np.arange(n)))


@given(st.integers(0, 10**9))
@settings(max_examples=50)
def test_chords_are_as_good_as_any_two_elements_of_a_hexagon(seed: int) -> None:
    rng = np.random.default_rng(seed)
    xy = polar(rng.uniform(0.3, 1.0, 6), (np.arange(6) + rng.uniform(0.0, 0.7, 6)) * np.pi / 3.0)
    halves = [np.array([[k, k + 1, k + 2, k + 3], [k + 3, (k + 4) % 6, (k + 5) % 6, k]]) for k in range(3)]
    cost = min(float((np.maximum(fitnesses(xy, quads), 1e-9) ** -4.0).sum()) for quads in halves)
    filling = by_chords(xy)
    if filling is None:
        assert cost > 1e20
        return
    new, quads = filling
    assert float((fitnesses(np.concatenate([xy, new]), quads) ** -4.0).sum()) <= cost * (1.0 + 1e-9)


@given(st.integers(0, 10**9))
@settings(max_examples=50)
def test_smoothing_lowers_the_cost_and_moves_new_points_only(seed: int) -> None:
    points, ring = drawn(seed, 20)
    xy = points[ring]
    triangulation = triangulate(xy)
    assert triangulation is not None
    filling = by_diagonals(xy, *triangulation)
    assert filling is not None
    before = np.concatenate([xy, filling[0]])
    after = before.copy()
    smooth(after, filling[1], len(xy), *stars_of(filling[1], len(after)))
    np.testing.assert_array_equal(after[: len(xy)], xy)
    assert (fitnesses(after, filling[1]) > 0.0).all()
    assert (fitnesses(after, filling[1]) ** -4.0).sum() <= (fitnesses(before, filling[1]) ** -4.0).sum()


@pytest.mark.parametrize("make", FAMILIES, ids=lambda family: family.__name__)
def test_the_rings_are_even_and_counter_clockwise(make: Callable[[np.random.Generator, int], Ring]) -> None:
    for seed in range(5):
        points, ring = make(np.random.default_rng(seed), 30)
        assert len(ring) % 2 == 0
        assert area(points[ring]) > 0
