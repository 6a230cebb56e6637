"""Patches filled anew: a valid mesh of the same domain, with fewer irregular vertices, the same every time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rough_meshes import SHAPES, fan, grid, halfedges, rough, roughened
from test_halfedges import check

import freemesh_ray
from envs.mesh import Mesh
from envs.quality import element_quality
from envs.types import Floats
from freemesh_ray.finish import EFFORTS, finish
from freemesh_ray.finish.cleanup import FLOOR
from freemesh_ray.finish.halfedges import NONE, Halfedges, compact
from freemesh_ray.finish.optimiser import NO_SIZES
from freemesh_ray.finish.refill import Effort, refill
from freemesh_ray.finish.refill.annulus import outside, rings
from freemesh_ray.finish.refill.growth import (
    LOOP,
    OUTER,
    REFLEX,
    REFLEX_CORNERS,
    SIZE,
    Growth,
    add,
    growth_of,
    push_fan,
    shrink,
    stack_around,
)
from freemesh_ray.finish.refill.patterns import MOST_OF_DOMAIN
from freemesh_ray.finish.refill.placement import place, placement_of
from freemesh_ray.finish.refill.ring_filling import (
    CORNER_COUNT,
    CORNERED,
    FLAT_FIRST,
    FLAT_SECOND,
    HOLE,
    LENGTH,
    QUADS,
    VERTICES,
    Filling,
    cut,
    filling_of,
    rectangle,
    row,
    rows_fit,
    spokes_of,
    toggled_star,
)
from freemesh_ray.finish.whole_finish import LOST, better
from freemesh_ray.mesh_geometry.metrics import irregular


def on_circle(n: int, corners: list[int], room: int = 4000) -> Filling:
    """An empty loop of n vertices on the unit circle, with corners at these places."""
    filling = filling_of(room)
    turn = 2.0 * np.pi * np.arange(n) / n
    filling.xy[:n] = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    filling.loop[:n] = np.arange(n)
    filling.corners[: len(corners)] = corners
    filling.counts[:] = [0, n, n, len(corners), 0]
    return filling


def annulus(n: int, corners: int, rows: int) -> Filling:
    """An empty loop of that many vertices, every quarter of it a corner or none, and a hole of as many after rows."""
    filling = on_circle(n, [n // 4 * k for k in range(corners)])
    m = n - 2 * corners * rows
    turn = -2.0 * np.pi * np.arange(m) / m
    filling.xy[n : n + m] = 0.3 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    filling.hole[:m] = n + np.arange(m)
    filling.counts[VERTICES], filling.counts[HOLE] = n + m, m
    return filling


def ring_mesh(n: int, rows: int) -> Mesh:
    """Rows between two circles of n vertices each."""
    filling = annulus(n, 0, 0)
    rings(filling, 0, rows - 1, 0)
    place(filling, placement_of(filling), 2 * n, 400)
    i = np.arange(n)
    segments = np.concatenate([np.stack([k + i, k + (i + 1) % n], axis=1) for k in (0, n)])
    vertices, quads = filling.xy[: filling.counts[VERTICES]].copy(), filling.quads[: filling.counts[QUADS]].copy()
    return Mesh("ring", vertices, quads, segments, True)


def mesh_of(filling: Filling, n: int) -> Mesh:
    """The filling as a mesh of the polygon that its loop is."""
    i = np.arange(n)
    vertices, quads = filling.xy[: filling.counts[VERTICES]].copy(), filling.quads[: filling.counts[QUADS]].copy()
    return Mesh("filling", vertices, quads, np.stack([i, (i + 1) % n], axis=1), True)


def check_filling(filling: Filling, n: int, singular: int) -> None:
    """Assert that it fills the loop: it is a disc of elements, its rim the loop, with so many irregular vertices."""
    mesh = mesh_of(filling, n)
    edges, counts = mesh.edges
    assert (counts <= 2).all()
    once = {tuple(edge) for edge in edges[counts == 1].tolist()}
    assert once == {tuple(edge) for edge in np.sort(mesh.segments, axis=1).tolist()}
    directed = [side for quad in mesh.quads.tolist() for side in pairwise([*quad, quad[0]])]
    assert len(set(directed)) == len(directed)
    np.testing.assert_array_equal(np.unique(mesh.quads), np.arange(len(mesh.vertices)))
    assert len(mesh.vertices) - len(edges) + len(mesh.quads) == 1
    assert len(irregular(mesh)) == singular


@given(a=st.integers(1, 12), b=st.integers(1, 12), p=st.integers(0, 60))
def test_rectangles(a: int, b: int, p: int) -> None:
    n = 2 * (a + b)
    filling = on_circle(n, [])
    rectangle(filling, filling.loop, n, p % n, a)
    check_filling(filling, n, 0)
    assert filling.counts[QUADS] == a * b


@given(sides=st.lists(st.integers(3, 9), min_size=0, max_size=7), rows=st.integers(1, 3), a=st.integers(1, 9))
def test_rows_around_a_rectangle(sides: list[int], rows: int, a: int) -> None:
    n = sum(sides) + sum(sides) % 2 if sides else 24
    if n < 4:
        return
    filling = on_circle(n, np.cumsum([0, *sides[:-1]]).tolist() if sides else [])
    made = 0
    for _ in range(rows):
        if not rows_fit(filling):
            break
        made += filling.counts[LENGTH] - filling.counts[CORNER_COUNT]
        row(filling, 0.1)
        assert filling.counts[QUADS] == made
    inside = int(filling.counts[LENGTH])
    rectangle(filling, filling.loop, inside, 0, min(a, inside // 2 - 1))
    mesh = mesh_of(filling, n)
    check_filling(filling, n, len(irregular(mesh)))
    # What the index theorem says of the loop's own elements.
    valence = np.bincount(mesh.quads.ravel())
    assert (4 - valence[n:]).sum() == 4 - (2 - valence[:n]).sum()


@given(u=st.lists(st.integers(1, 7), min_size=5, max_size=5), count=st.sampled_from([3, 5]))
def test_stars(u: list[int], count: int) -> None:
    lengths = np.array([u[i] + u[(i + 2) % count] for i in range(count)])
    found = np.zeros(8, dtype=np.int64)
    assert spokes_of(lengths, count, found)
    assert found[:count].tolist() == u[:count]
    n = int(lengths.sum())
    corners = np.cumsum([0, *lengths[:-1]]).tolist()
    filling = on_circle(n, corners)
    toggled_star(filling, -1)
    check_filling(filling, n, 1)
    for left_out in (corners[0], corners[-1], corners[1]):
        filling = on_circle(n, [corner for corner in corners if corner != left_out])
        toggled_star(filling, left_out)
        check_filling(filling, n, 1)


def test_side_lengths_that_make_no_star() -> None:
    for lengths in ([2, 2, 3], [1, 1, 4], [9, 2, 3], [1, 1, 1, 1, 1]):
        assert not spokes_of(np.array(lengths), len(lengths), np.zeros(8, dtype=np.int64))


@given(u=st.lists(st.integers(1, 5), min_size=3, max_size=3), b=st.integers(1, 6), begin=st.integers(0, 50))
def test_cuts_into_a_star_and_a_rectangle(u: list[int], b: int, begin: int) -> None:
    """A rectangle on one side of a three-pointed star: a loop with three corners, the cut's ends flat."""
    lengths = [u[i] + u[(i + 2) % 3] for i in range(3)]
    n = lengths[0] + lengths[1] + 2 * b + lengths[2]
    # The star's sides 0 and 1, then along b, back over side 2's length, and down b again.
    corners = [lengths[0], lengths[0] + lengths[1] + b, lengths[0] + lengths[1] + b + lengths[2]]
    shift = begin % n
    filling = on_circle(n, sorted((corner + shift) % n for corner in corners))
    cut(filling, shift, (lengths[0] + lengths[1] + shift) % n, lengths[2], CORNERED, CORNERED)
    check_filling(filling, n, 1)


@given(
    b=st.integers(1, 6), c=st.integers(1, 6), e=st.integers(1, 6), f=st.integers(1, 6), begin=st.integers(0, 60),
    other_way=st.booleans(),
)  # fmt: skip
def test_cuts_from_a_reflex_corner(b: int, c: int, e: int, f: int, begin: int, other_way: bool) -> None:
    """An L: a rectangle of e + f by b elements, one of e by c on top of it, cut where they meet."""
    n = 2 * (e + f + b + c)
    corners = [0, e + f, e + f + b, e + f + b + f + c, n - b - c]
    reflex, flat = e + f + b + f, n - b
    shift = begin % n
    filling = on_circle(n, sorted((corner + shift) % n for corner in corners))
    p, q = (reflex + shift) % n, (flat + shift) % n
    if other_way:
        cut(filling, q, p, e, CORNERED, FLAT_FIRST)
    else:
        cut(filling, p, q, e, FLAT_SECOND, CORNERED)
    check_filling(filling, n, 0)
    assert filling.counts[QUADS] == (e + f) * b + e * c
    uses = np.bincount(filling.quads[: filling.counts[QUADS]].ravel())
    assert (uses[p], uses[q]) == (3, 2)
    assert (np.flatnonzero(uses[:n] == 1) == np.sort((np.array(corners) + shift) % n)).all()


def test_places_are_in_the_middle_of_their_neighbours() -> None:
    filling = on_circle(24, [0, 6, 12, 18])
    row(filling, 0.3)
    rectangle(filling, filling.loop, int(filling.counts[LENGTH]), 0, 4)
    taken = place(filling, placement_of(filling), 24, 200)
    mesh = mesh_of(filling, 24)
    assert 0 < taken < 200
    edges, _ = mesh.edges
    total, count = np.zeros_like(mesh.vertices), np.zeros(len(mesh.vertices))
    for ends in (edges, edges[:, ::-1]):
        np.add.at(total, ends[:, 0], mesh.vertices[ends[:, 1]])
        np.add.at(count, ends[:, 0], 1.0)
    middle = total / count[:, None]
    assert np.abs(mesh.vertices - middle)[24:].max() < 1e-2
    assert place(filling, placement_of(filling), 24, 0) == 0


def patch_mask(growth: Growth) -> np.ndarray:
    mask = np.zeros(len(growth.inside), dtype=bool)
    mask[growth.members[: growth.counts[SIZE]]] = True
    return mask


def area_within(work: Halfedges, loop: np.ndarray) -> float:
    x, y = work.xy[loop].T
    return 0.5 * float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())


def check_patch(work: Halfedges, growth: Growth) -> None:
    """Assert that the patch is a disc, or one with a hole, and that no vertex of its loops has one element outside."""
    mask, n, outer = patch_mask(growth), growth.counts[LOOP], growth.counts[OUTER]
    np.testing.assert_array_equal(growth.inside, mask)
    uses = np.bincount(work.quads[mask].ravel(), minlength=len(growth.uses))
    np.testing.assert_array_equal(growth.uses, uses)
    loop = growth.loop[:n]
    assert len(np.unique(loop)) == n
    h = (4 * np.flatnonzero(mask)[:, None] + np.arange(4)).ravel()
    rim = h[(work.opp[h] == NONE) | ~mask[work.opp[h] >> 2]]
    assert sorted(rim.tolist()) == sorted(growth.rim[:n].tolist())
    vertices, edges = len(np.unique(work.quads[mask])), (len(h) + len(rim)) // 2
    assert vertices - edges + mask.sum() == (1 if n == outer else 0)
    assert area_within(work, loop[:outer]) > 0.0
    if n > outer:
        assert area_within(work, loop[outer:]) < 0.0
        assert (work.opp[growth.rim[outer:n]] == NONE).all()
    inner = loop[~work.fixed[loop]]
    assert (work.degree[inner] - uses[inner] != 1).all()
    assert reflex(work, growth) <= REFLEX_CORNERS


def reflex(work: Halfedges, growth: Growth) -> int:
    """Corners of the domain on the patch's outer loop that are reflex in it."""
    loop = growth.loop[: growth.counts[OUTER]]
    given = loop[work.fixed[loop]]
    return int((work.ideal[given] - work.degree[given] + growth.uses[given] > REFLEX).sum())


def grown(mesh: Mesh) -> Iterator[tuple[Halfedges, Growth]]:
    """From each vertex inside the patch that has grown as far as it can, checked on its way."""
    work = halfedges(mesh)
    growth = growth_of(work)
    for v in np.flatnonzero(~work.fixed[: work.counts[VERTICES]]):
        shrink(work, growth, 0)
        if add(work, growth, push_fan(work, growth, int(v), 0), len(work.quads)):
            while add(work, growth, stack_around(work, growth), len(work.quads)):
                check_patch(work, growth)
            yield work, growth


def test_patches_go_around_reflex_corners() -> None:
    assert {reflex(*patch) for patch in grown(grid("L"))} == {1}


def test_patches_go_around_holes() -> None:
    assert {int(growth.counts[LOOP] - growth.counts[OUTER]) for _, growth in grown(ring_mesh(16, 4))} == {16}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", range(2))
def test_patches_grow_as_discs_with_few_reflex_corners(shape: str, seed: int) -> None:
    work = halfedges(rough(shape, seed))
    growth = growth_of(work)
    for v in range(work.counts[VERTICES]):
        if work.degree[v] == 0 or work.fixed[v]:
            continue
        shrink(work, growth, 0)
        if not add(work, growth, push_fan(work, growth, v, 0), 40):
            assert growth.counts[SIZE] == 0
            continue
        while True:
            check_patch(work, growth)
            before = patch_mask(growth)
            if not add(work, growth, stack_around(work, growth), 40):
                break
            assert growth.counts[SIZE] <= 40
        np.testing.assert_array_equal(patch_mask(growth), before)


def refilled(mesh: Mesh, effort: Effort, ways: int = 0) -> tuple[Mesh, Halfedges, int]:
    work = halfedges(mesh)
    count = refill(work, NO_SIZES, effort, ways)
    vertices, quads = compact(work, int(mesh.segments.max()) + 1)
    return replace(mesh, vertices=vertices, quads=quads), work, count


def surplus(mesh: Mesh) -> int:
    """Elements at the boundary and valences inside, summed as the index theorem does."""
    elements = np.bincount(mesh.quads.ravel(), minlength=len(mesh.vertices))
    inside = ~mesh.on_boundary & (elements > 0)
    passes = np.bincount(mesh.segments[:, 0], minlength=len(mesh.vertices))
    return int((4 - elements[inside]).sum() + (2 * passes - elements)[mesh.on_boundary].sum())


@settings(max_examples=60, deadline=None)
@given(
    shape=st.sampled_from(sorted(SHAPES)), seed=st.integers(0, 10_000), changes=st.integers(0, 25),
    effort=st.sampled_from(["usual", "thorough"]), ways=st.sampled_from([0, 1]),
)  # fmt: skip
def test_what_comes_out_is_a_mesh_of_the_same_domain(
    shape: str, seed: int, changes: int, effort: str, ways: int
) -> None:
    mesh = rough(shape, seed, changes)
    result, work, count = refilled(mesh, EFFORTS[effort], ways)
    check(work)
    assert result.defects(mesh.areas.sum()) == []
    rim = np.flatnonzero(mesh.on_boundary)
    np.testing.assert_array_equal(result.vertices[rim], mesh.vertices[rim])
    assert element_quality(result.vertices, result.quads).min() >= min(
        element_quality(mesh.vertices, mesh.quads).min(), FLOOR
    )
    assert surplus(result) == surplus(mesh)
    again, _, twice = refilled(mesh, EFFORTS[effort], ways)
    assert twice == count
    np.testing.assert_array_equal(again.vertices, result.vertices)
    np.testing.assert_array_equal(again.quads, result.quads)
    if count == 0:
        np.testing.assert_array_equal(result.quads, mesh.quads)
        np.testing.assert_array_equal(result.vertices, mesh.vertices)


def test_rough_squares_become_grids() -> None:
    for seed in range(6):
        mesh = rough("square", seed)
        result, _, count = refilled(mesh, EFFORTS["usual"])
        assert (len(result.quads), len(irregular(result))) == (49, 0)
        assert count > 0 or len(irregular(mesh)) == 0
        assert element_quality(result.vertices, result.quads).min() > 0.999 or count == 0


def test_rough_L_shapes_lose_what_no_reflex_corner_needs() -> None:
    """As many irregular vertices are left as the boundary's own elements ask for: none."""
    left = []
    for seed in range(6):
        mesh = rough("L", seed)
        result, _, _ = refilled(mesh, EFFORTS["usual"])
        left.append(len(irregular(result)))
        assert result.defects(mesh.areas.sum()) == []
    assert max(left) <= 2
    assert left.count(0) >= 4


def disc(n: int, rows: int) -> Mesh:
    """A disc of n boundary vertices: rows around a square."""
    filling = on_circle(n, [], room=n * n)
    for _ in range(rows):
        row(filling, 2.0 * np.pi / n)
    rectangle(filling, filling.loop, n, 0, n // 4)
    place(filling, placement_of(filling), n, 400)
    return mesh_of(filling, n)


@pytest.mark.parametrize(("n", "changes"), [(24, 12), (48, 25), (160, 40)])
def test_rough_discs_become_rows_around_a_square(n: int, changes: int) -> None:
    for seed in range(2):
        mesh = roughened(disc(n, 2), seed, changes)
        assert len(irregular(mesh)) > 4
        found = finish(mesh).mesh
        assert len(irregular(found)) == 4
        assert len(found.quads) <= MOST_OF_DOMAIN * len(mesh.quads) + 2
        quality = [element_quality(one.vertices, one.quads).mean() for one in (mesh, found)]
        assert quality[1] > quality[0]
        assert quality[1] > 0.88


@settings(max_examples=40, deadline=None)
@given(st.integers(3, 30), st.sampled_from([0, 4]), st.integers(0, 3), st.integers(0, 4), st.integers(0, 100))
def test_rows_around_a_hole(quarter: int, corners: int, outside: int, inside: int, offset: int) -> None:
    n = 4 * (quarter + 2 * outside + 1)
    filling = annulus(n, corners, outside)
    m = int(filling.counts[HOLE])
    rings(filling, outside, inside, offset)
    quads = filling.quads[: filling.counts[QUADS]]
    assert len(quads) == sum(n - 2 * corners * k - corners for k in range(outside)) + m * (inside + 1)
    uses = np.bincount(quads.ravel())
    corner = np.zeros(n, dtype=bool)
    corner[[n // 4 * k for k in range(corners if outside else 0)]] = True
    np.testing.assert_array_equal(uses[:n], np.where(corner, 1, 2))
    np.testing.assert_array_equal(uses[n : n + m], 2)
    assert (uses[n + m :] == 5).sum() == (corners if outside and inside else 0) or inside == 0
    edges = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    counts = np.unique(edges, axis=0, return_counts=True)[1]
    assert ((counts == 1).sum(), counts.max()) == (n + m, 2)


@pytest.mark.parametrize("elements", [0, 60, 200, 10_000])
def test_rows_outside_end_where_there_is_no_room(elements: int) -> None:
    filling = annulus(60, 4, 5)
    rows = outside(filling, 10, elements)
    assert filling.counts[QUADS] <= elements
    assert rows == (5 if elements >= 260 else -1)


def test_a_rough_ring_becomes_rows_as_a_whole() -> None:
    mesh = roughened(ring_mesh(24, 4), 1, 20)
    assert len(irregular(mesh)) > 4
    found, _, _ = refilled(mesh, EFFORTS["usual"]._replace(work=1, share=1))
    assert len(irregular(found)) == 0
    assert len(found.quads) % 24 == 0


def test_a_large_rough_ring_is_finished_as_rows() -> None:
    found = finish(roughened(ring_mesh(80, 9), 1, 20)).mesh
    assert len(irregular(found)) == 0
    assert len(found.quads) % 80 == 0
    assert element_quality(found.vertices, found.quads).min() > 0.6


def test_no_effort_and_regular_meshes_leave_all_as_it_is() -> None:
    for mesh, effort in ((rough("L", 3), "quick"), (grid("ring"), "thorough"), (grid("cell"), "usual")):
        result, _, count = refilled(mesh, EFFORTS[effort])
        assert count == 0
        np.testing.assert_array_equal(result.vertices, mesh.vertices)
        np.testing.assert_array_equal(result.quads, mesh.quads)


def test_work_is_bounded() -> None:
    mesh = rough("ring", 11, 25)
    patches = EFFORTS["thorough"]._replace(whole=0)
    counts = [refilled(mesh, patches._replace(work=work, share=work))[2] for work in (1, 20_000, 1 << 40)]
    assert counts[0] <= 1
    assert counts == sorted(counts)
    assert counts[-1] > counts[0]


@pytest.mark.slow
def test_a_whole_domain_tried_in_vain_costs_patches_no_work() -> None:
    """It is no disc of few reflex corners that rows fill, so that all that changes it are patches."""
    mesh = freemesh_ray.mesh("part-31002", effort="quick").result.finished
    usual = EFFORTS["usual"]
    without, with_whole = (refilled(mesh, usual._replace(whole=whole))[0] for whole in (0, usual.whole))
    np.testing.assert_array_equal(with_whole.quads, without.quads)
    np.testing.assert_array_equal(with_whole.vertices, without.vertices)
    assert len(irregular(without)) < len(irregular(mesh))


@pytest.mark.parametrize("elements", [3, 5, 12, 40])
def test_a_vertex_with_many_elements_does_no_harm(elements: int) -> None:
    mesh = fan(elements)
    result, work, _ = refilled(mesh, EFFORTS["thorough"])
    check(work)
    assert result.defects(mesh.areas.sum()) == []


def star_mesh(eta_loss: float) -> Floats:
    """Places of a grid's vertices, moved so that its elements lose some eta."""
    mesh = grid("square", shake=0.0)
    moved = mesh.vertices.copy()
    moved[~mesh.on_boundary] += eta_loss
    return moved


def test_what_fewer_irregular_vertices_may_cost() -> None:
    regular = grid("square", shake=0.0)
    rough_one = rough("square", 0)
    assert better(rough_one, regular)
    assert not better(regular, rough_one)
    assert better(regular, regular)
    worse = replace(regular, vertices=star_mesh(0.2))
    assert element_quality(worse.vertices, worse.quads).mean() < 1.0 - LOST[0]
    assert not better(regular, worse)


def test_an_effort_that_is_none_is_told() -> None:
    with pytest.raises(ValueError, match="effort = 'much': use one of quick, usual, thorough"):
        finish(grid("cell"), effort="much")
