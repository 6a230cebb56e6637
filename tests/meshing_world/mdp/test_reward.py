"""The reward: each term by its formula, and their sum."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from play import turns

from envs.domains.load import from_rings, load
from envs.mdp.action import ACCEPTED, Cut, decode
from envs.mdp.episodes import Episodes
from envs.mdp.front import (
    A_MAX,
    A_MIN,
    AREA,
    ELEMENTS,
    ETA_SUM,
    POINTS,
    RING,
    Front,
    area_bounds,
    reference_slot,
    ring_slots,
)
from envs.mdp.reward import INVALID_REWARD, LAST_REWARD, element_area, eta_b, eta_e, mu
from envs.quality import element_quality
from envs.types import MeshingParameters

SIXTY = np.pi / 3

angle = st.floats(0.0, 2.0 * np.pi)
distance = st.floats(0.0, 10.0) | st.just(np.inf)
area = st.floats(1e-3, 1e3)


def cut(k: int, sigma_start: float, sigma_end: float, d_min: float) -> Cut:
    """A unit square that is cut with a chain of k edges."""
    corners = ((0.0, 1.0, 1.0, 0.0), (0.0, 0.0, 1.0, 1.0))
    return Cut(0, k, *corners, (np.pi / 2,) * 4, sigma_start, sigma_end, d_min, ACCEPTED)


@given(st.integers(1, 3), angle, angle, distance)
def test_eta_b_follows_its_formula(k: int, sigma_start: float, sigma_end: float, d_min: float) -> None:
    found = eta_b(cut(k, sigma_start, sigma_end, d_min), SIXTY)
    q_dist = min(1.0, d_min) if k < 3 else 1.0
    expected = np.sqrt(min(sigma_start, sigma_end, SIXTY) / SIXTY * q_dist) - 1.0
    assert found == pytest.approx(expected, abs=1e-12)
    assert -1.0 <= found <= 0.0


@given(st.integers(1, 3), st.floats(SIXTY, 6.0), st.floats(SIXTY, 6.0), st.floats(1.0, 10.0) | st.just(np.inf))
def test_wide_angles_and_distant_vertices_cost_nothing(k: int, start: float, end: float, d_min: float) -> None:
    assert eta_b(cut(k, start, end, d_min), SIXTY) == 0.0


@given(st.integers(1, 3), angle, angle, distance, st.floats(0.1, 0.9))
def test_eta_b_falls_with_angles_and_distance(k: int, start: float, end: float, d_min: float, part: float) -> None:
    whole = eta_b(cut(k, start, end, d_min), SIXTY)
    for less in ((part * start, end, d_min), (start, part * end, d_min), (start, end, part * d_min)):
        assert eta_b(cut(k, *less), SIXTY) <= whole + 1e-12


@given(area, area, area)
def test_mu_follows_its_branches(a: float, low: float, extra: float) -> None:
    high = low + extra
    continuous, printed = mu(a, low, high, True), mu(a, low, high, False)
    if a < low:
        assert continuous == printed == -1.0
    elif a >= high:
        assert continuous == printed == 0.0
    else:
        assert continuous == pytest.approx((a - high) / (high - low), abs=1e-12)
        assert printed == pytest.approx((a - low) / (high - low), abs=1e-12)
        assert printed == pytest.approx(continuous + 1.0, abs=1e-12)
    assert -1.0 <= continuous <= 0.0


@given(area, area)
def test_mu_is_continuous_but_as_printed_it_jumps(low: float, extra: float) -> None:
    high, near = low + extra, 1e-9
    for edge, value in ((low, -1.0), (high, 0.0)):
        for side in (1.0 - near, 1.0 + near):
            assert mu(edge * side, low, high, True) == pytest.approx(value, abs=near * high / extra * 2.0)
    assert mu(low, low, high, False) == 0.0
    assert mu(low + 0.999 * extra, low, high, False) > 0.99


@given(area, st.lists(st.floats(1e-3, 2e3), min_size=2, max_size=8))
def test_mu_rises_with_the_area(low: float, areas: list[float]) -> None:
    values = [mu(a, low, 3.0 * low, True) for a in sorted(areas)]
    assert values == sorted(values)


@given(area)
def test_mu_with_equal_bounds_is_a_step(bound: float) -> None:
    assert mu(bound, bound, bound, True) == 0.0
    assert mu(0.999 * bound, bound, bound, True) == -1.0


@pytest.mark.parametrize(("upsilon", "kappa"), [(1.0, 4.0), (0.5, 4.0), (1.5, 2.0)])
def test_bounds_of_the_area(upsilon: float, kappa: float) -> None:
    """Edges from 1 to 3 long: A_min = v, A_max = v (2/kappa + 1)^2."""
    domain = from_rings(np.array([[0, 0], [3, 0], [5, 0], [5, 2], [4, 2], [2, 2], [0, 2], [0, 1]], dtype=np.float64))
    parameters = MeshingParameters(upsilon=upsilon, kappa=kappa)
    assert area_bounds(domain, parameters) == pytest.approx((upsilon, upsilon * (2.0 / kappa + 1.0) ** 2))


def test_seams_do_not_enter_the_bounds_of_the_area() -> None:
    domain = load("random:3")
    assert len(domain.ring) > len(domain.segments)
    ends = domain.points[domain.segments]
    edges = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    assert area_bounds(domain, MeshingParameters())[0] == pytest.approx(edges.min() ** 2)


def test_a_square_has_its_area_and_quality() -> None:
    square = cut(3, 1.0, 1.0, np.inf)
    assert element_area(square) == 1.0
    assert eta_e(square) == pytest.approx(1.0)


@pytest.mark.parametrize("density", ["continuous", "printed"])
@pytest.mark.parametrize("name", ["T1", "random:20", "random:3"])
def test_the_terms_add_up_to_the_reward(name: str, density: str) -> None:
    for turn in turns(load(name), 2, density=density):
        out = turn.episodes.out
        for i in range(len(turn.episodes)):
            if out.rejection[i] != ACCEPTED:
                assert (out.reward[i], out.terms[i].any()) == (INVALID_REWARD, False)
            elif out.terminated[i]:
                assert (out.reward[i], out.terms[i].any()) == (LAST_REWARD, False)
            else:
                assert out.reward[i] == pytest.approx(out.terms[i].sum(), abs=1e-12)
                assert_terms(turn.before.measure, turn.episodes, i, density)


def assert_terms(before: np.ndarray, episodes: Episodes, i: int, density: str) -> None:
    """The terms are of the element that was cut."""
    front, terms = episodes.front(i), episodes.out.terms[i]
    quad = front.quads[front.counts[ELEMENTS] - 1][None]
    assert terms[0] == pytest.approx(element_quality(front.points, quad)[0], abs=1e-12)
    assert front.measure[ETA_SUM] == pytest.approx(before[ETA_SUM] + terms[0])
    assert -1.0 <= terms[1] <= 0.0
    cut_area = before[AREA] - front.measure[AREA]
    expected = mu(cut_area, before[A_MIN], before[A_MAX], density == "continuous")
    assert terms[2] == pytest.approx(expected, abs=1e-6)


def test_the_released_bounds_of_the_area_pass_over_one_edge_at_each_end_and_are_near_the_mean() -> None:
    ring = [[0, 0], [1, 0], [3, 0], [6, 0], [6, 1], [6, 4], [3, 4], [0, 4], [0, 3.5], [0, 2]]
    parameters = MeshingParameters(area_range="released", upsilon=0.5)
    edges = np.sort([1, 2, 3, 1, 3, 3, 3, 0.5, 1.5, 2])
    e_min, e_max = min(edges[1], edges.mean() / np.sqrt(2.0)), min(edges[-2], 2.0 * edges.mean())
    expected = 0.5 * e_min**2, 0.5 * ((e_max + 3.0 * e_min) / 4.0) ** 2
    assert area_bounds(from_rings(np.array(ring, dtype=np.float64)), parameters) == pytest.approx(expected)
    even = from_rings(np.array([[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]], dtype=np.float64))
    assert area_bounds(even, MeshingParameters(area_range="released"))[0] == pytest.approx(0.5)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["T1", "T3"])
def test_the_released_rewards_are_those_of_the_authors_code(name: str) -> None:
    """eta_b = (s q_angle q_dist)^(1/3) - 1, of type 0 (s q_angle)^(1/2) - 1; s is of lengths on the front left."""
    seen = set()
    for turn in turns(load(name), 2, boundary="released", invalid="released"):
        out, before = turn.episodes.out, turn.before
        for i, action in enumerate(turn.actions):
            front = turn.episodes.front(i)
            if out.rejection[i] != ACCEPTED:
                assert out.reward[i] == pytest.approx(-1.0 / max(1, front.counts[ELEMENTS]))
            elif not out.terminated[i] and front.counts[RING] > 6:
                new = int(front.counts[POINTS] - before.counts[POINTS])
                printed = eta_b(decode(before, reference_slot(before), action, 2, 2.0, False, False), SIXTY)
                product = (printed + 1.0) ** 2 * smoothness(front, new)
                assert out.terms[i, 1] == pytest.approx(product ** (1.0 / (2 + new)) - 1.0, abs=1e-9)
                seen.add(new)
    assert seen == {0, 1}


def smoothness(front: Front, new: int) -> float:
    """s: the new edges' length against the mean of the four, or five, edges around; the less over the greater."""
    ids = front.vid[ring_slots(front)].tolist()
    quad = set(front.quads[front.counts[ELEMENTS] - 1].tolist())
    at = (
        ids.index(front.counts[POINTS] - 1)
        if new
        else next(j for j in range(len(ids)) if {ids[j], ids[(j + 1) % len(ids)]} <= quad)
    )
    around = [ids[(at + j) % len(ids)] for j in range(-2, 3 if new else 4)]
    lengths = np.linalg.norm(np.diff(front.points[around], axis=0), axis=1)
    own = lengths[1:3].mean() if new else lengths[2]
    return float(min(own, lengths.mean()) / max(own, lengths.mean()))


def test_the_two_constants() -> None:
    assert (INVALID_REWARD, LAST_REWARD) == (-0.1, 10.0)
