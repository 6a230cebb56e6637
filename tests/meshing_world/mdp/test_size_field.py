"""The size field: its definition, its bounds, and what an episode makes of it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from play import record, turns

from envs.domains.load import from_rings, load
from envs.domains.random_domain import circle
from envs.errors import UserError
from envs.mdp.front import FIELD, GIVEN, POINTS, wanted_size
from envs.mdp.size_field import SizeField, capacity, size_field, sizes_at, sources
from envs.mesh_env import MeshEnv
from envs.polygons.size_cells import Size, cells
from envs.types import Domain, Floats, WantedSizes
from envs.vector_env import MeshVectorEnv

DOMAINS = ("T1", "T3", "D4", "D9", "random:3", "random:58?holes=2&vertices=60&unevenness=4")
#: On a uniform boundary all is measured by the same length: the front's and the wanted one.
UNIFORM = {"disc": circle(40), "square": [(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 2), (0, 2), (0, 1)]}

names = st.sampled_from(DOMAINS)
gradients = st.floats(1e-3, 3.0)


def field_of(domain: Domain, gradient: float) -> SizeField:
    return size_field(domain, gradient, capacity(len(domain.points)))


def places(domain: Domain, seed: int, count: int = 200) -> Floats:
    """Points in the domain's bounding box and around it."""
    low, high = domain.points.min(axis=0), domain.points.max(axis=0)
    margin = 0.2 * (high - low)
    return np.random.default_rng(seed).uniform(low - margin, high + margin, (count, 2))


@settings(max_examples=40)
@given(names, gradients, st.integers(0, 1000))
def test_it_is_the_lowest_of_the_boundary_s_cones(name: str, gradient: float, seed: int) -> None:
    domain = load(name)
    at, cones = places(domain, seed), sources(domain)
    distances = np.linalg.norm(at[:, None] - cones[None, :, :2], axis=2)
    expected = np.minimum((cones[:, 2] + gradient * distances).min(axis=1), cones[:, 2].max())
    np.testing.assert_allclose(sizes_at(field_of(domain, gradient), at), expected, rtol=2e-9)


@settings(max_examples=40)
@given(names, gradients, st.integers(0, 1000))
def test_it_changes_no_faster_than_allowed_and_stays_within_the_boundary_s_sizes(
    name: str, gradient: float, seed: int
) -> None:
    domain = load(name)
    at, h = places(domain, seed), sources(domain)[:, 2]
    found = sizes_at(field_of(domain, gradient), at)
    assert h.min() * (1 - 1e-9) <= found.min() <= found.max() <= h.max()
    apart = np.linalg.norm(at[:, None] - at, axis=2)
    assert (np.abs(found[:, None] - found) <= gradient * apart * (1 + 1e-9) + 1e-8 * h.max()).all()


@pytest.mark.parametrize("name", DOMAINS)
def test_a_boundary_point_s_size_is_the_mean_of_its_segments_or_less(name: str) -> None:
    domain = load(name)
    at = sources(domain)
    assert len(at) == len(domain.segments)
    ends = domain.points[domain.segments]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    for x, y, h in at[::7]:
        here = (domain.points[domain.segments] == [x, y]).all(axis=2).any(axis=1)
        assert here.sum() == 2
        assert h == pytest.approx(lengths[here].mean())
    assert (sizes_at(field_of(domain, 0.2), at[:, :2]) <= at[:, 2] * (1 + 1e-12)).all()


@settings(max_examples=20)
@given(names, st.floats(-6.0, 6.0), st.integers(0, 1000))
def test_it_scales_with_the_domain(name: str, exponent: float, seed: int) -> None:
    domain, scale = load(name), 10.0**exponent
    at = places(domain, seed)
    larger = field_of(replace(domain, points=scale * domain.points), 0.2)
    np.testing.assert_allclose(sizes_at(larger, scale * at), scale * sizes_at(field_of(domain, 0.2), at), rtol=1e-7)


@pytest.mark.parametrize("name", UNIFORM)
def test_on_a_uniform_boundary_it_is_the_same_everywhere_and_has_no_sources(name: str) -> None:
    domain = from_rings(UNIFORM[name])
    field = field_of(domain, 0.2)
    assert field.key.min() == np.inf
    np.testing.assert_array_equal(sizes_at(field, places(domain, 0)), field.most)


def test_it_is_the_same_in_a_larger_tree() -> None:
    domain = load("D9")
    at = places(domain, 1)
    np.testing.assert_array_equal(
        sizes_at(field_of(domain, 0.1), at), sizes_at(size_field(domain, 0.1, 4 * capacity(len(domain.points))), at)
    )


@pytest.mark.parametrize("options", [{"scale": "size"}, {"density": "local"}, {"extended": True}], ids=str)
@pytest.mark.parametrize("name", ["T1", "random:20", "random:3"])
def test_every_vertex_of_a_mesh_wants_what_the_field_says(name: str, options: dict) -> None:
    domain = load(name)
    field = field_of(domain, 0.3)
    for turn in turns(domain, 5, limit=60, type2=True, size_gradient=0.3, **options):
        front = turn.episodes.front(turn.chosen or 0)
        count = front.counts[POINTS]
        np.testing.assert_array_equal(front.size[:count], sizes_at(field, front.points[:count]))
    assert count > front.counts[GIVEN] + 10
    assert wanted_size(front, *domain.points[0]) == front.size[0]


@settings(max_examples=30)
@given(names, st.floats(1.0, 4.0), st.integers(0, 1000))
def test_it_grows_to_the_largest_size_said_or_to_the_least(name: str, ratio: float, seed: int) -> None:
    domain = load(name)
    cones, at = sources(domain), places(domain, seed)
    largest = ratio * float(cones[:, 2].max())
    distances = np.linalg.norm(at[:, None] - cones[None, :, :2], axis=2)
    expected = np.minimum((cones[:, 2] + 0.2 * distances).min(axis=1), largest)
    for sizes in (WantedSizes(most=largest), WantedSizes(least=largest)):
        np.testing.assert_allclose(sizes_at(size_field(domain, 0.2, sizes=sizes), at), expected, rtol=2e-9)


@settings(max_examples=15)
@given(names, st.floats(0.4, 1.0), st.integers(0, 1000))
def test_it_shrinks_inwards_to_a_largest_size_below_the_boundary_s(name: str, ratio: float, seed: int) -> None:
    """No faster than it may grow, from the boundary's own sizes; inside it is the largest said, or little above."""
    domain = load(name)
    at, boundary = places(domain, seed), sources(domain)[:, :2]
    most = ratio * float(sources(domain)[:, 2].min())
    own, field = field_of(domain, 0.2), size_field(domain, 0.2, sizes=WantedSizes(most=most))
    np.testing.assert_allclose(sizes_at(field, boundary), sizes_at(own, boundary), rtol=1e-6)
    found = sizes_at(field, at)
    apart = np.linalg.norm(at[:, None] - boundary, axis=2)
    bound = np.maximum((sizes_at(own, boundary) - 0.2 * apart).max(axis=1), most)
    assert (found >= bound * (1 - 1e-6)).all()
    low, high = domain.points.min(axis=0), domain.points.max(axis=0)
    inside = ((at > low) & (at < high)).all(axis=1)
    assert (found <= bound + 0.4 * most)[inside].all()  # a middle of a cell is less than a size away


@pytest.mark.parametrize(
    "limits", [(-1.0, 1.0), (2.0, 1.0), (0.0, 0.0), (math.nan, 1.0), (0.0, math.nan), (math.inf, math.inf)]
)
def test_limits_that_are_none(limits: tuple[float, float]) -> None:
    with pytest.raises(UserError, match="--min-size"):
        WantedSizes(*limits)


@settings(max_examples=30)
@given(names, st.integers(0, 1000))
def test_given_points_are_sources_as_far_as_the_boundary_lets_them(name: str, seed: int) -> None:
    domain, random = load(name), np.random.default_rng(seed)
    boundary, own = sources(domain), field_of(domain, 0.3)
    points = np.column_stack([places(domain, seed, 5), random.uniform(0.1, 2.0, 5) * boundary[:, 2].min()])
    field = size_field(domain, 0.3, sizes=WantedSizes(points=points))
    there = np.linalg.norm(points[:, None, :2] - boundary[None, :, :2], axis=2)
    points[:, 2] = np.maximum(points[:, 2], (sizes_at(own, boundary[:, :2]) - 0.3 * there).max(axis=1))
    at, cones = places(domain, seed + 1), np.concatenate([boundary, points])
    distances = np.linalg.norm(at[:, None] - cones[None, :, :2], axis=2)
    expected = np.minimum((cones[:, 2] + 0.3 * distances).min(axis=1), boundary[:, 2].max())
    np.testing.assert_allclose(sizes_at(field, at), expected, rtol=2e-9)
    at = boundary[:, :2]
    np.testing.assert_allclose(sizes_at(field, at), sizes_at(own, at), rtol=2e-9)


@settings(max_examples=30)
@given(st.floats(0.02, 2.0), st.floats(0.0, 0.5), st.integers(0, 1000))
def test_a_function_is_remembered_by_cells_as_small_as_it_says(least: float, slope: float, seed: int) -> None:
    """They cover the box, none is larger than the size at its middle, and the field of their points is the function."""
    low, high = np.array([-1.0, 2.0]), np.array([3.0, 3.0])
    centre = np.random.default_rng(seed).uniform(low, high)

    def size(at: Floats) -> Floats:
        return least + slope * np.linalg.norm(at - centre, axis=1)

    found = cells(size, low, high)
    assert (found.sides**2).sum() == pytest.approx(4.0)
    assert (found.sides <= found.points[:, 2] * (1 + 1e-12)).all()
    at = np.random.default_rng(seed).uniform(low, high, (100, 2))
    remembered = (found.points[:, 2] + 0.5 * np.linalg.norm(at[:, None] - found.points[:, :2], axis=2)).min(axis=1)
    assert (remembered >= size(at) * (1 - 1e-9)).all()
    assert (remembered <= size(at) * 2.0).all()


@pytest.mark.parametrize(("size", "told"), [
    (lambda at: at[:, 0] * 0.0, r"size: 0 at \("), (lambda at: np.full(len(at), np.nan), "size: nan at"),
    (lambda at: "small", "return a number for each"), (lambda at: np.ones(3), "return a number for each"),
    (lambda at: 1e-4, "cells to describe: give larger sizes"),
])  # fmt: skip
def test_a_function_that_is_no_size(size: Size, told: str) -> None:
    with pytest.raises(UserError, match=told):
        cells(size, np.zeros(2), np.ones(2))


@pytest.mark.parametrize("points", [[1.0, 2.0, 3.0], [[0.0, 0.0, 0.0]], [[0.0, math.nan, 1.0]], [[1.0, 2.0]]])
def test_points_that_are_none(points: list) -> None:
    with pytest.raises(UserError, match="points with sizes: give"):
        WantedSizes(points=np.array(points))


def test_who_does_not_ask_for_it_pays_nothing() -> None:
    front = MeshEnv("random:3").episodes._templates
    assert front.source_key.min() == np.inf


@pytest.mark.parametrize("name", UNIFORM)
def test_where_the_front_has_the_wanted_size_both_scales_are_one(name: str) -> None:
    """A uniform boundary: the observation begins alike, and the same action cuts the same element."""
    first, cut = [], []
    for scale in ("front", "size"):
        env = MeshEnv(from_rings(UNIFORM[name]), scale=scale)
        first.append(env.reset(seed=0)[0])
        random = np.random.default_rng(1)
        for _ in range(200):
            if not (told := env.step(random.uniform(-1.0, 1.0, 3))[4])["rejection"]:
                break
        cut.append((told["eta_e"], env.episodes.ring(0)))
    np.testing.assert_allclose(first[1][:15], first[0], atol=1e-6)
    np.testing.assert_allclose(first[1][15:], 0.0, atol=1e-6)
    assert cut[0][0] == pytest.approx(cut[1][0])
    np.testing.assert_allclose(cut[0][1], cut[1][1], atol=1e-9)


def test_what_is_too_long_is_seen_and_reach_does_not_grow_with_it() -> None:
    """A square whose front is twice as long as wanted near V_0: lengths are told in wanted ones, twice those of L."""
    ring = np.concatenate([np.array(UNIFORM["square"]) * 2.0, np.zeros((0, 2))])
    fine = from_rings(ring)
    front = MeshEnv(fine, scale="front").reset(seed=0)[0]
    env = MeshEnv(fine, scale="size")
    env.episodes._templates.size[:] *= 0.5
    seen = env.reset(seed=0)[0]
    lengths = slice(0, 8, 2)
    np.testing.assert_allclose(seen[lengths], 2.0 * front[lengths], atol=1e-6)
    assert seen[15] == pytest.approx(0.5)  # ln 2 / ln 4


@pytest.mark.parametrize("name", ["random:3", "T2"])
def test_a_batch_goes_as_single_environments_and_goes_on_from_its_state(name: str) -> None:
    batch = MeshVectorEnv(2, name, scale="size", density="local", max_invalid=10**6)
    single = MeshEnv(name, scale="size", density="local", max_invalid=10**6)
    seen, _ = batch.reset(seed=3)
    np.testing.assert_array_equal(seen[0], single.reset(seed=3)[0])
    random = np.random.default_rng(0)
    for _ in range(200):
        actions = random.uniform(-1.0, 1.0, (2, 3))
        seen, rewards, *_ = batch.step(actions)
        alone = single.step(actions[0])
        np.testing.assert_array_equal(seen[0], alone[0])
        assert rewards[0] == alone[1]
        if alone[2] or alone[3]:
            break
    other = MeshVectorEnv(2, name, scale="size", density="local", max_invalid=10**6)
    other.reset(seed=9)
    state = batch.get_state()
    assert not {*FIELD, "field"} & state["episodes"]["arrays"].keys()  # a checkpoint is what it was
    other.set_state(state)
    for _ in range(50):
        actions = random.uniform(-1.0, 1.0, (2, 3))
        for one, two in zip(batch.step(actions)[:4], other.step(actions)[:4], strict=True):
            np.testing.assert_array_equal(one, two)


def test_new_vertices_are_put_within_reach_of_the_wanted_length() -> None:
    """No action puts a vertex farther than alpha h from V_0, however long the front's edges are."""
    for seed in range(3):
        for turn in turns(load("random:58?holes=2&vertices=60&unevenness=4"), seed, limit=25, scale="size"):
            if turn.chosen is None or turn.after.counts[POINTS] == turn.before.counts[POINTS]:
                continue
            before = turn.before
            slot = int(np.argmin(before.key[len(before.vid) :]))
            new = turn.after.points[turn.after.counts[POINTS] - 1]
            assert np.linalg.norm(new - before.xy[slot]) <= 2.0 * before.size[before.vid[slot]] * (1 + 1e-9)


def test_play_is_repeatable() -> None:
    one, two = (record(load("random:3"), 4, 200, scale="size") for _ in range(2))
    for a, b in zip(one, two, strict=True):
        assert a.tobytes() == b.tobytes()
