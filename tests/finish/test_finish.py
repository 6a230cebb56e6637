"""The finish: never worse than what was given, the same in any place and size, the boundary untouched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rough_meshes import SHAPES, fan, grid, rough

from envs.mesh import Mesh
from envs.quality import convex_quality, element_quality
from freemesh_ray.finish import finish
from freemesh_ray.finish.cleanup import FLOOR
from freemesh_ray.finish.whole_finish import LOST, better, no_worse
from freemesh_ray.mesh_geometry.metrics import irregular


def eta(mesh: Mesh) -> np.ndarray:
    return element_quality(mesh.vertices, mesh.quads)


def check(before: Mesh, after: Mesh) -> None:
    """Assert all that is promised of a finish."""
    assert after.defects(before.areas.sum()) == []
    assert after.complete
    given = np.unique(before.segments)
    np.testing.assert_array_equal(after.vertices[given], before.vertices[given])
    np.testing.assert_array_equal(after.segments, before.segments)
    assert eta(after).mean() >= eta(before).mean()
    assert eta(after).min() >= min(eta(before).min(), FLOOR)
    assert len(irregular(after)) <= len(irregular(before))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", range(4))
def test_a_finish_is_never_worse(shape: str, seed: int) -> None:
    mesh = rough(shape, seed, changes=20)
    for smooth, clean in ((True, True), (True, False), (False, True)):
        check(mesh, finish(mesh, smooth=smooth, clean=clean).mesh)


@pytest.mark.parametrize("elements", [3, 5, 12, 40])
def test_a_vertex_with_many_elements_is_finished(elements: int) -> None:
    check(fan(elements), finish(fan(elements)).mesh)


def test_a_finish_is_much_better() -> None:
    before, after, left = [], [], 0
    for seed in range(4):
        mesh = rough("square", seed, changes=8)
        result = finish(mesh).mesh
        before.append(eta(mesh).mean())
        after.append(eta(result).mean())
        left += len(irregular(result))
    assert np.mean(after) > np.mean(before) + 0.15
    assert left <= 12


def test_steps_can_be_left_out() -> None:
    mesh = rough("ring", 7)
    nothing = finish(mesh, smooth=False, clean=False)
    np.testing.assert_array_equal(nothing.mesh.vertices, mesh.vertices)
    np.testing.assert_array_equal(nothing.mesh.quads, mesh.quads)
    smoothed = finish(mesh, clean=False)
    assert smoothed.sequences == 0
    np.testing.assert_array_equal(smoothed.mesh.quads, mesh.quads)
    assert (smoothed.mesh.vertices != mesh.vertices).any()
    assert finish(mesh, smooth=False).sequences > 0


def test_size_by_a_power_of_two_changes_nothing_at_all() -> None:
    mesh = rough("L", 2)
    expected = finish(mesh).mesh
    for scale in (2.0**-20, 2.0**20):
        found = finish(replace(mesh, vertices=scale * mesh.vertices)).mesh
        np.testing.assert_array_equal(found.quads, expected.quads)
        np.testing.assert_array_equal(found.vertices, scale * expected.vertices)


@pytest.mark.parametrize("seed", range(3))
def test_place_and_direction_change_little(seed: int) -> None:
    mesh = rough("ring", seed)
    expected = finish(mesh, clean=False).mesh
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    turned = finish(replace(mesh, vertices=mesh.vertices @ turn.T), clean=False).mesh
    assert eta(turned).mean() == pytest.approx(eta(expected).mean(), abs=1e-3)
    far = replace(mesh, vertices=mesh.vertices + 1e6)
    check(far, finish(far).mesh)


def test_the_same_mesh_twice() -> None:
    mesh = rough("ring", 9, changes=25)
    first, second = finish(mesh), finish(mesh)
    assert first.sequences == second.sequences
    np.testing.assert_array_equal(first.mesh.vertices, second.mesh.vertices)
    np.testing.assert_array_equal(first.mesh.quads, second.mesh.quads)


def test_better_elements_around_more_irregular_vertices_are_no_finish() -> None:
    regular, irregular_one = fan(4), fan(5)
    bent = regular.vertices.copy()
    bent[-1] = [0.4, 0.3]
    before = replace(regular, vertices=bent)
    assert eta(irregular_one).mean() > eta(before).mean()
    assert eta(irregular_one).min() > eta(before).min() > 0.0
    assert no_worse(before, regular)
    assert not no_worse(before, irregular_one)


def test_what_is_worse_is_seen() -> None:
    mesh = grid("square", shake=0.05)
    assert no_worse(mesh, mesh)
    assert not no_worse(mesh, grid("square", shake=0.24))
    bent = mesh.vertices.copy()
    bent[-1] += 1.5
    assert convex_quality(bent, mesh.quads).min() == -1.0
    assert not no_worse(mesh, replace(mesh, vertices=bent))


@pytest.mark.parametrize(("aside", "fine"), [(0.4, True), (0.45, False)])
def test_a_better_mean_does_not_make_up_for_a_poorer_least(aside: float, fine: bool) -> None:
    """One vertex of a grid aside, in place of all of them a little."""
    before, even = grid("square", shake=0.24), grid("square", shake=0.0)
    after = replace(even, vertices=even.vertices + aside * (np.arange(len(even.vertices)) == 63)[:, None])
    assert eta(after).mean() > eta(before).mean()
    assert 0.0 < eta(after).min() < eta(before).min()
    assert (eta(after).min() >= FLOOR) == fine
    assert no_worse(before, after) == fine


@pytest.mark.parametrize("height", np.linspace(0.4, 1.0, 13))
def test_an_irregular_vertex_fewer_may_cost_a_little_quality_and_no_more(height: float) -> None:
    before, square = fan(5), fan(4)
    after = replace(square, vertices=square.vertices * [1.0, height])
    lost = eta(before).mean() - eta(after).mean()
    assert eta(after).min() > FLOOR, "so that only what is lost decides"
    assert better(before, after) == (lost <= LOST[0])


def test_what_refilling_costs_has_to_be_worth_it() -> None:
    plain, shaken, worse = (grid("square", 3, shake) for shake in (0.0, 0.1, 0.2))
    assert better(shaken, plain)
    assert not better(shaken, worse), "no irregular vertex fewer, and poorer elements"
    flat = replace(plain, vertices=plain.vertices.copy())
    flat.vertices[-1] += 0.95
    assert not better(fan(5), flat), "an irregular vertex fewer, and elements that are nearly flat"
    assert better(fan(5), plain)
    assert not better(fan(4), fan(3)), "an irregular vertex more, however good the elements"


def test_an_irregular_vertex_more_is_never_better() -> None:
    regular, three = fan(4), fan(3)
    quality = [convex_quality(mesh.vertices, mesh.quads).mean() for mesh in (regular, three)]
    squeezed = replace(regular, vertices=regular.vertices * [1.0, 0.2])
    assert convex_quality(squeezed.vertices, squeezed.quads).mean() < min(quality)
    assert not better(squeezed, three)
