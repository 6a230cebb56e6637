"""Rings in, domains out: what is kept, what seams look like, and what every bad ring is told."""

from __future__ import annotations

import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from checkout import REFERENCES
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.domains.catalogue import design
from envs.domains.load import catalogue, from_polygon, from_ring_with_seam, from_rings, load
from envs.domains.random_domain import random_domain
from envs.polygons.outline import discretise
from envs.polygons.rings import loops, signed_area
from envs.types import Domain, DomainError, Floats

SQUARE = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
HOLE = np.array([[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]])


def wavy(n: int, radius: float = 1.0, centre: tuple[float, float] = (0.0, 0.0)) -> Floats:
    """An (n, 2) ring with nine lobes."""
    t = 2 * np.pi * np.arange(n) / n
    r = radius * (1.0 + 0.3 * np.sin(9 * t))
    return np.stack([centre[0] + r * np.cos(t), centre[1] + r * np.sin(t)], axis=1)


def segment_set(domain: Domain) -> set[frozenset[tuple[float, float]]]:
    """The given segments by coordinates, without direction."""
    return {frozenset((tuple(a), tuple(b))) for a, b in domain.points[domain.segments].tolist()}


def ring_segments(*rings: Floats) -> set[frozenset[tuple[float, float]]]:
    """The segments of rings by coordinates, without direction."""
    closed = [[*map(tuple, ring.tolist()), tuple(ring[0].tolist())] for ring in rings]
    return {frozenset(pair) for ring in closed for pair in pairwise(ring)}


def polygon_of(domain: Domain) -> shapely.Geometry:
    """The polygon that the given segments enclose, without the seams."""
    faces = shapely.get_parts(shapely.polygonize(shapely.linestrings(domain.points[domain.segments])))
    return max(faces, key=lambda face: face.envelope.area)


def assert_sound(domain: Domain) -> None:
    """What holds of every domain: an even, planar, counter-clockwise walk with seams walked once in each direction."""
    assert len(domain.ring) % 2 == 0
    assert domain.points.dtype == np.float64
    assert domain.ring.dtype == domain.segments.dtype == np.int64
    assert len(np.unique(domain.points, axis=0)) == len(domain.points)
    assert set(domain.ring.tolist()) == set(range(len(domain.points)))
    walked = list(zip(domain.ring.tolist(), np.roll(domain.ring, -1).tolist(), strict=True))
    assert len(set(walked)) == len(walked)
    given = [tuple(edge) for edge in domain.segments.tolist()]
    assert len(set(given)) == len(given)
    seams = set(walked) - set(given)
    assert set(given) <= set(walked)
    assert seams == {(b, a) for a, b in seams}
    assert not any((b, a) in set(given) for a, b in given)
    assert len(domain.ring) == len(domain.segments) + len(seams)
    face = polygon_of(domain)
    assert face.is_valid
    assert domain.area == pytest.approx(face.area, rel=1e-9)
    middles = domain.points[np.array(sorted(seams), dtype=np.int64).reshape(-1, 2)].mean(axis=1)
    assert shapely.contains_xy(face, middles).all()


# What is kept


@pytest.mark.parametrize("name", catalogue())
def test_catalogue_is_sound(name: str) -> None:
    assert_sound(load(name))


@pytest.mark.parametrize("path", REFERENCES, ids=lambda path: path.stem)
def test_reference_domains_are_read(path: Path) -> None:
    assert_sound(load(path))


def test_the_authors_seam_is_recognised() -> None:
    path = next((p for p in REFERENCES if p.stem == "boundary_hole_r2-2"), None)
    if path is None:
        pytest.skip("the reference domains are not here")
    domain = load(path)
    assert (len(domain.ring), len(domain.points), len(domain.segments)) == (268, 251, 236)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2000), shift=st.integers(0, 300))
def test_orientation_start_and_closing_point_do_not_matter(seed: int, shift: int) -> None:
    ring = random_domain(seed, holes=0).vertices
    straight = from_rings(ring)
    other = np.roll(ring, shift, axis=0)[::-1]
    turned = from_rings(np.concatenate([other, other[:1]]))
    assert segment_set(straight) == segment_set(turned) == ring_segments(ring)
    assert straight.area == pytest.approx(turned.area, rel=1e-12)
    assert straight.area == pytest.approx(shapely.Polygon(ring).area, rel=1e-12)
    assert turned.area > 0


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2000), holes=st.integers(1, 4), shift=st.integers(0, 300), reverse=st.booleans())
def test_seams_open_a_polygon_and_are_read_back(seed: int, holes: int, shift: int, reverse: bool) -> None:
    domain = random_domain(seed, holes=holes, vertices=70)
    assert_sound(domain)
    ring = np.roll(domain.vertices, shift, axis=0)[:: -1 if reverse else 1]
    again = from_ring_with_seam(ring)
    assert_sound(again)
    assert segment_set(again) == segment_set(domain)
    assert again.area == pytest.approx(domain.area, rel=1e-12)
    assert {tuple(p) for p in again.points.tolist()} == {tuple(p) for p in domain.points.tolist()}


def test_points_come_in_the_documented_order() -> None:
    domain = from_rings(SQUARE[::-1], [HOLE, HOLE + 1.5], "plate")
    assert domain.name == "plate"
    np.testing.assert_array_equal(domain.points[0], SQUARE[-1])
    assert ring_segments(domain.points[:4]) == ring_segments(SQUARE)
    assert ring_segments(domain.points[4:8]) == ring_segments(HOLE)
    assert ring_segments(domain.points[8:12]) == ring_segments(HOLE + 1.5)
    assert segment_set(domain) == ring_segments(SQUARE, HOLE, HOLE + 1.5)


@pytest.mark.slow
@given(st.sampled_from([("T1", 1), ("D9", 2), ("part:1", 6)]), st.integers(0, 1000))
def test_loops_are_the_rings_whatever_the_order_of_the_segments(named: tuple[str, int], seed: int) -> None:
    domain = load(named[0])
    found = loops(domain.segments)
    assert len(found) == named[1]
    areas = [signed_area(domain.points[loop]) for loop in found]
    assert [area > 0 for area in areas] == [True] + [False] * (len(areas) - 1)
    assert sum(areas) == pytest.approx(domain.area)
    shuffled = loops(np.random.default_rng(seed).permutation(domain.segments))
    for loop in shuffled:
        (same,) = (other for other in found if loop[0] in other)
        assert loop.tolist() == np.roll(same, -int(np.flatnonzero(same == loop[0])[0])).tolist()


def test_coordinates_are_kept_to_the_last_bit() -> None:
    ring = wavy(60) * np.pi + 1e6 / 3
    domain = from_rings(ring)
    np.testing.assert_array_equal(np.sort(domain.points, axis=0), np.sort(ring, axis=0))


def test_integers_and_tuples_are_accepted() -> None:
    assert from_rings(((0, 0), (4, 0), (4, 4), (0, 4))).area == 16.0


def test_a_seam_is_short_straight_and_square_to_the_boundary() -> None:
    domain = from_rings(discretise(SQUARE, 80), [discretise(HOLE, 20)])
    seam = domain.points[100:]
    assert len(seam) == 4, "one unit long, the boundary's segments a fifth"
    steps = np.diff(seam, axis=0)
    np.testing.assert_allclose(np.linalg.norm(steps, axis=1), 0.2, rtol=1e-12)
    assert np.abs(steps).min(axis=1).max() < 1e-12, "parallel to an axis"


def test_many_holes_on_a_grid_are_joined() -> None:
    holes = [0.5 * (HOLE - 1.0) + [x, y] for x in range(1, 9) for y in range(1, 9)]
    angle = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    for turn in (np.eye(2), angle):
        domain = from_rings(2.5 * SQUARE @ turn, [hole @ turn for hole in holes])
        assert_sound(domain)
        assert domain.area == pytest.approx(100.0 - 16.0)


@pytest.mark.slow
def test_large_rings_are_quick() -> None:
    started = time.perf_counter()
    domain = from_rings(wavy(20_000), [wavy(4_000, 0.2, (0.2, 0.1))])
    assert time.perf_counter() - started < 8.0
    assert len(domain.segments) == 24_000


def test_polygons_of_shapely_are_accepted() -> None:
    polygon = shapely.Polygon(SQUARE, [HOLE])
    assert from_polygon(polygon, "plate").area == pytest.approx(polygon.area)


# Parity


def test_odd_rings_offer_the_fix_and_take_it() -> None:
    ring = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 2.0], [0.0, 1.0]])
    with pytest.raises(DomainError, match=r"5 boundary vertices.*odd.*use --fix-parity \(fix_parity=True in Python\)"):
        from_rings(ring)
    domain = from_rings(ring, fix_parity=True)
    np.testing.assert_array_equal(domain.points, np.insert(ring, 1, [1.5, 0.0], axis=0))


def test_parity_counts_the_holes_and_not_the_seams() -> None:
    with pytest.raises(DomainError, match="7 boundary vertices"):
        from_rings(SQUARE, [HOLE[:3]])
    assert_sound(from_rings(SQUARE, [HOLE[:3]], fix_parity=True))
    assert_sound(from_rings(np.insert(SQUARE, 1, [2.0, 0.0], axis=0), [HOLE[:3]]))


def test_parity_is_fixed_with_a_given_seam_too() -> None:
    ring = np.array([*SEAMED, [-1.0, 2.0]])
    with pytest.raises(DomainError, match="odd"):
        from_ring_with_seam(ring)
    domain = from_ring_with_seam(ring, fix_parity=True)
    assert_sound(domain)
    assert len(domain.segments) == 10


# What bad rings are told: source, place, fix


BAD_RINGS = {
    "nan": ([[0, 0], [1, 0], [1, np.nan], [0, 1]], r"vertex 2 at \(1.0, nan\): coordinate not finite"),
    "inf": ([[0, 0], [1, 0], [np.inf, 1], [0, 1]], r"vertex 2 at \(inf, 1.0\): coordinate not finite"),
    "huge": ([[0, 0], [1, 0], [1e200, 1], [0, 1]], "vertex 2 .*too large"),
    "whole number beyond floats": ([[0, 0], [1, 0], [10**400, 1], [0, 1]], r"not a list of \[x, y\] pairs"),
    "empty": ([], "no vertices"),
    "flat list": ([1.0, 2.0, 3.0], r"shape \(3,\)"),
    "ragged": ([[0, 0], [1]], r"not a list of \[x, y\] pairs"),
    "text": ([["a", "b"]], r"not a list of \[x, y\] pairs"),
    "nothing": (None, r"not a list|shape \(\)"),
    "triangle": ([[0, 0], [1, 0], [1, 1]], "3 vertices, at least 4"),
    "closed triangle": ([[0, 0], [1, 0], [1, 1], [0, 0]], "3 vertices, at least 4"),
    "repeated neighbour": ([[0, 0], [1, 0], [1, 0], [0, 1]], r"vertex 2 at \(1.0, 0.0\): repeats vertex 1; remove"),
    "pinch": ([[0, 0], [2, 0], [1, 1], [2, 2], [0, 2], [1, 1]], r"vertex 5 at \(1.0, 1.0\) repeats .*2: a pinch"),
    "one line": ([[0, 0], [1, 0], [2, 0], [3, 0]], "degenerate, zero area"),
    "one line, slanted": ([[0, 0], [1, 1 / 3], [2, 2 / 3], [0.3, 0.1]], "degenerate, zero area"),
    "crossing": ([[0, 0], [1, 1], [1, 0], [0, 1]], r"crosses itself: segments 0 and 2 meet at \(0.5, 0.5\)"),
    "touching": ([[0, 0], [4, 0], [4, 4], [2, 0], [0, 4], [0, 2]], r"segments 0 and 2 meet at \(2.0, 0.0\)"),
    "spike": ([[0, 0], [4, 0], [2, 4], [2, 6], [2, 5], [0, 4]], r"a spike at \(2.0, 6.0\): segment 3 folds"),
}  # fmt: skip


@pytest.mark.parametrize(("ring", "message"), BAD_RINGS.values(), ids=BAD_RINGS.keys())
def test_bad_rings(ring: list, message: str) -> None:
    for read in (from_rings, from_ring_with_seam):
        if read is from_ring_with_seam and "pinch" in message:
            message = r"vertex 5 at \(1.0, 1.0\) repeats vertex 2: a pinch.*no seam"
        with pytest.raises(DomainError, match=message) as caught:
            read(ring, name="plate")
        text = str(caught.value)
        assert text.startswith("plate: ")
        assert "\n" not in text
        assert ";" in text, "a fix follows the problem"


BAD_HOLES = {
    "outside": ([HOLE + 10.0], r"hole 0, vertex 0 at \(11.0, 11.0\): lies outside the outer ring"),
    "around": ([10.0 * HOLE - 14.0], "hole 0, vertex 0 .*lies outside the outer ring"),
    "crossing the outer ring": ([HOLE + 2.5], "hole 0 crosses or touches .*its segment 0 meets segment 1"),
    "touching the outer ring": ([HOLE + np.array([2.0, 0.5])], "hole 0 crosses or touches the outer ring"),
    "sharing a vertex": ([HOLE - 1.0], "hole 0, vertex 0 .*repeats outer ring, vertex 0: the two rings touch"),
    "in another hole": ([HOLE, 0.5 * HOLE + 0.75], "hole 1, vertex 0 .*lies inside hole 0"),
    "crossing another hole": ([HOLE, HOLE + 0.5], r"hole 1 crosses or touches hole 0: .* at \(2.0, 1.5\)"),
    "corner at another hole's": ([HOLE, HOLE + 1.0], "hole 1, vertex 0 .*repeats hole 0, vertex 2: the two"),
    "crossing itself": ([HOLE[[0, 2, 1, 3]]], "hole 0 crosses itself: segments 0 and 2"),
    "two vertices": ([HOLE[:2]], "hole 0: 2 vertices"),
    "nan": ([HOLE * np.nan], "hole 0, vertex 0 .*not finite"),
}  # fmt: skip


@pytest.mark.parametrize(("holes", "message"), BAD_HOLES.values(), ids=BAD_HOLES.keys())
def test_bad_holes(holes: list, message: str) -> None:
    with pytest.raises(DomainError, match=message) as caught:
        from_rings(SQUARE, holes, "plate")
    assert str(caught.value).startswith("plate: ")


#: A square with a square hole and a seam of one segment.
SEAMED = [[0, 0], [1, 1], [1, 2], [2, 2], [2, 1], [1, 1], [0, 0], [4, 0], [4, 4], [0, 4]]

BAD_SEAMS = {
    "slit": ([[0, 0], [1, 1], [0, 0], [4, 0], [4, 4], [0, 4]], r"a spike at vertex 1 at \(1.0, 1.0\)"),
    "hole walked the wrong way": ([*SEAMED[:2], *SEAMED[4:1:-1], *SEAMED[5:]], "walked across itself .*pinch"),
    "bridge outside": (
        [[0, 0], [-1, -1], [-2, -1], [-2, -2], [-1, -2], [-1, -1], *SEAMED[6:]],
        "walked across itself .*pinch",
    ),
    "hole outside": (
        [[0, 0], [5, 5.5], [5, 6], [6, 6], [6, 5.5], [5, 5.5], [0, 0], [4, 0], [4, 4], [0, 4]],
        r"crosses itself: segments 0 and 8 meet",
    ),
    "hole across the outer ring": (
        [[0, 0], [1, 1], [1, 2], [5, 2], [5, 1], [1, 1], *SEAMED[6:]],
        "crosses itself: segments 2 and 7",
    ),
    "walked twice": (SEAMED[6:] * 2, "repeats vertex 0: a pinch"),
    "rounded": ([*SEAMED[:5], [1, 1 + 1e-12], *SEAMED[6:]], "vertex 5 .*repeats vertex 1 but for rounding"),
}  # fmt: skip


@pytest.mark.parametrize(("ring", "message"), BAD_SEAMS.values(), ids=BAD_SEAMS.keys())
def test_bad_seams(ring: list, message: str) -> None:
    assert_sound(from_ring_with_seam(SEAMED))
    with pytest.raises(DomainError, match=message):
        from_ring_with_seam(ring, "plate")


GRID = st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=1, max_size=9)


@settings(max_examples=300, deadline=None)
@given(ring=GRID)
def test_any_ring_is_sound_or_refused_as_shapely_says(ring: list[tuple[int, int]]) -> None:
    closed = ring[1:] if ring[0] == ring[-1] and len(ring) > 1 else ring
    good = len(closed) >= 4 and len(set(closed)) == len(closed) and shapely.Polygon(closed).is_valid
    try:
        domain = from_rings(ring, fix_parity=True)
    except DomainError:
        assert not good
    else:
        assert good
        assert_sound(domain)


@settings(max_examples=150, deadline=None)
@given(hole=GRID, other=GRID, scale=st.sampled_from([0.1, 1.0, 1 / 3]))
def test_any_hole_is_sound_or_refused(hole: list[tuple[int, int]], other: list[tuple[int, int]], scale: float) -> None:
    holes = [scale * np.array(hole), scale * (np.array(other) + np.array([7, 0]))]
    try:
        domain = from_rings(scale * np.array([(-1, -1), (15, -1), (15, 7), (-1, 7)]), holes, fix_parity=True)
    except DomainError:
        return
    assert_sound(domain)


def test_a_seam_in_from_rings_is_a_pinch() -> None:
    with pytest.raises(DomainError, match="pinch"):
        from_rings(SEAMED)


@pytest.mark.parametrize("shape", [shapely.Point(0, 0), shapely.Polygon()])
def test_shapely_shapes_that_are_no_polygon(shape: shapely.Geometry) -> None:
    with pytest.raises(DomainError, match=r"plate: .*polygon"):
        from_polygon(shape, "plate")


# The catalogue


def lengths(domain: Domain) -> Floats:
    """(s,) lengths of the given segments."""
    return np.linalg.norm(np.diff(domain.points[domain.segments], axis=1)[:, 0], axis=1)


def angles(domain: Domain) -> Floats:
    """(s,) inner angles in degrees at the given vertices of a domain without holes."""
    here = domain.vertices
    ahead, behind = np.roll(here, -1, axis=0) - here, np.roll(here, 1, axis=0) - here
    cross = ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0]
    return np.degrees(np.arctan2(cross, (ahead * behind).sum(axis=1))) % 360.0


def test_catalogue_names() -> None:
    assert sorted(catalogue()) == [*(f"D{i}" for i in range(1, 10)), "T1", "T2", "T3"]


@pytest.mark.parametrize(("name", "vertices"), [("D1", 102), ("D2", 150), ("D3", 304)])
def test_the_study_shape(name: str, vertices: int) -> None:
    domain = load(name)
    assert len(domain.segments) == len(domain.ring) == vertices
    assert lengths(domain).sum() == pytest.approx(15.1, abs=1e-9)
    assert lengths(domain).max() / lengths(domain).min() < 1.3


def test_training_domains_grow_harder() -> None:
    domains = [load(name) for name in ("T1", "T2", "T3")]
    counts, sharpest = [len(d.ring) for d in domains], [angles(d).min() for d in domains]
    uneven = [lengths(d).max() / lengths(d).min() for d in domains]
    assert counts == [72, 100, 144]
    assert sharpest[0] > 40 > sharpest[1] > 30 > sharpest[2] > 24
    assert 1.5 < uneven[0] < uneven[1] < uneven[2] < 3.1


@pytest.mark.parametrize("name", ["D7", "D8", "D9"])
def test_hard_domains(name: str) -> None:
    domain = load(name)
    assert 150 <= len(domain.segments) <= 400
    assert angles(domain).min() < 40
    assert lengths(domain).max() / lengths(domain).min() > 2
    assert (len(domain.ring) > len(domain.segments)) == (name == "D9")


@pytest.mark.parametrize("make", design.DESIGNS)
def test_the_data_is_what_the_design_writes(make) -> None:
    drawn = make()
    assert (design.FOLDER / f"{drawn.name}.svg").stat().st_size < 60_000
    expected = from_rings(drawn.rings[0], drawn.rings[1:], drawn.name)
    # Another version of GEOS may round an arc differently in the last bits.
    np.testing.assert_allclose(load(drawn.name).points, expected.points, atol=1e-9)
