"""What the MDP knows beyond the paper: elements that vertices lack to be regular, and the size wanted."""

from __future__ import annotations

import numpy as np
import pytest
from play import turns

from envs.domains.load import load
from envs.mdp.front import AREA, ELEMENTS, GIVEN, POINTS, REGULAR, reference_slot, wanted
from envs.mdp.observation import observation_names
from envs.mesh_env import spaces_of
from envs.types import MeshingParameters

DOMAINS = ["T1", "random:20", "random:3"]


@pytest.mark.parametrize("name", DOMAINS)
@pytest.mark.parametrize("type2", [False, True])
def test_what_is_lacking_is_what_was_wanted_less_what_there_is(name: str, type2: bool) -> None:
    domain = load(name)
    for turn in turns(domain, 4, limit=60, type2=type2):
        front = turn.episodes.front(turn.chosen or 0)
        points, given = front.counts[POINTS], front.counts[GIVEN]
        quads = front.quads[: front.counts[ELEMENTS]]
        start = np.concatenate([wanted(domain), np.full(points - given, REGULAR)])
        np.testing.assert_array_equal(front.need[:points], start - np.bincount(quads.ravel(), minlength=points))


@pytest.mark.parametrize("name", ["D1", "random:3"])
def test_the_boundary_wants_an_element_for_every_right_angle(name: str) -> None:
    domain = load(name)
    lacking = wanted(domain)
    here = domain.vertices
    ahead, behind = np.roll(here, -1, axis=0) - here, np.roll(here, 1, axis=0) - here
    cross = ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0]
    angles = np.mod(np.arctan2(cross, (ahead * behind).sum(axis=1)), 2 * np.pi)
    single = np.bincount(domain.ring)[domain.ring] == 1
    expected = np.maximum(1, np.rint(angles / (np.pi / 2)))
    np.testing.assert_array_equal(lacking[domain.ring][single], expected[single])
    seam = np.setdiff1d(np.arange(len(domain.points)), domain.segments)
    np.testing.assert_array_equal(lacking[seam], REGULAR)


@pytest.mark.parametrize("name", DOMAINS)
def test_it_is_observed(name: str) -> None:
    parameters = MeshingParameters(extended=True)
    box, _ = spaces_of(parameters)
    labels = observation_names(parameters)
    assert labels[-6:] == ["l2_lacks", "l1_lacks", "0_lacks", "r1_lacks", "r2_lacks", "size"]
    for turn in turns(load(name), 1, limit=40, extended=True):
        if turn.chosen is None or turn.episodes.out.terminated[turn.chosen]:
            continue
        seen = turn.episodes.out.observation[turn.chosen]
        front = turn.after
        slot = int(reference_slot(front))
        slot = front.prv[front.prv[slot]]
        for value in seen[-6:-1]:
            assert value == np.float32(np.clip(front.need[front.vid[slot]] / 4, -1, 1))
            slot = front.nxt[slot]
        assert box.contains(seen)


@pytest.mark.parametrize("name", DOMAINS)
def test_irregular_vertices_cost_their_weight(name: str) -> None:
    """nu counts, at every new vertex that leaves the front, the elements too many or too few."""
    weight = 0.25
    for turn in turns(load(name), 3, limit=60, irregular=weight):
        if turn.chosen is None or turn.episodes.out.terminated[turn.chosen]:
            continue
        before, after = turn.before, turn.after
        gone = np.setdiff1d(before.vid[before.prv >= 0], after.vid[after.prv >= 0])
        new = gone[gone >= after.counts[GIVEN]]
        expected = -weight * np.abs(after.need[new]).sum()
        assert turn.episodes.out.terms[turn.chosen, 3] == pytest.approx(expected)


@pytest.mark.parametrize("name", DOMAINS)
def test_the_local_density_pays_for_the_area_that_the_sizes_around_want(name: str) -> None:
    for turn in turns(load(name), 6, limit=60, density="local", upsilon=0.8):
        if turn.chosen is None or turn.episodes.out.terminated[turn.chosen]:
            continue
        before, after = turn.before, turn.after
        quad = after.quads[after.counts[ELEMENTS] - 1]
        chain = quad[np.isin(quad, before.vid[before.prv >= 0])]
        cut_area = before.measure[AREA] - after.measure[AREA]
        expected = -min(1.0, np.log2(cut_area / (0.8 * before.size[chain].mean() ** 2)) ** 2)
        assert turn.episodes.out.terms[turn.chosen, 2] == pytest.approx(expected, abs=1e-6)
