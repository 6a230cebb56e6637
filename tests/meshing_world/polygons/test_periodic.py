"""Periodic sides: the same points on both, whatever the rest of the boundary asks for, and even totals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.polygons import periodic
from envs.polygons.boundary import boundary
from envs.polygons.discretisation import conforming, counts_of, discretised, placed
from envs.polygons.parity import made_even
from envs.polygons.periodic import PeriodicSides, Twins, node_pairs, periodic_sides
from envs.polygons.sizing import Sizes, sizes
from envs.types import DomainError, Floats

SQUARE = np.array([[0, 0], [4, 0], [4, 3], [0, 3]], dtype=float)
LEFT, RIGHT, BOTTOM, TOP = (SQUARE[[3, 0]], SQUARE[[1, 2]], SQUARE[[0, 1]], SQUARE[[2, 3]])
NAMES = ("left", "right")


def split_alike(
    polygons: Sequence[Sequence[Floats]], pairs: Sequence[PeriodicSides], edge_length: float | None, **options: float
) -> list[list[Floats]]:
    """What `discretised` does, with periodic sides."""
    coarse, corner = (0.0, np.radians(20.0)) if edge_length is None else (edge_length, np.radians(20.0))
    graph = boundary(conforming(polygons) if edge_length else polygons, coarse, corner)
    whole = polygons
    if edge_length is not None:
        keep = periodic.common_nodes(graph, pairs)
        whole = conforming(polygons, keep)
        graph = boundary(whole, coarse, corner, keep)
    twins = periodic.twins_of(graph, pairs, "test")
    if edge_length is None:
        longest = max(chain.length for chain in graph.chains)
        along = [Sizes.even(chain.length, longest) for chain in graph.chains]
        counts = np.ones(len(graph.chains), dtype=np.int64)
    else:
        along = sizes(graph, whole, "test", edge_length=edge_length, **options)
        along = periodic.with_equal_sizes(along, twins)
        counts = counts_of(graph, along, "test", bulge=0.5 * float(np.tan(np.pi / options.get("curvature", 16.0))))
        periodic.equal_counts(counts, twins)
    users: list[list[int]] = [[] for _ in graph.chains]
    for p, polygon in enumerate(graph.rings):
        for ring in polygon:
            for use in ring:
                users[use.chain].append(p)
    totals = [sum(int(counts[use.chain]) for ring in polygon for use in ring) for polygon in graph.rings]
    costs = np.abs(np.log(np.array([each.measure for each in along]) / (counts + 1)))
    chosen = made_even(*periodic.tied(users, costs, twins), [p for p, total in enumerate(totals) if total % 2])
    assert chosen is not None
    counts[list(periodic.with_twins(chosen, twins))] += 1
    vertices = [placed(c, s, int(n)) for c, s, n in zip(graph.chains, along, counts, strict=True)]
    return [
        [
            np.concatenate([vertices[u.chain][:0:-1] if u.backward else vertices[u.chain][:-1] for u in ring])
            for ring in polygon
        ]
        for polygon in graph.rings
    ]


def check(rings: Sequence[Sequence[Floats]], pair: PeriodicSides) -> int:
    """Both sides have the same points; how many."""
    every = np.concatenate([ring for polygon in rings for ring in polygon])
    points, index = np.unique(every, axis=0, return_inverse=True)
    index = index.ravel()
    bounds = np.cumsum([0, *(len(ring) for polygon in rings for ring in polygon)])
    segments = np.concatenate([
        np.stack([index[a:b], np.roll(index[a:b], -1)], axis=1) for a, b in zip(bounds[:-1], bounds[1:], strict=True)
    ])  # fmt: skip
    pairs = node_pairs(points, segments, pair, "test")
    gap = np.linalg.norm(pair.motion(points[pairs[:, 0]]) - points[pairs[:, 1]], axis=1)
    assert gap.max() <= 4.0 * pair.near
    # From end to end of both.
    line, image = shapely.LineString(pair.first), shapely.LineString(pair.second)
    for side, mine in ((line, points[pairs[:, 0]]), (image, points[pairs[:, 1]])):
        along = shapely.line_locate_point(side, shapely.points(mine))
        assert (np.diff(along) > 0.0).all()
    for polygon in rings:
        assert sum(len(ring) for ring in polygon) % 2 == 0
    return len(pairs)


def wavy(seed: int, fine: int) -> tuple[Floats, Floats, Floats]:
    """A cell whose left and right sides are one curve, moved; its ring, and both sides."""
    rng = np.random.default_rng(seed)
    t = np.sort(np.concatenate([[0.0, 1.0], rng.uniform(0.02, 0.98, fine)]))
    side = np.stack([0.3 * np.sin(2 * np.pi * t * rng.integers(1, 3)), 3.0 * t], axis=1)
    right = side + np.array([5.0, rng.uniform(-0.5, 0.5)])
    top = np.stack([np.linspace(right[-1, 0], side[-1, 0], 4)[1:-1], 3.0 + rng.uniform(0.4, 0.8, 2)], axis=1)
    bottom = np.stack([np.linspace(side[0, 0], right[0, 0], 5)[1:-1], rng.uniform(-1.4, -0.8, 3)], axis=1)
    return np.concatenate([side[::-1], bottom, right, top]), side, right


@pytest.mark.slow
@settings(max_examples=60)
@given(
    seed=st.integers(0, 10_000), fine=st.sampled_from([3, 40, 300]), edge_length=st.floats(0.15, 2.0),
    grading=st.sampled_from([1.0, 4.0]), turn=st.floats(0.0, 6.0), flips=st.tuples(st.booleans(), st.booleans()),
    hole=st.booleans(),
)  # fmt: skip
def test_translates_get_the_same_points(
    seed: int, fine: int, edge_length: float, grading: float, turn: float, flips: tuple[bool, bool], hole: bool
) -> None:
    ring, first, second = wavy(seed, fine)
    spin = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    # A small hole near one of the sides makes it finer, and so the other.
    disc = np.array([0.75, 1.5]) + 0.2 * np.stack([np.cos(np.arange(12) / 1.9), np.sin(np.arange(12) / 1.9)], axis=1)
    rings = [ring @ spin, disc @ spin] if hole else [ring @ spin]
    sides = [(side @ spin)[:: -1 if flip else 1] for side, flip in zip((first, second), flips, strict=True)]
    pair = periodic_sides([sides[0]], [sides[1]], [rings], "cell", NAMES)
    np.testing.assert_allclose(pair.motion(sides[0][:: -1 if flips[0] else 1]), second @ spin, atol=1e-6)
    split = split_alike([rings], [pair], edge_length, grading=grading)
    assert check(split, pair) >= 2
    assert {tuple(point) for point in sides[0][[0, -1]].tolist()} <= {tuple(p) for p in split[0][0].tolist()}


@settings(max_examples=30)
@given(degrees=st.floats(8.0, 170.0), inner=st.sampled_from([0.0, 0.4]), edge_length=st.floats(0.05, 0.6))
def test_sides_turned_around_a_point_get_the_same_points(degrees: float, inner: float, edge_length: float) -> None:
    t = np.radians(np.linspace(0.0, degrees, 40))
    arc = np.stack([np.cos(t), np.sin(t)], axis=1)
    ring = np.concatenate([2.0 * arc, inner * arc[::-1] if inner else [[0.0, 0.0]]])
    first = np.array([inner * arc[0], 2.0 * arc[0]])
    # One vertex more on the second side alone.
    second = np.array([2.0 * arc[-1], 1.3 * arc[-1], inner * arc[-1]])
    ring = np.insert(ring, 40, second[1], axis=0)
    pair = periodic_sides([first], [second], [[ring]], "sector", NAMES)
    np.testing.assert_allclose(pair.motion(np.array([[1.0, 0.0]])), [arc[-1]], atol=1e-12)
    split = split_alike([[ring]], [pair], edge_length)
    check(split, pair)
    assert tuple(second[1]) in {tuple(point) for point in split[0][0].tolist()}


def test_an_odd_total_never_goes_to_one_of_two_sides() -> None:
    # Without periodic sides the one more goes to a long side.
    ring = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 9.0], [0.4, 9.9], [0.0, 9.0]])
    pair = periodic_sides([ring[[4, 0]]], [ring[[1, 2]]], [[ring]], "house", NAMES)
    for edge_length in (None, 1.0, 2.0, 3.0):
        plain = discretised([[ring]], "house", edge_length=edge_length)[0][0]
        split = split_alike([[ring]], [pair], edge_length)
        count = check(split, pair)
        on = [int((plain[:, 0] == x).sum()) for x in (0.0, 1.0)]
        if edge_length is None:
            assert on == [3, 2] or on == [2, 3]
            assert count == 2


def test_a_cell_periodic_both_ways_of_two_polygons() -> None:
    left, right = np.array([[0, 0], [1.7, 0], [1.7, 3], [0, 3.0]]), np.array([[1.7, 0], [4, 0], [4, 3], [1.7, 3.0]])
    cell = [[left], [right]]
    across = periodic_sides([LEFT], [RIGHT], cell, "cell", NAMES)
    up = periodic_sides([left[:2], right[:2]], [right[2:], left[2:]], cell, "cell", ("bottom", "top"))
    for edge_length in (0.3, 0.37, 0.5, 0.77, 1.1):
        split = split_alike(cell, [across, up], edge_length)
        check(split, across)
        check(split, up)
        assert tuple(across.motion.shift) == (4.0, 0.0)
    assert (across.motion.turn == np.eye(2)).all()


def test_twins_get_one_more_segment_both_or_none() -> None:
    twins = [Twins(0, 1, True)]
    # Chain 2 is dear: both polygons are made even by the twins, one on each.
    users, costs = periodic.tied([[0], [1], [0, 1]], np.array([0.1, 0.2, 0.9]), twins)
    np.testing.assert_allclose(costs, [0.3, 0.2, 0.9])
    assert made_even(users, costs, [0, 1]) == {0}
    assert periodic.with_twins({0}, twins) == {0, 1}
    assert periodic.with_twins({2}, twins) == {2}
    # Of one polygon twins change nothing: another chain has to.
    users, costs = periodic.tied([[0], [0], [0]], np.array([0.1, 0.2, 0.9]), twins)
    assert made_even(users, costs, [0]) == {2}
    assert made_even(*periodic.tied([[0], [0]], np.array([0.1, 0.2]), twins), [0]) is None


def test_the_finer_side_rules() -> None:
    for hole in (0.75, 3.25):
        small = np.array([hole, 1.5]) + 0.6 * np.stack([np.cos(np.arange(6.0)), np.sin(np.arange(6.0))], axis=1)
        pair = periodic_sides([LEFT], [RIGHT], [[SQUARE, small]], "p", NAMES)
        plain = discretised([[SQUARE, small]], "p", edge_length=0.5, grading=8.0)[0][0]
        finest = max(int((plain[:, 0] == x).sum()) for x in (0.0, 4.0))
        assert finest > 9, "the hole is close"
        assert check(split_alike([[SQUARE, small]], [pair], 0.5, grading=8.0), pair) >= finest - 1


def test_what_is_not_periodic_is_told() -> None:
    bent = np.array([[0, 0], [4, 0], [4.3, 1.5], [4, 3], [0, 3]], dtype=float)
    with pytest.raises(DomainError, match=r"^p: sides 'left' and 'right' are .*: \(4\.3, 1\.5\) is 0\.3 away"):
        periodic_sides([bent[[4, 0]]], [bent[1:4]], [[bent]], "p", NAMES)
    with pytest.raises(DomainError, match=r"sides 'left' and 'bottom' are not periodic: .* is [\d.]+ away"):
        periodic_sides([LEFT], [BOTTOM], [[SQUARE]], "p", ("left", "bottom"))
    with pytest.raises(DomainError, match=r"^p: side 'left' is not on the boundary at \(1\.0, 1\.0\)"):
        periodic_sides([LEFT * 0 + [[1, 1], [1, 2]]], [RIGHT], [[SQUARE]], "p", NAMES)
    with pytest.raises(DomainError, match=r"^p: side 'left' is not one open line"):
        periodic_sides([LEFT, RIGHT], [RIGHT], [[SQUARE]], "p", NAMES)
    with pytest.raises(DomainError, match="not one open line"):
        periodic_sides([np.concatenate([SQUARE, SQUARE[:1]])], [RIGHT], [[SQUARE]], "p", NAMES)
    with pytest.raises(DomainError, match="not one open line"):
        periodic_sides([], [RIGHT], [[SQUARE]], "p", NAMES)
    with pytest.raises(DomainError, match="they meet at more than a common end"):
        periodic_sides([LEFT], [LEFT], [[SQUARE]], "p", NAMES)


def test_different_vertices_without_an_edge_length_are_told() -> None:
    ring = np.insert(SQUARE, 2, [4.0, 1.0], axis=0)
    ring = np.insert(ring, 1, [2.0, 0.0], axis=0)
    pair = periodic_sides([LEFT], [ring[2:5]], [[ring]], "p", NAMES)
    with pytest.raises(DomainError, match=r"^test: sides 'left' and 'right' have different vertices.*--edge-len"):
        split_alike([[ring]], [pair], None)
    check(split_alike([[ring]], [pair], 10.0), pair)
    again = periodic_sides([RIGHT[::-1]], [LEFT], [[SQUARE]], "p", ("right", "left"))
    with pytest.raises(DomainError, match=r"of the boundary is in two pairs"):
        split_alike([[SQUARE]], [periodic_sides([LEFT], [RIGHT], [[SQUARE]], "p", NAMES), again], 1.0)


def test_vertices_without_an_image_are_told() -> None:
    pair = periodic_sides([LEFT], [RIGHT], [[SQUARE]], "p", NAMES)
    points = np.insert(SQUARE, 4, [0.0, 1.0], axis=0)
    i = np.arange(5)
    with pytest.raises(DomainError, match=r"near \(0\.0, 1\.0\)"):
        node_pairs(points, np.stack([i, (i + 1) % 5], axis=1), pair, "p")
    points = np.insert(SQUARE, 2, [4.0, 1.0], axis=0)
    with pytest.raises(DomainError, match="different vertices"):
        node_pairs(points, np.stack([i, (i + 1) % 5], axis=1), pair, "p")
