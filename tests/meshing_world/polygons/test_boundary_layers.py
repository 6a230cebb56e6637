"""Boundary layers: valid rows of the heights asked for, rings inside that can be meshed, and limits that are told."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.mesh import Mesh, edges_of
from envs.polygons.boundary_layers import Layers, boundary_layers
from envs.polygons.layer_ends import Stretch
from envs.polygons.layer_loops import Rows
from envs.polygons.layer_room import SLOPE, smoothed
from envs.polygons.validation import from_rings
from envs.types import DomainError, Floats

Side = Callable[[Floats, Floats], np.ndarray]


def split(corners: list[tuple[float, float]], h: float) -> Floats:
    """A polygon with vertices about h apart."""
    found = []
    for a, b in zip(np.array(corners, dtype=float), np.roll(np.array(corners, dtype=float), -1, axis=0), strict=True):
        pieces = max(1, round(np.linalg.norm(b - a) / h))
        found.append(a + (b - a) * (np.arange(pieces) / pieces)[:, None])
    return np.concatenate(found)


def circle(n: int, radius: float, centre: tuple[float, float] = (0.0, 0.0)) -> Floats:
    t = 2.0 * np.pi * np.arange(n) / n
    return np.array(centre) + radius * np.stack([np.cos(t), np.sin(t)], axis=1)


def on(ring: Floats, side: Side) -> np.ndarray:
    """Which segments of a ring have their middle on a side."""
    middle = 0.5 * (ring + np.roll(ring, -1, axis=0))
    return side(middle[:, 0], middle[:, 1])


def everywhere(ring: Floats) -> np.ndarray:
    return np.ones(len(ring), dtype=np.bool_)


def nowhere(ring: Floats) -> np.ndarray:
    return np.zeros(len(ring), dtype=np.bool_)


def check(layers: Layers, rings: list[Floats], carries: list[np.ndarray], near: float = 1e-9) -> None:
    """What holds for all layers; the area to a share of it."""
    vertices, quads = layers.vertices, layers.quads
    corners = vertices[quads]
    ahead, behind = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    turn = ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]
    assert turn.min() > 0.0, "strictly convex, counter-clockwise"
    edges, counts = edges_of(quads)
    assert counts.max() <= 2
    once = {tuple(edge) for edge in edges[counts == 1].tolist()}
    inner = {
        tuple(sorted(edge))
        for ring in layers.rings
        for edge in zip(ring.tolist(), np.roll(ring, -1).tolist(), strict=True)
    }
    outer = {tuple(edge) for edge in np.sort(layers.segments, axis=1).tolist()}
    assert once == inner ^ outer, "the rows lie between the boundary and the rings inside"
    assert sum(map(len, layers.rings)) % 2 == 0
    assert set(quads.ravel().tolist()) | {v for ring in layers.rings for v in ring.tolist()} == set(
        range(len(vertices))
    )
    assert len(np.unique(vertices, axis=0)) == len(vertices)
    shape = shapely.Polygon(vertices[layers.rings[0]], [vertices[ring] for ring in layers.rings[1:]])
    assert shape.is_valid
    whole = shapely.Polygon(rings[0], rings[1:])
    areas = Mesh("rows", vertices, quads, layers.segments, False).areas
    assert areas.sum() + shape.area == pytest.approx(whole.area, rel=near)
    assert shapely.Polygon(vertices[layers.rings[0]]).exterior.is_ccw
    given = {tuple(point) for point in vertices[np.unique(layers.segments)].tolist()}
    for ring, flags in zip(rings, carries, strict=True):
        carried = ring[flags | np.roll(flags, 1)]
        assert {tuple(point) for point in carried.tolist()} <= given, "vertices with layers stay, bit for bit"
    from_rings(vertices[layers.rings[0]], [vertices[ring] for ring in layers.rings[1:]])


def levels(layers: Layers, distance: Callable[[Floats], Floats], at: Callable[[Floats], np.ndarray]) -> Floats:
    """The different distances from a side of the vertices at a stretch of it."""
    found = np.sort(distance(layers.vertices[at(layers.vertices)]))
    return found[np.append(True, np.diff(found) > 1e-9)]


def test_a_flat_plate_has_rows_of_the_heights_asked_for() -> None:
    ring = split([(0, 0), (4, 0), (4, 2), (0, 2)], 0.2)
    flags = on(ring, lambda x, y: y < 1e-9)
    rows = Rows(5, 0.02, 1.3)
    layers = boundary_layers([ring], [flags], rows, "plate")
    check(layers, [ring], [flags])
    assert layers.limited == ()
    assert len(layers.quads) == 5 * 20
    heights = 0.02 * np.array([0.0, 1.0, 2.3, 3.99, 6.187, 9.0431])
    used = layers.vertices[np.unique(layers.quads)]
    np.testing.assert_allclose(np.unique(np.round(used[:, 1], 12)), heights)
    np.testing.assert_allclose(np.unique(np.round(used[:, 0], 12)), np.linspace(0.0, 4.0, 21))
    # The vertices of the sides but those that the rows have passed, or come close to, and one more for each.
    kept = {tuple(p) for p in ring[(ring[:, 1] == 0.0) | (ring[:, 1] > 0.3)].tolist()}
    assert kept <= {tuple(p) for p in layers.vertices.tolist()}
    assert len(layers.rings[0]) == len(ring)
    thin = boundary_layers([ring], [flags], Rows(3, 0.01, 1.2), "plate")
    check(thin, [ring], [flags])
    assert {tuple(p) for p in ring.tolist()} <= {tuple(p) for p in thin.vertices.tolist()}, "nothing had to move"


def test_rows_that_begin_in_the_middle_of_a_side_end_upright() -> None:
    ring = split([(0, 0), (4, 0), (4, 2), (0, 2)], 0.2)
    for count in (4, 5):
        flags = on(ring, lambda x, y: (y < 1e-9) & (x > 1.0))
        layers = boundary_layers([ring], [flags], Rows(count, 0.02, 1.3), "plate")
        check(layers, [ring], [flags])
        walk = layers.vertices[layers.rings[0]]
        upright = walk[np.isclose(walk[:, 0], 1.0) & (walk[:, 1] < 1.0)]
        np.testing.assert_allclose(np.sort(upright[:, 1]), [0.0, *Rows(count, 0.02, 1.3).heights], atol=1e-12)


def test_a_cylinder_has_rings_of_elements() -> None:
    outer, hole = split([(0, 0), (4, 0), (4, 4), (0, 4)], 0.4), circle(40, 0.5, (2.0, 2.0))
    layers = boundary_layers([outer, hole], [nowhere(outer), everywhere(hole)], Rows(6, 0.02, 1.3), "cylinder")
    check(layers, [outer, hole], [nowhere(outer), everywhere(hole)])
    assert layers.limited == ()
    assert [len(ring) for ring in layers.rings] == [40, 40]
    np.testing.assert_array_equal(layers.vertices[layers.rings[0]], outer)
    # A segment's rows have their height; the vertices are on the bisectors, further by 1 / cos of half the turn.
    radii = np.linalg.norm(layers.vertices - 2.0, axis=1)[len(outer) :]
    expected = 0.5 + Rows(6, 0.02, 1.3).heights / np.cos(np.pi / 40)
    np.testing.assert_allclose(np.unique(np.round(radii, 9)), [0.5, *expected], rtol=1e-6)
    inside = boundary_layers([circle(30, 1.0)], [np.ones(30, dtype=bool)], Rows(20, 0.05, 1.3), "pipe")
    check(inside, [circle(30, 1.0)], [np.ones(30, dtype=bool)])
    assert inside.limited, "a third of the way through at most"
    assert np.linalg.norm(inside.vertices, axis=1).min() == pytest.approx(1.0 / 3.0, abs=0.05)


def test_an_airfoil_has_a_fan_at_its_trailing_edge() -> None:
    t = np.linspace(0.0, np.pi, 101)
    x = 0.5 * (1.0 - np.cos(t))
    y = 0.6 * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
    wing = np.concatenate([np.stack([x, y], axis=1), np.stack([x, -y], axis=1)[-2:0:-1]])
    outer = split([(-5, -5), (8, -5), (8, 5), (-5, 5)], 0.5)
    carries = [nowhere(outer), everywhere(wing)]
    rows = Rows(12, 0.001, 1.25)
    layers = boundary_layers([outer, wing], carries, rows, "wing")
    check(layers, [outer, wing], carries)
    assert layers.limited == ()
    assert len(layers.rings[1]) == len(wing) + 4
    assert len(layers.quads) == 12 * len(wing) + 2 + 4 * 11
    tip = int(np.flatnonzero((layers.vertices == [1.0, wing[100, 1]]).all(axis=1))[0])
    assert (layers.quads == tip).any(axis=1).sum() == 4, "one for each right angle"
    distance = shapely.distance(shapely.Polygon(wing), shapely.points(layers.vertices[layers.rings[1]]))
    assert distance.min() == pytest.approx(rows.heights[-1], rel=1e-6)
    assert distance.max() < 1.4 * rows.heights[-1]


def test_both_corners_of_an_l() -> None:
    ring = split([(0, 0), (4, 0), (4, 2), (2, 2), (2, 4), (0, 4)], 0.2)
    rows = Rows(6, 0.03, 1.25)
    layers = boundary_layers([ring], [everywhere(ring)], rows, "L")
    check(layers, [ring], [everywhere(ring)])
    assert layers.limited == ()
    high = rows.heights[-1]
    inner = shapely.Polygon(layers.vertices[layers.rings[0]])
    expected = shapely.Polygon(split([(0, 0), (4, 0), (4, 2), (2, 2), (2, 4), (0, 4)], 9)).buffer(
        -high, join_style="mitre"
    )
    assert shapely.symmetric_difference(inner, expected).area < 1e-9, "the rows keep their height around both"
    corner = int(np.flatnonzero((layers.vertices == 2.0).all(axis=1))[0])
    assert (layers.quads == corner).any(axis=1).sum() == 3
    assert len(layers.rings[0]) == len(ring) + 2
    # Layers on one side of the corner end upright there.
    flags = on(ring, lambda x, y: (y > 2.0 - 1e-9) & (x > 2.0))
    step = boundary_layers([ring], [flags], rows, "step")
    check(step, [ring], [flags])
    assert len(step.rings[0]) % 2 == 0


@pytest.mark.parametrize("shift", [-1.0, 0.0, 1.0])
def test_rows_end_along_a_side_that_leans(shift: float) -> None:
    ring = split([(0, 0), (4, 0), (4 + shift, 2), (shift, 2)], 0.2)
    flags = on(ring, lambda x, y: y < 1e-9)
    layers = boundary_layers([ring], [flags], Rows(5, 0.03, 1.3), "leaning")
    check(layers, [ring], [flags])
    assert layers.limited == ()
    used = layers.vertices[np.unique(layers.quads)]
    np.testing.assert_allclose(np.unique(np.round(used[:, 1], 9)), [0.0, *Rows(5, 0.03, 1.3).heights], rtol=1e-6)


def test_rows_sink_towards_a_sharp_end() -> None:
    wedge = split([(0, 0), (4, 0), (4, 1)], 0.2)
    flags = on(wedge, lambda x, y: y < 1e-9)
    layers = boundary_layers([wedge], [flags], Rows(5, 0.02, 1.2), "wedge")
    check(layers, [wedge], [flags])
    ((where, share),) = layers.limited
    assert tuple(where) == (0.0, 0.0)
    assert share < 0.5


def test_a_narrow_channel_limits_the_rows_to_a_third_and_says_where() -> None:
    ring = split([(0, 0), (4, 0), (4, 0.3), (0, 0.3)], 0.1)
    flags = on(ring, lambda x, y: (y < 1e-9) | (y > 0.3 - 1e-9))
    layers = boundary_layers([ring], [flags], Rows(5, 0.03, 1.3), "channel")
    check(layers, [ring], [flags])
    inner = layers.vertices[layers.rings[0]]
    assert inner[:, 1].min() == pytest.approx(0.1)
    assert inner[:, 1].max() == pytest.approx(0.2)
    assert [share for _, share in layers.limited] == pytest.approx([0.1 / Rows(5, 0.03, 1.3).heights[-1]] * 2)
    # Only where it is narrow, and smoothly.
    x = np.linspace(0, 4, 81)
    throat = np.concatenate(
        [np.stack([x, 0 * x], 1), np.stack([x[::-1], 1 - 0.85 * np.exp(-4 * (x[::-1] - 2) ** 2)], 1)]
    )
    flags = on(throat, lambda a, b: (a > 1e-6) & (a < 4 - 1e-6))
    layers = boundary_layers([throat], [flags], Rows(5, 0.02, 1.3), "throat")
    check(layers, [throat], [flags])
    high = Rows(5, 0.02, 1.3).heights[-1]
    lower = layers.vertices[layers.rings[0]]
    lower = lower[lower[:, 1] < 0.5 - 0.425 * np.exp(-4 * (lower[:, 0] - 2) ** 2)]
    lower = lower[np.argsort(lower[:, 0])]
    lower = lower[lower[:, 1] >= 0.04]
    assert lower[0, 1] == pytest.approx(high)
    assert lower[:, 1].min() == pytest.approx(0.05, abs=0.01)
    assert np.abs(np.diff(lower[:, 1])).max() <= 1.1 * SLOPE * np.diff(lower[:, 0]).max()
    assert {round(float(where[0]), 2) for where, _ in layers.limited} <= {1.9, 1.95, 2.0, 2.05, 2.1}


def star(rng: np.random.Generator, n: int, radius: float, rough: float) -> Floats:
    t = 2.0 * np.pi * (np.arange(n) + rng.uniform(-0.2, 0.2, n)) / n
    r = radius * (1.0 + rough * rng.uniform(-1.0, 1.0, n))
    return np.stack([r * np.cos(t), r * np.sin(t)], axis=1)


@pytest.mark.slow
@settings(max_examples=150)
@given(
    seed=st.integers(0, 100_000), n=st.integers(4, 60), rough=st.sampled_from([0.02, 0.2, 0.5]),
    count=st.integers(1, 12), first=st.floats(1e-4, 0.1), growth=st.floats(1.0, 1.6), hole=st.booleans(),
    runs=st.sampled_from(["all", "random", "one"]), scale=st.sampled_from([1e-6, 1.0, 1e6]),
)  # fmt: skip
def test_layers_of_any_polygon_are_valid_or_refused(
    seed: int, n: int, rough: float, count: int, first: float, growth: float, hole: bool, runs: str, scale: float
) -> None:
    rng = np.random.default_rng(seed)
    n += n % 2
    rings = [scale * star(rng, n, 1.0, rough)[:: rng.choice([-1, 1])]]
    if hole:
        rings.append(scale * star(rng, 12, 0.25, 0.3)[:: rng.choice([-1, 1])])
    carries = []
    for ring in rings:
        flags = everywhere(ring)
        if runs == "random":
            flags = np.repeat(rng.random(len(ring)) < 0.6, 3)[: len(ring)]
        elif runs == "one":
            flags = np.arange(len(ring)) < rng.integers(1, len(ring))
        carries.append(flags)
    if not any(flags.any() for flags in carries):
        carries[0][0] = True
    rows = Rows(count, first * scale, growth)
    try:
        layers = boundary_layers(rings, carries, rows, "star")
    except DomainError as told:
        message = str(told)
    else:
        message = ""
        # Rows may pass a vertex of a bent side without layers.
        check(layers, rings, carries, near=1e-2)
        assert all(0.0 < share < 1.0 for _, share in layers.limited)
    assert message == "" or message.startswith(("star: no room for layers at (", "star: layers cross or fold at ("))
    assert "\n" not in message


def test_a_short_side_limits_the_rows_that_end_along_it() -> None:
    ring = split([(0, 0), (4, 0), (4, 0.15), (6, 0.15), (6, 3), (0, 3)], 0.2)
    flags = on(ring, lambda x, y: y < 1e-9)
    rows = Rows(5, 0.02, 1.3)
    layers = boundary_layers([ring], [flags], rows, "step")
    check(layers, [ring], [flags])
    ((where, share),) = layers.limited
    assert tuple(where) == (4.0, 0.0)
    assert share == pytest.approx(0.15 / 3.0 / rows.heights[-1])


def test_rows_that_would_meet_shrink() -> None:
    for seed in range(40):
        rng = np.random.default_rng(seed)
        rings = [star(rng, 2 * int(rng.integers(2, 20)), 1.0, 0.5), star(rng, 12, 0.25, 0.3)]
        rows = Rows(4, rng.uniform(0.02, 0.3), 1.3)
        carries = [everywhere(ring) for ring in rings]
        check(boundary_layers(rings, carries, rows, "star"), rings, carries)


def test_few_polygons_are_refused() -> None:
    refused = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        ring = star(rng, 2 * int(rng.integers(2, 30)), 1.0, float(rng.choice([0.02, 0.2, 0.5])))
        try:
            boundary_layers(
                [ring], [everywhere(ring)], Rows(int(rng.integers(1, 12)), rng.uniform(1e-4, 0.1), 1.3), "star"
            )
        except DomainError:
            refused += 1
    assert refused <= 2


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (Rows(0, 0.1, 1.2), r"^p: 0 layers; give --boundary-layers a whole number from 1 to 200$"),
        (Rows(201, 0.1, 1.2), "201 layers"),
        (Rows(2, 0.0, 1.2), r"^p: first layer 0 high; give --first a number above 0$"),
        (Rows(2, np.nan, 1.2), "first layer nan"),
        (Rows(2, 0.1, 0.9), r"growth 0\.9 of layers; give --growth a number from 1 to 3$"),
        (Rows(2, 0.1, 3.5), "growth 3.5"),
    ],
)
def test_numbers_that_are_none_are_told(rows: Rows, message: str) -> None:
    ring = split([(0, 0), (1, 0), (1, 1), (0, 1)], 0.25)
    with pytest.raises(DomainError, match=message):
        boundary_layers([ring], [everywhere(ring)], rows, "p")


def test_layers_need_a_side_and_an_even_boundary() -> None:
    ring = split([(0, 0), (1, 0), (1, 1), (0, 1)], 0.25)
    with pytest.raises(DomainError, match=r"^p: no side carries the layers"):
        boundary_layers([ring], [nowhere(ring)], Rows(2, 0.01, 1.2), "p")
    odd = circle(31, 1.0)
    with pytest.raises(DomainError, match="odd number of boundary vertices"):
        boundary_layers([odd], [everywhere(odd)], Rows(2, 0.01, 1.2), "p")
    some = np.arange(31) < 12
    check(boundary_layers([odd], [some], Rows(2, 0.01, 1.2), "p"), [odd], [some])


@given(
    seed=st.integers(0, 1000), n=st.integers(2, 30), first=st.floats(0.0, 0.4), last=st.floats(0.0, 0.4),
    more=st.integers(0, 1),
)  # fmt: skip
def test_a_stretch_keeps_its_parity_and_what_rows_do_not_reach(
    seed: int, n: int, first: float, last: float, more: int
) -> None:
    rng = np.random.default_rng(seed)
    at = np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 2.0, n - 1))])
    points = np.stack([at / at[-1], np.zeros(n)], axis=1)
    inside = Stretch(points, first, last, more).inside()
    assert (len(inside) - (n - 2) - more) % 2 == 0
    every = np.concatenate([[first], inside[:, 0], [1.0 - last]])
    assert (np.diff(every) > 0.0).all()
    new = {tuple(p) for p in inside.tolist()} - {tuple(p) for p in points.tolist()}
    assert len(new) <= 1
    longest = np.diff(points[:, 0]).max()
    gone = {tuple(p) for p in points[1:-1].tolist()} - {tuple(p) for p in inside.tolist()}
    assert all(x <= first + longest or x >= 1.0 - last - longest for x, _ in gone)
    if first == last == more == 0:
        np.testing.assert_array_equal(inside, points[1:-1])


@given(seed=st.integers(0, 1000), closed=st.booleans())
def test_heights_change_by_no_more_than_the_slope(seed: int, closed: bool) -> None:
    rng = np.random.default_rng(seed)
    shares = rng.uniform(0.05, 1.0, 20)
    gaps = rng.uniform(0.01, 0.5, 20 if closed else 19)
    found = smoothed(shares, gaps, 2.0, closed)
    assert (found <= shares).all()
    assert found.min() == shares.min()
    steps = np.abs(np.roll(found, -1) - found)[: len(gaps)] * 2.0
    assert (steps <= SLOPE * gaps + 1e-12).all()
    again = smoothed(found, gaps, 2.0, closed)
    np.testing.assert_allclose(again, found)


def test_a_stretch_with_one_more_segment_moves_nothing() -> None:
    points = np.array([[0, 0], [1, 0], [3, 0.5], [4, 0]], dtype=float)
    np.testing.assert_allclose(Stretch(points, more=1).inside(), [[1, 0], [2, 0.25], [3, 0.5]])
    np.testing.assert_array_equal(Stretch(points).inside(), points[1:-1])
