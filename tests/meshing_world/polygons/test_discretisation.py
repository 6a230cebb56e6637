"""Discretised outlines: what is given stays, sizes are as asked, totals are even, shared stretches are shared."""

from __future__ import annotations

from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.domains.load import from_object, load, load_all, rings_of
from envs.polygons.discretisation import discretised
from envs.polygons.outline import corners
from envs.polygons.sizing import GROWTH
from envs.types import Domain, DomainError, Floats

L_SHAPE = np.array([[0, 0], [5, 0], [5, 2], [2, 2], [2, 4.4], [0, 4.4]], dtype=np.float64)
HOLE = np.array([[0.5, 0.5], [0.5, 1.5], [1.5, 1.5]])

SCALES = st.sampled_from([1e-6, 1e-3, 1.0, 1e3, 1e6])


def star(seed: int, n: int, smooth: bool = False) -> Floats:
    """An (n, 2) ring around the origin with random radii, or a fine smooth one."""
    rng = np.random.default_rng(seed)
    t = 2 * np.pi * np.arange(n) / n
    r = 1 + 0.3 * np.cos(3 * t + rng.uniform(0, 6)) if smooth else rng.uniform(0.5, 1.5, n)
    return np.stack([r * np.cos(t), r * np.sin(t)], axis=1)


def lengths(ring: Floats) -> Floats:
    """(n,) lengths of a ring's segments."""
    return np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)


def rows(points: Floats) -> list[tuple[float, float]]:
    """Points as a list of pairs."""
    return [(x, y) for x, y in points.tolist()]


def sides(ring: Floats, vertices: Floats) -> list[Floats]:
    """The vertices of a discretised ring from each given vertex to the next, both included."""
    at = [rows(vertices).index(corner) for corner in rows(ring)]
    closed = np.concatenate([vertices, vertices])
    return [closed[a : (b if b > a else b + len(vertices)) + 1] for a, b in zip(at, [*at[1:], at[0]], strict=True)]


@settings(max_examples=60)
@given(
    seed=st.integers(0, 1000), n=st.integers(4, 12), share=st.floats(0.02, 1.0), scale=SCALES,
    offset=st.sampled_from([0.0, 1.0, 1e6]), angle=st.floats(0, 6),
)  # fmt: skip
def test_sides_are_split_evenly_and_corners_stay(
    seed: int, n: int, share: float, scale: float, offset: float, angle: float
) -> None:
    turned = star(seed, n) @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    ring = scale * (turned + offset)
    edge_length = share * lengths(ring).min()
    (domain,) = from_object(ring, edge_length=edge_length)
    vertices = domain.points
    assert len(domain.ring) % 2 == 0
    assert set(rows(ring)) <= set(rows(vertices)), "given vertices, bit for bit"
    added = 0
    for a, b, side in zip(ring, np.roll(ring, -1, axis=0), sides(ring, vertices), strict=True):
        steps = np.linalg.norm(np.diff(side, axis=0), axis=1)
        length = np.linalg.norm(b - a)
        np.testing.assert_allclose(steps, length / len(steps), atol=4e-16 * scale * (2 + offset))
        off = np.abs((side - a) @ np.array([a[1] - b[1], b[0] - a[0]])) / length
        assert off.max() <= 4e-16 * scale * (2 + offset), "on the straight line to round-off"
        least = max(1, round(length / edge_length))
        added += len(steps) - least
    wanted = sum(max(1, round(length / edge_length)) for length in lengths(ring))
    assert added == wanted % 2


@given(seed=st.integers(0, 1000), n=st.integers(4, 12), share=st.floats(0.1, 0.9))
def test_an_odd_total_gets_its_vertex_where_sizes_change_least(seed: int, n: int, share: float) -> None:
    ring = star(seed, n)
    pieces = lengths(ring) / (share * lengths(ring).min())
    ((vertices,),) = discretised([[ring]], "star", edge_length=share * lengths(ring).min())
    added = np.array([len(side) - 1 for side in sides(ring, vertices)]) - np.round(pieces)
    changes = np.abs(np.log(pieces / (np.round(pieces) + 1)))
    assert changes[added > 0] == pytest.approx(changes.min() if added.any() else [])


@pytest.mark.parametrize("sweep", [0.8, 1.2, 1.5])
def test_a_coarse_ring_spends_its_vertices_on_what_is_bent(sweep: float) -> None:
    t = np.linspace(0.0, sweep, 100)
    ring = np.stack([np.cos(t), np.sin(t)], axis=1)
    vertices = from_object(ring, edge_length=0.9 * np.sin(sweep / 2) * 2, curvature=4.0)[0].points
    assert len(vertices) == 4
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 1.0, atol=1e-3, err_msg="none on the chord")


@pytest.mark.parametrize("edge_length", [0.03, 0.1, 0.37])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_fine_smooth_outlines_are_resampled(edge_length: float, scale: float) -> None:
    ring = scale * star(1, 2000, smooth=True)
    (domain,) = from_object(ring, edge_length=edge_length * scale, curvature=4.0)
    steps = lengths(domain.points)
    assert len(steps) == pytest.approx(lengths(ring).sum() / scale / edge_length, abs=1.5)
    assert steps.max() / steps.min() < 1.0 + edge_length
    assert shapely.distance(shapely.LinearRing(ring), shapely.points(domain.points)).max() < 1e-12 * scale
    assert tuple(ring[0]) in rows(domain.points)


def test_corners_of_a_fine_outline_stay() -> None:
    t = np.linspace(0, 1, 300, endpoint=False)
    ring = np.concatenate(
        [np.stack([t, np.sin(np.pi * t)], axis=1), np.stack([1 - t, -0.3 * np.sin(np.pi * t)], axis=1)]
    )
    (domain,) = from_object(ring, edge_length=0.1)
    sharp = ring[corners(ring)]
    assert len(sharp) == 2
    assert set(rows(sharp)) <= set(rows(domain.points))
    assert len(domain.ring) < 50


def test_a_gentle_vertex_between_long_sides_stays() -> None:
    ring = [[0, 0], [5, -0.4], [10, 0], [10, 5], [0, 5]]
    assert (5.0, -0.4) in rows(from_object(ring, edge_length=0.7)[0].points)


def test_discretising_again_changes_nothing() -> None:
    (once,) = from_object([L_SHAPE, HOLE], edge_length=0.25)
    again = discretised([rings_of(once)], "again", edge_length=None)
    np.testing.assert_array_equal(np.concatenate(again[0]), once.points[: len(once.segments)])


@pytest.mark.parametrize("edge_length", [0.01, 0.3, 1.0, 100.0])
def test_small_holes_keep_a_shape(edge_length: float) -> None:
    disc = shapely.Point(0, 0).buffer(0.05, quad_segs=64)
    (domain,) = from_object(shapely.box(-1, -1, 1, 1).difference(disc), edge_length=edge_length)
    assert len(domain.ring) % 2 == 0
    assert 4 - domain.area == pytest.approx(disc.area, rel=0.4)


def test_outlines_that_are_too_coarse_or_too_fine_are_refused() -> None:
    outer, hole = star(0, 400, smooth=True), 0.97 * np.roll(star(0, 400, smooth=True), 30, axis=0)
    with pytest.raises(
        DomainError, match=r"^polygon: with edge length 1 the boundary is too coarse: hole 0 crosses .*; use"
    ):
        from_object([outer, hole], edge_length=1.0, curvature=4.0)
    with pytest.raises(
        DomainError, match=r"polygon: 18,800,000 vertices, at most 1,000,000 are possible; use a larger --edge"
    ):
        from_object(L_SHAPE, edge_length=1e-6, allow_large=True)


def test_holes_allow_fewer_vertices() -> None:
    with pytest.raises(
        DomainError, match=r"^polygon: 67,\d+ vertices with holes, at most 50,000 are possible; use a larger"
    ):
        from_object([L_SHAPE, HOLE], edge_length=0.00033, allow_large=True)


@pytest.mark.parametrize(("options", "message"), [
    ({"edge_length": 0.0}, r"edge length 0.0; give --edge-length \(edge_length= in Python\) a positive number"),
    ({"edge_length": -1.0}, "edge length -1.0; give --edge-length"),
    ({"edge_length": float("nan")}, "edge length nan"),
    ({"edge_length": 1.0, "grading": 0.5}, r"grading 0.5; give --grading \(grading= in Python\) a ratio from 1"),
    ({"edge_length": 1.0, "grading": float("nan")}, "grading nan"),
    ({"grading": 2.0}, "grading 2 without an edge length"),
])  # fmt: skip
def test_sizes_that_are_none(options: dict[str, float], message: str) -> None:
    with pytest.raises(DomainError, match=rf"^polygon: {message}"):
        from_object(L_SHAPE, **options)  # type: ignore[arg-type]


def test_faults_are_told_in_terms_of_the_given_vertices(tmp_path: Path) -> None:
    path = tmp_path / "bow.json"
    path.write_text("[[0, 0], [4, 4], [4, 0], [0, 4]]")
    with pytest.raises(
        DomainError, match=r"bow.json: outer ring crosses itself: segments 0 and 2 meet at \(2.0, 2.0\)"
    ):
        load(path, edge_length=0.1)


def test_triangles_and_odd_totals_need_nothing_but_a_length() -> None:
    assert len(from_object([[0, 0], [1, 0], [0, 1]], edge_length=9.0)[0].ring) == 4
    assert len(from_object([[0, 0], [1, 0], [0, 1]], edge_length=1.0)[0].ring) == 4


def test_given_seams_are_discretised_once() -> None:
    seamed = [[0, 0], [1, 1], [1, 2], [2, 2], [2, 1], [1, 1], [0, 0], [4, 0], [4, 4], [0, 4]]
    (domain,) = from_object(seamed, edge_length=0.5)
    assert domain.area == 15.0
    assert len(domain.segments) == 32 + 8
    assert len(domain.points) == 40 + 2


# Grading


def test_grading_one_is_even_and_more_is_finer_near_features() -> None:
    ring = np.array([[0, 0], [10, 0], [10, 5], [5.2, 5], [5.2, 4.8], [5, 4.8], [5, 5], [0, 5]], dtype=np.float64)
    (even,) = from_object(ring, edge_length=0.5)
    (graded,) = from_object(ring, edge_length=0.5, grading=5.0)
    assert len(graded.ring) > len(even.ring)
    vertices = graded.points
    assert set(rows(ring)) <= set(rows(vertices))
    steps = lengths(vertices)
    middle = 0.5 * (vertices + np.roll(vertices, -1, axis=0))
    away = np.linalg.norm(middle - [5.1, 4.9], axis=1)
    assert steps[away < 0.5].max() < 0.3
    assert steps[away > 4.0] == pytest.approx(0.5, rel=0.1)
    ratio = np.array([max(a, b) / min(a, b) for a, b in pairwise([*steps, steps[0]])])
    assert ratio.max() < GROWTH**1.6


def test_sharp_corners_draw_vertices() -> None:
    (graded,) = from_object([[0, 0], [10, 1.5], [0, 3]], edge_length=1.0, grading=4.0)
    steps, here = lengths(graded.points), graded.points
    tip = np.linalg.norm(here - [10, 1.5], axis=1) < 1.0
    assert steps[tip].max() < 0.5
    assert steps.max() == pytest.approx(1.0, rel=0.1)


@settings(max_examples=60)
@given(seed=st.integers(0, 500), n=st.integers(4, 30), edge_length=st.floats(0.05, 9.0))
def test_corners_stay_and_totals_are_even_at_any_length(seed: int, n: int, edge_length: float) -> None:
    ring = star(seed, n)
    ((vertices,),) = discretised([[ring]], "star", edge_length=edge_length)
    assert len(vertices) % 2 == 0
    assert set(rows(ring[corners(ring)])) <= set(rows(vertices))
    assert shapely.distance(shapely.LinearRing(ring), shapely.points(vertices)).max() < 1e-15


@settings(max_examples=60)
@given(seed=st.integers(0, 500), n=st.integers(4, 30), grading=st.floats(1.0, 50.0), scale=SCALES)
def test_graded_sizes_stay_between_the_two_ends(seed: int, n: int, grading: float, scale: float) -> None:
    ring = scale * star(seed, n)
    (split,) = discretised([[ring]], "star", edge_length=0.2 * scale, grading=grading)
    vertices = split[0]
    assert len(vertices) % 2 == 0
    assert set(rows(ring[corners(ring)])) <= set(rows(vertices))
    steps = lengths(vertices)
    # A side is split into whole numbers: sizes are off by up to one half of a segment more or less.
    assert steps.max() <= 0.2 * scale * 1.51
    assert steps.min() >= min(0.2 * scale / grading / 2.01, lengths(ring).min() / 2.01)


# Several polygons


def walls(domains: list[Domain]) -> None:
    """Assert that neighbours have the same vertices wherever their boundaries run along each other."""
    shapes = [shapely.Polygon(domain.points[: len(domain.segments)]) for domain in domains]
    for i, j in combinations(range(len(domains)), 2):
        common = shapely.intersection(shapes[i].boundary, shapes[j].boundary)
        near = [
            {p for p in rows(domain.points) if shapely.dwithin(common, shapely.Point(p), 1e-9)}
            for domain in (domains[i], domains[j])
        ]
        assert near[0] == near[1]
        if common.length > 1e-9:
            assert len(near[0]) >= 2


@settings(max_examples=40)
@given(
    columns=st.integers(1, 4), lines=st.integers(1, 3), edge_length=st.floats(0.08, 3.0), grading=st.floats(1.0, 5.0),
    angle=st.floats(0, 6),
)  # fmt: skip
def test_tiles_share_their_walls(columns: int, lines: int, edge_length: float, grading: float, angle: float) -> None:
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    corner = lambda i, j: np.array([i + 0.2 * np.sin(5 * i + 3 * j), j + 0.2 * np.cos(4 * i + 7 * j)]) @ turn  # noqa: E731
    tiles = [
        [[corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)]]
        for i in range(columns)
        for j in range(lines)
    ]
    domains = from_object(tiles, edge_length=edge_length, grading=grading)
    assert all(len(domain.ring) % 2 == 0 for domain in domains)
    walls(domains)


def test_a_hole_that_another_polygon_fills_shares_its_boundary() -> None:
    disc = shapely.Point(2, 2).buffer(1.0, quad_segs=50)
    plate, core = from_object([shapely.box(0, 0, 4, 4).difference(disc), disc], edge_length=0.3)
    ring = set(rows(core.points))
    assert ring <= set(rows(plate.points))
    assert len(ring) % 2 == 0


def test_odd_polygons_pass_their_vertex_on() -> None:
    # An island of 5 sides in a plate of 4 + 5: the island has no boundary of its own.
    t = 2 * np.pi * np.arange(5) / 5
    island = np.stack([np.cos(t), np.sin(t)], axis=1)
    outer = 4.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    plate, core = from_object([[outer, island], [island]], fix_parity=True)
    assert (len(plate.segments), len(core.segments)) == (10, 6)
    assert set(rows(core.points)) <= set(rows(plate.points))
    plate, core = from_object([[np.insert(outer, 1, [0, -4], axis=0), island], [island]], fix_parity=True)
    assert (len(plate.segments), len(core.segments)) == (12, 6)


def test_vertices_on_a_neighbours_side_become_its_own() -> None:
    left, low, high = shapely.box(0, 0, 1, 2), shapely.box(1, 0, 2, 0.7), shapely.box(1, 0.7, 2, 2)
    domains = from_object([left, low, high], edge_length=0.45)
    assert (1.0, 0.7) in rows(domains[0].points)
    walls(domains)


def test_polygons_without_a_length_are_as_given(tmp_path: Path) -> None:
    path = tmp_path / "part.wkt"
    path.write_text("MULTIPOLYGON (((0 0, 2 0, 2 2, 0 2, 0 0)), ((2 0, 5 0, 5 2, 2 2, 2 0)))")
    domains = load_all(path)
    assert [domain.name for domain in domains] == ["part[0]", "part[1]"]
    assert [len(domain.ring) for domain in domains] == [4, 4]
    path.write_text("MULTIPOLYGON (((0 0, 2 0, 2 2, 0 0)), ((2 0, 5 0, 5 2, 2 2, 2 0)))")
    with pytest.raises(DomainError, match=r"part\.wkt: polygon 0: outer ring: 3 vertices"):
        load_all(path)


def test_the_same_input_gives_the_same_vertices() -> None:
    one, other = (from_object([L_SHAPE, HOLE], edge_length=0.17, grading=3.0)[0] for _ in range(2))
    assert one.points.tobytes() == other.points.tobytes()
    assert one.ring.tobytes() == other.ring.tobytes()


def test_catalogue_and_seeds_take_a_length() -> None:
    assert len(load("T1", edge_length=0.05).ring) > 2 * len(load("T1").ring)
    assert len(load("random:7", edge_length=0.02).ring) % 2 == 0
