"""The descent: its gradient is right, its cost never rises, and only the vertices that may move do."""

from __future__ import annotations

import numpy as np
import pytest
from rough_meshes import grid, rough

from envs.mdp.size_field import SizeField
from envs.mesh import Mesh
from envs.quality import element_quality
from envs.types import Floats, Ints
from freemesh_ray.finish.optimiser import NEAR, NO_SIZES, SIZED, STEEP, WEAK, WEIGHT, cost, cost_of, descend, descent


def arranged(mesh: Mesh) -> tuple[Floats, Ints, int]:
    """Positions with the interior vertices first, quads, and how many interior vertices there are."""
    order = np.argsort(mesh.on_boundary, kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return mesh.vertices[order], place[mesh.quads], int((~mesh.on_boundary).sum())


def value(xy: Floats, quads: Ints, sharp: bool, per_area: float = 0.0) -> float:
    return float(cost(xy, quads, np.full(len(quads), per_area), sharp, np.empty_like(xy), descent(1, NO_SIZES).lanes))


def uniform(h: float) -> SizeField:
    """The same edge length everywhere."""
    return NO_SIZES._replace(most=h)


@pytest.mark.parametrize("sharp", [False, True])
@pytest.mark.parametrize("per_area", [0.0, 0.5, 3.0])
def test_gradient_agrees_with_central_differences(sharp: bool, per_area: float) -> None:
    xy, quads, _ = arranged(rough("ring", 5))
    gradient = np.empty_like(xy)
    cost(xy, quads, np.full(len(quads), per_area), sharp, gradient, descent(1, NO_SIZES).lanes)
    step, differences = 1e-5, np.empty_like(xy)
    for v, axis in np.ndindex(*xy.shape):
        shift = np.zeros_like(xy)
        shift[v, axis] = step
        ahead, behind = (value(xy + side * shift, quads, sharp, per_area) for side in (1, -1))
        differences[v, axis] = (ahead - behind) / (2.0 * step)
    assert np.abs(gradient).max() > 1.0
    np.testing.assert_allclose(gradient, differences, atol=1e-5)


@pytest.mark.parametrize(("sharp", "close"), [(False, 0.12), (True, 0.03)])
def test_the_stand_in_is_close_to_the_quality(sharp: bool, close: float) -> None:
    xy, quads, _ = arranged(rough("L", 2))
    eta = element_quality(xy, quads)
    gap = np.maximum(0.0, WEAK - eta)
    exact = 1.0 - eta + WEIGHT * gap**2 + STEEP * gap**4
    found = np.array([value(xy, quads[i : i + 1], sharp) for i in range(len(quads))])
    assert (found <= exact + 1e-7).all()
    slope = 1.0 + 2.0 * WEIGHT * gap + 4.0 * STEEP * gap**3
    assert (exact - found <= close * slope).all()


def test_the_cost_of_many_elements_is_the_sum_over_them() -> None:
    xy, quads, _ = arranged(grid("square"))
    for count in (1, 7, 8, 9, len(quads)):
        alone = sum(value(xy, quads[i : i + 1], False) for i in range(count))
        assert value(xy, quads[:count], False) == pytest.approx(alone, rel=1e-12)
    many = np.concatenate([quads] * 4)
    assert len(many) > 128
    assert value(xy, many, False) == pytest.approx(4.0 * value(xy, quads, False), rel=1e-12)


@pytest.mark.parametrize("sharp", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_the_cost_never_rises_and_the_rest_stays(sharp: bool, seed: int) -> None:
    xy, quads, free = arranged(rough("square", seed))
    before, costs = value(xy, quads, sharp), []
    for steps in (0, 1, 2, 5, 40):
        moved = xy.copy()
        reached = descend(moved, quads, free, sharp, steps, 0.0, descent(len(xy), NO_SIZES))
        assert reached == pytest.approx(value(moved, quads, sharp), rel=1e-12)
        costs.append(reached)
    assert costs[0] == before
    assert (np.diff(costs) <= 0.0).all()
    assert costs[-1] < before
    np.testing.assert_array_equal(moved[free:], xy[free:])


def test_what_an_element_costs_that_has_not_the_size_wanted() -> None:
    xy, quads, _ = arranged(grid("square", shake=0.0))
    for h in (0.5, 1.0, 3.0):
        off = h**2 + 1.0 / h**2 - 2.0
        expected = len(quads) * SIZED * off**2 / (off + NEAR)
        assert cost_of(xy, quads, descent(len(xy), uniform(h))) == pytest.approx(expected, abs=1e-6)
    assert cost_of(xy, quads, descent(len(xy), NO_SIZES)) == pytest.approx(0.0, abs=1e-6)


def test_sizes_follow_what_is_wanted() -> None:
    """Where h grows from left to right, columns of squares move to the left, as far as the boundary lets them."""
    xy, quads, free = arranged(grid("square", shake=0.0))
    left = xy[xy[:, 0].argmin()]
    field = SizeField(np.array([np.inf, 0.5]), np.array([np.zeros(4), np.tile(left, 2)]), 10.0, 0.15)
    moved = xy.copy()
    descend(moved, quads, free, False, 200, 0.0, descent(len(xy), field))
    columns = np.unique(xy[:free, 0])
    places = np.array([moved[:free, 0][xy[:free, 0] == x].mean() for x in columns])
    assert (places < columns - 0.005).all()


def test_a_shaken_grid_becomes_squares_again() -> None:
    xy, quads, free = arranged(grid("square"))
    assert element_quality(xy, quads).mean() < 0.8
    descend(xy, quads, free, False, 200, 0.0, descent(len(xy), NO_SIZES))
    assert element_quality(xy, quads).min() > 0.97


def test_nothing_moves_without_free_vertices_or_where_elements_are_degenerate() -> None:
    xy, quads, free = arranged(grid("cell"))
    assert free == 0
    assert descend(xy, quads, free, False, 10, 0.0, descent(4, NO_SIZES)) == pytest.approx(0.0, abs=1e-6)
    xy, quads, free = arranged(grid("square"))
    xy[quads[0, 0]] = xy[quads[0, 1]]
    start = xy.copy()
    assert descend(xy, quads, free, False, 10, 0.0, descent(len(xy), NO_SIZES)) == np.inf
    np.testing.assert_array_equal(xy, start)
