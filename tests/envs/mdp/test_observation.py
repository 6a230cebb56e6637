"""Observations: against the definition, within their bounds, and the same for every placement of the domain."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from play import coordinates, generic, record, turns

from envs.domains.load import load
from envs.mdp.front import AREA, AREA_0, TOLERANCE, Front
from envs.mdp.observation import bounds, names
from envs.mesh_env import spaces_of
from envs.types import OBSERVATIONS, Domain, Floats, MeshingParameters

parameter_sets = st.builds(
    MeshingParameters,
    n=st.integers(1, 8),
    g=st.integers(1, 16),
    beta=st.floats(0.5, 20.0),
    n_rv=st.integers(1, 4),
)


def turn_of(u: complex, v: complex) -> float:
    """The angle from u counter-clockwise to v, [0, 2 pi)."""
    turn = math.atan2(u.real * v.imag - u.imag * v.real, u.real * v.real + u.imag * v.imag)
    return turn if turn >= 0.0 else turn + 2.0 * math.pi


def shorter(u: complex, v: complex) -> float:
    return math.remainder(turn_of(u, v), 2.0 * math.pi)


def first_hit(z: np.ndarray, L_r: float, direction: complex) -> float:
    """Where a ray from z[0] first meets the ring, over L_r; edges at z[0] or at its other side do not count."""
    ray = shapely.LineString([(0.0, 0.0), (L_r * direction.real, L_r * direction.imag)])
    relative = z - z[0]
    ends = np.stack([relative, np.roll(relative, -1)], axis=1)
    ends = ends[(ends != 0.0).all(axis=1)]
    edges = shapely.linestrings(np.stack([ends.real, ends.imag], axis=-1))
    hits = shapely.intersection(ray, edges)
    hits = hits[~shapely.is_empty(hits)]
    return min([L_r, *shapely.distance(shapely.Point(0.0, 0.0), hits)]) / L_r


def definition(front: Front, parameters: MeshingParameters) -> Floats:
    """The observation by its definition: every vertex is looked at."""
    n, g = parameters.n, parameters.g
    z = coordinates(front) @ [1.0, 1.0j]
    size, around = len(z), [i % len(z) for i in range(-n, n)]
    L_r = parameters.beta * float(np.mean(np.abs(np.roll(z, -1) - z)[around]))
    right, left = z[1] - z[0], z[-1] - z[0]
    theta = turn_of(right, left)
    entries: list[float] = []
    for j in range(n, 0, -1):
        v = z[-j % size] - z[0]
        entries += [min(1.0, abs(v) / L_r), (theta + shorter(left, v)) / math.pi]
    for j in range(1, n + 1):
        v = z[j % size] - z[0]
        entries += [min(1.0, abs(v) / L_r), shorter(right, v) / math.pi]
    neighbours = {j % size for j in range(-n, n + 1)}
    seen = [(abs(z[i] - z[0]), turn_of(right, z[i] - z[0])) for i in range(size) if i not in neighbours]
    seen = [(d, phi) for d, phi in seen if front.measure[TOLERANCE] < d <= L_r and phi <= theta]
    for j in range(g):
        inside = [(d, phi) for d, phi in seen if min(g - 1, int(phi * g / theta)) == j]
        bisector = (j + 0.5) * theta / g
        axis = right / abs(right)
        if inside:
            d, phi = min(inside)
            entries += [d / L_r, phi / math.pi]
        else:
            entries += [first_hit(z, L_r, axis * complex(math.cos(bisector), math.sin(bisector))), bisector / math.pi]
    return np.array([*entries, front.measure[AREA] / front.measure[AREA_0]])


def placed(domain: Domain, turn: float, scale: float, shift: tuple[float, float]) -> Domain:
    """The domain rotated, scaled, and moved by ``shift`` in its own diameters."""
    c, s = np.cos(turn), np.sin(turn)
    moved = domain.points @ np.array([[c, s], [-s, c]]) + domain.diameter * np.array(shift)
    return replace(domain, points=scale * moved)


@given(parameter_sets)
def test_sizes_names_and_bounds_go_together(parameters: MeshingParameters) -> None:
    low, high = bounds(parameters)
    size = 4 * parameters.n + 2 * parameters.g + 1
    assert parameters.observation_size == size == len(low) == len(high) == len(names(parameters))
    assert len(set(names(parameters))) == size
    box, _ = spaces_of(parameters)
    assert box.is_bounded()
    assert box.dtype == np.float32
    assert (low < high).all()


def test_o2_is_laid_out_as_documented() -> None:
    parameters = MeshingParameters(**OBSERVATIONS["O2"])
    assert parameters == MeshingParameters()
    assert parameters.observation_size == 15
    points = ["l2", "l1", "r1", "r2", "zeta1", "zeta2", "zeta3"]
    assert names(parameters) == [f"{p}_{part}" for p in points for part in ("length", "angle")] + ["rho"]


@given(parameter_sets)
def test_the_table_of_indices_is_right(parameters: MeshingParameters) -> None:
    n, g, found = parameters.n, parameters.g, names(parameters)
    low, high = bounds(parameters)
    rows = [(f"l{j}", 2 * (n - j), (-1, 3)) for j in range(1, n + 1)]
    rows += [(f"r{j}", 2 * n + 2 * (j - 1), (-1, 1)) for j in range(1, n + 1)]
    rows += [(f"zeta{j}", 4 * n + 2 * (j - 1), (0, 2)) for j in range(1, g + 1)]
    for point, at, angles in rows:
        assert (found[at], found[at + 1]) == (f"{point}_length", f"{point}_angle")
        assert (low[at], high[at], low[at + 1], high[at + 1]) == (0, 1, *angles)
    assert (found[4 * n + 2 * g], low[-1], high[-1]) == ("rho", 0, 1)


def test_a_square_front_is_seen_as_drawn() -> None:
    """A unit square in eight segments: V_0 is a corner, its neighbours lie half a side apart."""
    points = np.array([[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]], dtype=np.float64)
    domain = Domain("square", points, np.arange(8), np.stack([np.arange(8), (np.arange(8) + 1) % 8], axis=1))
    seen = record(domain, 0, 0)[0][0]
    diagonal = math.sqrt(8.0)
    expected = [2, 0.5, 1, 0.5, 1, 0, 2, 0, math.sqrt(5.0), math.atan2(1, 2) / math.pi,
                diagonal, 0.25, math.sqrt(5.0), math.atan2(2, 1) / math.pi]  # fmt: skip
    np.testing.assert_allclose(seen[:-1:2], np.array(expected[::2]) / 6.0, atol=1e-6)
    np.testing.assert_allclose(seen[1::2], expected[1::2], atol=1e-6)
    assert seen[-1] == 1.0


@settings(max_examples=25)
@given(parameter_sets, st.integers(0, 500), st.booleans(), st.integers(0, 2))
def test_play_stays_within_the_bounds(parameters: MeshingParameters, seed: int, type2: bool, holes: int) -> None:
    domain = load(f"random:{seed}?vertices=40&holes={holes}")
    options = {"n": parameters.n, "g": parameters.g, "beta": parameters.beta, "n_rv": parameters.n_rv}
    box, _ = spaces_of(replace(parameters, type2=type2))
    observations = record(domain, seed, 150, type2=type2, **options)[0]
    assert observations.dtype == np.float32
    assert np.isfinite(observations).all()
    assert all(box.contains(row) for row in observations)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("T1", {}), ("T2", {}), ("D9", {}), ("random:3", {}), ("random:5", {}), ("random:20", OBSERVATIONS["O3"]),
        ("random:11", {"n": 1, "g": 1, "beta": 2.0}), ("random:58?holes=2&vertices=60", {"n": 4, "g": 8, "beta": 10.0}),
        ("random:3", {"type2": True, "n": 8, "g": 16}),
    ],
    ids=str,
)  # fmt: skip
def test_play_is_observed_by_the_definition(name: str, options: dict) -> None:
    parameters = MeshingParameters(**options)
    for turn in turns(generic(name), 0, tries=8, limit=80, **options):
        out = turn.episodes.out
        if turn.chosen is not None and not out.terminated[turn.chosen]:
            np.testing.assert_allclose(out.observation[turn.chosen], definition(turn.after, parameters), atol=2e-6)


@settings(max_examples=20)
@given(
    seed=st.integers(0, 500), turn=st.floats(-7.0, 7.0), exponent=st.floats(-6.0, 6.0),
    shift=st.tuples(st.floats(-50, 50), st.floats(-50, 50)), holes=st.integers(0, 1), type2=st.booleans(),
)  # fmt: skip
@example(seed=1, turn=1.0, exponent=-6.0, shift=(50.0, -50.0), holes=1, type2=True)
@example(seed=2, turn=2.0, exponent=6.0, shift=(-50.0, 50.0), holes=0, type2=False)
def test_episodes_do_not_depend_on_where_the_domain_lies(
    seed: int, turn: float, exponent: float, shift: tuple[float, float], holes: int, type2: bool
) -> None:
    domain = generic(f"random:{seed}?vertices=40&holes={holes}", seed)
    elsewhere = placed(domain, turn, 10.0**exponent, shift)
    here, there = (record(d, seed, 300, type2=type2) for d in (domain, elsewhere))
    np.testing.assert_allclose(here[0], there[0], atol=2e-6)
    np.testing.assert_allclose(here[1], there[1], atol=1e-6)
    np.testing.assert_array_equal(here[2], there[2])
    assert (here[2] == 0).sum() > 0


@pytest.mark.parametrize("name", ["random:5", "D5", "random:3"])
@pytest.mark.parametrize("turn", [0.3, 2.0, 4.4])
def test_straight_sides_look_the_same_in_every_direction(name: str, turn: float) -> None:
    """The vertices beyond the neighbours on a straight side are seen, or not, whatever rounding says."""
    domain = load(name)
    here, there = (record(d, 1, 300) for d in (domain, placed(domain, turn, 1.0, (0.0, 0.0))))
    np.testing.assert_allclose(here[0], there[0], atol=2e-6)
    np.testing.assert_array_equal(here[2], there[2])
