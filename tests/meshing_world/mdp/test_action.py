"""Actions: what they ask for, and that exactly the right ones are accepted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from play import Turn, coordinates, generic, turns

from envs.domains.load import from_rings, load
from envs.mdp.action import (
    ACCEPTED,
    CHAIN_EDGES,
    REJECTIONS,
    TYPE_0_LEFT,
    TYPE_0_RIGHT,
    TYPE_1,
    TYPE_2,
    decode_point,
    decode_type,
    encode_point,
    encode_type,
)
from envs.mdp.episodes import Episodes
from envs.mdp.front import ELEMENTS, TOLERANCE, reference_slot
from envs.types import MAX_ELEMENT_ANGLE, MIN_ELEMENT_ANGLE, Domain, Floats, MeshingParameters

TYPES_OF = {False: (TYPE_0_RIGHT, TYPE_1, TYPE_0_LEFT), True: (TYPE_0_RIGHT, TYPE_1, TYPE_0_LEFT, TYPE_2)}


def angles(ring: Floats) -> Floats:
    """Interior angles of a counter-clockwise ring, [0, 2 pi)."""
    z = ring @ [1.0, 1.0j]
    return np.angle((np.roll(z, 1) - z) / (np.roll(z, -1) - z)) % (2.0 * np.pi)


def fit(corners: Floats) -> bool:
    """Whether four corners make a valid element."""
    inside = angles(corners)
    return bool(inside.min() > MIN_ELEMENT_ANGLE and inside.max() < MAX_ELEMENT_ANGLE)


def type_of(value: float, type2: bool) -> int:
    types = TYPES_OF[type2]
    return types[min(len(types) - 1, int((value + 1.0) / 2.0 * len(types)))]


def new_points(ring: Floats, pairs: Sequence[tuple[float, float]], n: int, alpha: float) -> Floats:
    """New vertices of radius and angle in [-1, 1] around ring[0]: by rotating the axis, as the text says."""
    edges = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
    around = [i % len(ring) for i in range(-n, n)]
    reach = alpha * edges[around].sum() / (2 * n)
    theta = angles(ring)[0]
    axis = (ring[1] - ring[0]) @ [1.0, 1.0j]
    found = [(r + 1) / 2 * reach * axis / abs(axis) * np.exp(0.5j * (a + 1) * theta) for r, a in pairs]
    return ring[0] + np.array([[z.real, z.imag] for z in found]).reshape(-1, 2)


def element_of(ring: Floats, action: Floats, type2: bool, n: int, alpha: float) -> tuple[Floats, Floats, int]:
    """The corners asked for, the ring that they would leave (its chain start first), and the chain's edges."""
    action_type = type_of(action[0], type2)
    k = CHAIN_EDGES[action_type]
    turned = np.roll(ring, {TYPE_0_RIGHT: 1, TYPE_1: 1, TYPE_0_LEFT: 2, TYPE_2: 0}[action_type], axis=0)
    new = new_points(ring, [tuple(action[i : i + 2]) for i in (1, 3)][: 3 - k], n, alpha)
    corners = np.concatenate([turned[: k + 1], new])
    return corners, np.concatenate([turned[:1], new[::-1], turned[k:]]), k


def acceptable(ring: Floats, action: Floats, type2: bool, n: int, alpha: float, tol: float) -> bool:
    """The validity rule, told with polygons; for rings without seams."""
    corners, left, k = element_of(ring, action, type2, n, alpha)
    if not fit(corners):
        return False
    if not shapely.Polygon(ring).buffer(tol).covers(shapely.Polygon(corners)):
        return False
    start, end = left[0], left[3 - k + 1]
    turned = np.roll(ring, -int(np.flatnonzero((ring == start).all(axis=1))[0]), axis=0)
    rest = shapely.linestrings(np.concatenate([turned[k:], turned[:1]]))
    path = shapely.linestrings(np.concatenate([corners[k:], corners[:1]]))
    own = shapely.union_all(shapely.points([start, end])).buffer(tol)
    if not own.covers(path.intersection(rest)):
        return False
    if not (shapely.Polygon(left).is_valid and shapely.Polygon(left).exterior.is_ccw):
        return False
    kept = angles(left)
    return bool(min(kept[0], kept[3 - k + 1]) > MIN_ELEMENT_ANGLE and (len(left) > 4 or fit(left)))


def assert_judged_rightly(turn: Turn, type2: bool, n: int, alpha: float) -> list[int]:
    """Every tried action was accepted exactly when the rule says so; the rejections."""
    ring, tol = coordinates(turn.before), turn.before.measure[TOLERANCE]
    rejections = turn.episodes.out.rejection.tolist()
    for action, rejection in zip(turn.actions, rejections, strict=True):
        expected = acceptable(ring, action, type2, n, alpha, tol)
        assert (rejection == ACCEPTED) == expected, (REJECTIONS[rejection], action)
    return rejections


# Decoding


@given(st.floats(-1.0, 1.0), st.booleans())
def test_types_share_the_range_equally(value: float, type2: bool) -> None:
    assert decode_type(value, type2) == type_of(value, type2)


def test_ends_of_the_range_and_the_middle() -> None:
    assert [decode_type(v, False) for v in (-1.0, -0.34, -0.33, 0.0, 0.33, 0.34, 1.0)] == [0, 0, 1, 1, 1, 2, 2]
    assert [decode_type(v, True) for v in (-1.0, -0.51, -0.49, -0.01, 0.01, 0.49, 0.51, 1.0)] == [
        0,
        0,
        1,
        1,
        2,
        2,
        3,
        3,
    ]


@pytest.mark.slow
@given(st.integers(0, 20), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.1, 5.0))
def test_the_new_vertex_lies_at_its_radius_and_angle(seed: int, radius: float, turn: float, reach: float) -> None:
    episodes = Episodes([generic("random:11", seed)], MeshingParameters(), 1)
    episodes.start(0, 0)
    front = episodes.front(0)
    slot = reference_slot(front)
    ring = episodes.ring(0)
    point = np.array(decode_point(front, slot, reach, radius, turn))
    assert np.linalg.norm(point - ring[0]) == pytest.approx(reach * (radius + 1.0) / 2.0, abs=1e-12)
    if radius > -0.99:
        z, axis = (point - ring[0]) @ [1.0, 1.0j], (ring[1] - ring[0]) @ [1.0, 1.0j]
        expected = (turn + 1.0) / 2.0 * angles(ring)[0]
        assert np.exp(1j * (np.angle(z / axis) - expected)) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.slow
@given(st.integers(0, 20), st.floats(-0.9, 1.0), st.floats(-0.99, 0.99), st.floats(0.1, 5.0))
def test_encoding_inverts_decoding(seed: int, radius: float, turn: float, reach: float) -> None:
    episodes = Episodes([generic("random:11", seed)], MeshingParameters(), 1)
    episodes.start(0, 0)
    front = episodes.front(0)
    slot = reference_slot(front)
    point = decode_point(front, slot, reach, radius, turn)
    assert encode_point(front, slot, reach, *point) == pytest.approx((radius, turn), abs=1e-9)


@pytest.mark.parametrize("type2", [False, True])
def test_encoding_a_type_inverts_decoding_it(type2: bool) -> None:
    for action_type in TYPES_OF[type2]:
        assert decode_type(encode_type(action_type, type2), type2) == action_type


@pytest.mark.parametrize(("n", "alpha", "type2"), [(2, 2.0, False), (1, 3.0, False), (3, 1.0, True)])
def test_elements_have_the_corners_asked_for(n: int, alpha: float, type2: bool) -> None:
    for turn in turns(generic("random:20"), 0, limit=30, n=n, alpha=alpha, type2=type2):
        ring = coordinates(turn.before)
        for i in np.flatnonzero(turn.episodes.out.rejection == ACCEPTED):
            corners, _, _ = element_of(ring, turn.actions[i], type2, n, alpha)
            front = turn.episodes.front(int(i))
            cut = front.points[front.quads[turn.before.counts[ELEMENTS]]]
            np.testing.assert_allclose(cut, corners, atol=1e-9)


# Validity


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "seed", "options"),
    [
        ("T1", 0, {}), ("T2", 0, {}), ("T3", 0, {"alpha": 3.0}), ("random:11", 0, {}), ("random:20", 1, {}),
        ("random:8", 0, {"n": 1}), ("T1", 0, {"type2": True}), ("random:20", 1, {"type2": True}),
    ],
    ids=str,
)  # fmt: skip
def test_exactly_what_the_rule_allows_is_accepted(name: str, seed: int, options: dict) -> None:
    settings = {"type2": False, "n": 2, "alpha": 2.0} | options
    seen: list[int] = []
    for turn in turns(load(name), seed, tries=24, limit=200, **options):
        seen += assert_judged_rightly(turn, **settings)
    met = {REJECTIONS[rejection] for rejection in seen}
    assert met >= {"", "element angle", "front angle", "crossing"}, "the game is too tame"


def test_exactly_what_the_rule_allows_is_accepted_in_the_end_game() -> None:
    """Rings of 6: what is left must be an element."""
    seen: list[int] = []
    for seed in range(12):
        hexagon = generic(from_rings(np.array([[0, 0], [1, 0], [2, 0.2], [2, 1], [1, 1.1], [0, 1]])), seed, 0.4)
        for turn in turns(hexagon, seed, tries=32, limit=6):
            seen += assert_judged_rightly(turn, False, 2, 2.0)
    assert {ACCEPTED, REJECTIONS.index("last ring")} <= set(seen)


# Mirror images


def mirrored(domain: Domain) -> Domain:
    return from_rings(domain.vertices[::-1] * [-1.0, 1.0], name="mirrored")


@pytest.mark.parametrize("seed", range(4))
def test_mirrored_domains_are_meshed_in_mirror_images(seed: int) -> None:
    domain = generic(f"random:{(8, 11, 20, 5)[seed]}", seed)
    parameters = MeshingParameters(max_invalid=10**9)
    plain, mirror = (Episodes([d], parameters, 1) for d in (domain, mirrored(domain)))
    plain.start(0, 0)
    mirror.start(0, 0)
    rng = np.random.default_rng(seed)
    for _ in range(400):
        action = rng.uniform(-1.0, 1.0, (1, 3))
        out, reflected = plain.step(action), mirror.step(action * [-1.0, 1.0, -1.0])
        assert out.rejection[0] == reflected.rejection[0]
        assert out.reward[0] == pytest.approx(reflected.reward[0], abs=1e-9)
        if out.terminated[0]:
            break
        here, there = plain.ring(0), mirror.ring(0) * [-1.0, 1.0]
        np.testing.assert_allclose(np.roll(there[::-1], 1, axis=0), here, atol=1e-9)
    assert plain.elements(0) > 5
