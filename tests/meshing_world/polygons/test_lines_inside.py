"""Polygons divided by lines, and the rings that go along both sides of lines that divide nothing."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.mdp.front import RING, ring_slots, template, wanted
from envs.polygons.close_places import close_sizes
from envs.polygons.discretisation import discretised
from envs.polygons.faces import divided
from envs.polygons.rings import signed_area
from envs.polygons.slits import slit_domain
from envs.polygons.with_lines import domains_with_lines
from envs.types import Domain, DomainError, Floats, MeshingParameters

NOWHERE = np.zeros((0, 2))
SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float64)
HOLE = np.array([[0.4, 0.4], [0.6, 0.4], [0.6, 0.6], [0.4, 0.6]])
RIGHT = SQUARE + [1.0, 0.0]
POLYGONS = {
    "square": [[SQUARE]],
    "with a hole": [[SQUARE, HOLE]],
    "two": [[SQUARE], [RIGHT]],
    "clockwise": [[SQUARE[::-1], HOLE]],
}

places_in = st.tuples(st.integers(-2, 22), st.integers(-2, 12)).map(lambda p: (p[0] / 10 + 0.013, p[1] / 10 + 0.007))
# On a grid that sides and each other's ends lie on, too: touching is as likely as crossing.
corners = st.tuples(st.integers(0, 20), st.integers(0, 10)).map(lambda p: (p[0] / 10, p[1] / 10))
polylines = st.lists(places_in | corners, min_size=2, max_size=4, unique=True).map(np.array)


def lines_of(*lines: list[tuple[float, float]]) -> list[Floats]:
    """Lines from lists of points."""
    return [np.array(line, dtype=np.float64) for line in lines]


def square(edge_length: float, *lines: list[tuple[float, float]], places: Floats = NOWHERE) -> list[Domain]:
    """The domains of the unit square with lines."""
    faces = divided([[SQUARE]], lines_of(*lines), places, "square")
    rings = discretised([face.rings for face in faces], "square", edge_length=edge_length)
    return [slit_domain("square", ring, face.places, "square") for ring, face in zip(rings, faces, strict=True)]


def corner_angles(domain: Domain) -> Floats:
    """(n,) the angle inside the ring at each of its vertices, all of it at a tip."""
    here = domain.vertices
    ahead, behind = np.roll(here, -1, axis=0) - here, np.roll(here, 1, axis=0) - here
    turn = np.arctan2(ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0], (ahead * behind).sum(axis=1)) % (
        2 * np.pi
    )
    turn[np.roll(domain.ring, 1) == np.roll(domain.ring, -1)] = 2 * np.pi
    return turn


def check(domain: Domain) -> None:
    """A ring that an all-quad mesh is possible in, which walks its lines in both directions."""
    steps = list(zip(domain.ring.tolist(), np.roll(domain.ring, -1).tolist(), strict=True))
    assert len(domain.ring) % 2 == 0
    assert len(set(steps)) == len(steps)
    assert all((a, b) in steps and (b, a) in steps for a, b in domain.lines.tolist())
    assert all((a, b) in steps and (b, a) not in steps for a, b in domain.segments.tolist())
    # Simple but for what touches: the sum of a polygon's angles, each in the right corner.
    assert corner_angles(domain).sum() == pytest.approx((len(domain.ring) - 2) * np.pi)
    assert set(domain.ring.tolist()) == set(range(len(domain.points)))


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(sorted(POLYGONS)), st.lists(polylines, max_size=3), st.lists(places_in, max_size=3, unique=True))
def test_faces_are_those_that_the_drawing_has(
    name: str, lines: list[Floats], places: list[tuple[float, float]]
) -> None:
    polygons = POLYGONS[name]
    faces = divided(polygons, lines, np.array(places).reshape(-1, 2), name)
    shapes = [shapely.Polygon(rings[0], rings[1:]) for rings in polygons]
    drawn = shapely.unary_union([*(shape.boundary for shape in shapes), *map(shapely.LineString, lines)])
    inside = [
        part
        for part in shapely.get_parts(shapely.polygonize(list(shapely.get_parts(drawn))))
        if any(shape.contains(part.representative_point()) for shape in shapes)
    ]
    assert len(faces) == len(inside)
    for polygon, shape in enumerate(shapes):
        # Each walked with the inside to its left; a line that is walked out and back goes around nothing.
        areas = [signed_area(ring) for face in faces if face.polygon == polygon for ring in face.rings]
        assert sum(areas) == pytest.approx(shape.area)
    # What is drawn inside is walked: once by each of two faces, or twice by one.
    walked = sum(np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1).sum() for f in faces for ring in f.rings)
    outlines = sum(shape.length for shape in shapes)
    lines_inside = shapely.union_all(list(map(shapely.LineString, lines))).intersection(shapely.union_all(shapes))
    beside = shapely.union_all([shape.boundary for shape in shapes]).buffer(1e-9)
    assert walked == pytest.approx(outlines + 2.0 * lines_inside.difference(beside).length, abs=1e-6)
    given_points = {tuple(p) for rings in polygons for ring in rings for p in ring.tolist()}
    assert given_points <= {tuple(p) for face in faces for ring in face.rings for p in ring.tolist()}
    strictly = [p for p in places if any(shape.contains(shapely.Point(p)) for shape in shapes)]
    assert sum(len(face.places) + len(face.marks) for face in faces) >= len(strictly)


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(sorted(POLYGONS)), st.lists(polylines, max_size=3), st.lists(places_in, max_size=3, unique=True))
def test_one_ring_goes_along_both_sides(name: str, lines: list[Floats], places: list[tuple[float, float]]) -> None:
    polygons = POLYGONS[name]
    faces = divided(polygons, lines, np.array(places).reshape(-1, 2), name)
    rings = discretised([face.rings for face in faces], name, edge_length=0.09)
    domains = [slit_domain(name, ring, face.places, name) for ring, face in zip(rings, faces, strict=True)]
    for domain, face in zip(domains, faces, strict=True):
        check(domain)
        assert {tuple(p) for p in domain.points[domain.held].tolist()} == {tuple(p) for p in face.places.tolist()}
    total = sum(shapely.Polygon(rings[0], rings[1:]).area for rings in polygons)
    assert sum(domain.area for domain in domains) == pytest.approx(total)


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(sorted(POLYGONS)), st.lists(polylines, max_size=3), st.lists(places_in, max_size=3, unique=True))
def test_given_boundaries_keep_their_vertices(
    name: str, lines: list[Floats], places: list[tuple[float, float]]
) -> None:
    polygons = discretised(POLYGONS[name], name, edge_length=0.11)
    domains = domains_with_lines(polygons, lines, np.array(places).reshape(-1, 2), name, name)
    for domain in domains:
        check(domain)
    points = {tuple(p) for domain in domains for p in domain.points.tolist()}
    assert {tuple(p) for rings in polygons for ring in rings for p in ring.tolist()} <= points
    inside = shapely.union_all([shapely.Polygon(rings[0], rings[1:]) for rings in polygons])
    assert {tuple(p) for p in places if inside.contains(shapely.Point(p))} <= points
    assert {tuple(p) for line in lines for p in line.tolist() if inside.contains(shapely.Point(p))} <= points


def test_a_line_from_a_side_to_the_middle() -> None:
    (domain,) = square(0.1, [(0.0, 0.5), (0.5, 0.5)])
    assert len(domain.lines) == 5
    assert len(domain.segments) == 40
    assert len(domain.ring) == 50
    check(domain)


def test_a_line_that_floats_is_joined_by_a_seam() -> None:
    (domain,) = square(0.1, [(0.3, 0.5), (0.7, 0.5)])
    assert len(domain.lines) == 4
    assert len(domain.ring) == 40 + 8 + 2 * 3
    check(domain)


def test_a_line_from_side_to_side_divides() -> None:
    first, second = square(0.1, [(0.5, 0.0), (0.5, 1.0)])
    assert len(first.lines) == len(second.lines) == 0
    assert first.area == pytest.approx(0.5)
    common = {tuple(p) for p in first.points.tolist()} & {tuple(p) for p in second.points.tolist()}
    assert len(common) == 11


def test_lines_that_branch_walk_every_sector_of_the_junction() -> None:
    lines = [[(0.5, 0.5), (0.5 + 0.3 * np.cos(turn), 0.5 + 0.3 * np.sin(turn))] for turn in (0.3, 2.4, 4.5)]
    (domain,) = square(0.1, *lines)
    junction = int(np.flatnonzero((domain.points == 0.5).all(axis=1))[0])
    assert np.sum(domain.ring == junction) == 3
    check(domain)


def test_a_closed_line_is_a_face_in_a_face() -> None:
    turn = np.linspace(0.0, 2 * np.pi, 49)
    circle = np.stack([0.5 + 0.25 * np.cos(turn), 0.5 + 0.25 * np.sin(turn)], axis=1)
    circle[-1] = circle[0]
    outer, inner = square(0.1, [tuple(p) for p in circle.tolist()])
    assert outer.area + inner.area == pytest.approx(1.0)
    assert inner.area == pytest.approx(np.pi * 0.25**2, rel=0.05)


def test_along_a_side_a_line_changes_nothing() -> None:
    (face,) = divided([[SQUARE]], lines_of([(0.0, 0.0), (1.0, 0.0)]), NOWHERE, "square")
    assert face.rings[0].tolist() == SQUARE.tolist()


def test_what_lies_outside_is_left_out() -> None:
    (face,) = divided([[SQUARE]], lines_of([(0.5, 0.5), (0.5, 3.0)], [(2.0, 2.0), (3.0, 3.0)]), NOWHERE, "square")
    assert max(ring.max() for ring in face.rings) == 1.0
    assert len(face.rings[0]) == 4 + 1 + 2


def test_an_end_that_misses_a_side_by_rounding_lies_on_it() -> None:
    slanted = np.array([[0.0, 0.0], [1.0, 0.3], [1.0, 1.0], [0.0, 1.0]])
    on_side = np.array([0.37, 0.37 * 0.3]) + 1e-13
    (face,) = divided([[slanted]], [np.array([on_side, [0.5, 0.6]])], NOWHERE, "slanted")
    assert tuple(on_side) in {tuple(p) for p in face.rings[0].tolist()}
    assert len(face.rings) == 1


def test_a_place_on_a_line_is_one_of_its_vertices() -> None:
    (face,) = divided([[SQUARE]], lines_of([(0.2, 0.5), (0.8, 0.5)]), np.array([[0.37, 0.5]]), "square")
    assert face.marks.tolist() == [[0.37, 0.5]]
    assert len(face.places) == 0
    polygons = discretised([[SQUARE]], "square", edge_length=0.1)
    (domain,) = domains_with_lines(
        polygons, lines_of([(0.2, 0.5), (0.8, 0.5)]), np.array([[0.37, 0.5]]), "square", "square"
    )
    assert [0.37, 0.5] in domain.points[domain.lines.ravel()].tolist()


def test_lines_get_the_lengths_that_the_boundary_has() -> None:
    ring = discretised([[SQUARE]], "square", edge_length=0.05)
    (domain,) = domains_with_lines(ring, lines_of([(0.2, 0.5), (0.8, 0.5)]), NOWHERE, "square", "square")
    assert len(domain.lines) == 12


def test_a_line_that_floats_has_two_edges_at_least() -> None:
    ring = discretised([[SQUARE]], "square", edge_length=0.25)
    (domain,) = domains_with_lines(ring, lines_of([(0.4, 0.5), (0.6, 0.5)]), NOWHERE, "square", "square")
    assert len(domain.lines) == 2


def test_an_end_between_vertices_leaves_an_even_total() -> None:
    ring = discretised([[SQUARE]], "square", edge_length=0.25)
    (domain,) = domains_with_lines(ring, lines_of([(0.13, 0.0), (0.5, 0.5)]), NOWHERE, "square", "square")
    assert len(domain.ring) % 2 == 0
    assert len(domain.segments) == 16 + 2


def test_pieces_that_come_to_meet_are_told_with_their_place() -> None:
    turn = np.linspace(0.0, np.pi, 40)
    arch = np.stack([0.5 + 0.3 * np.cos(turn), 0.2 + 0.3 * np.sin(turn)], axis=1)
    below = np.array([[0.5, 0.3], [0.5, 0.495]])
    faces = divided([[SQUARE]], [arch, below], NOWHERE, "square")
    rings = discretised([face.rings for face in faces], "square", edge_length=0.9, curvature=4)
    with pytest.raises(DomainError, match=r"square: pieces .* meet at \(0\.5, .*smaller edge length"):
        slit_domain("square", rings[0], NOWHERE, "square")


def test_a_line_without_length_is_told() -> None:
    with pytest.raises(DomainError, match=r"square: line 0 at \(0.5, 0.5\) has no length"):
        divided([[SQUARE]], lines_of([(0.5, 0.5), (0.5, 0.5)]), NOWHERE, "square")


def test_places_and_tips_close_to_something_ask_for_small_sizes() -> None:
    lines = lines_of([(0.5, 0.02), (0.5, 0.5)])
    (face,) = divided([[SQUARE]], lines, np.array([[0.97, 0.5], [0.3, 0.6]]), "square")
    found = close_sizes([face], 0.1)
    assert sorted(map(tuple, found.round(6).tolist())) == [(0.5, 0.02, 0.02), (0.97, 0.5, 0.03)]


def test_around_a_tip_lies_all_of_the_angle() -> None:
    (domain,) = square(0.1, [(0.0, 0.5), (0.5, 0.5)])
    tip = int(np.flatnonzero((domain.points == 0.5).all(axis=1))[0])
    assert wanted(domain)[tip] == 4
    front = template(domain, MeshingParameters(), 64)
    keys = front.key[64 : 64 + int(front.counts[RING])]
    at = int(np.flatnonzero(domain.ring == tip)[0])
    assert keys[at] == keys.max() == pytest.approx(2 * np.pi)
    # One step before the tip the second neighbour is the other side.
    assert keys[at - 1] == keys[at + 1] == pytest.approx(np.pi)
    assert sorted(ring_slots(front).tolist()) == list(range(len(domain.ring)))
