"""Observations: against the definition, within their bounds, and the same for every placement of the domain."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from play import coordinates, generic, record, turns

from envs.domains.load import load
from envs.mdp import observation
from envs.mdp.episodes import Episodes
from envs.mdp.front import AREA, AREA_0, TOLERANCE, Front, reference_slot, ring_slots
from envs.mdp.observation import Entry, entries, observation_names, observation_size, observe
from envs.mdp.size_field import sources
from envs.mesh_env import spaces_of
from envs.types import NAMED, SCALES, Domain, Floats, MeshingParameters

parameter_sets = st.builds(
    MeshingParameters,
    n=st.integers(1, 8),
    g=st.integers(1, 16),
    beta=st.floats(0.5, 20.0),
    n_rv=st.integers(1, 4),
)
scales = st.sampled_from(SCALES)


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


def definition(front: Front, parameters: MeshingParameters, domain: Domain) -> Floats:
    """The observation by its definition: every vertex is looked at."""
    n, g = parameters.n, parameters.g
    z = coordinates(front) @ [1.0, 1.0j]
    size, around = len(z), [i % len(z) for i in range(-n, n)]
    L = float(np.mean(np.abs(np.roll(z, -1) - z)[around]))
    sizes = front.size[front.vid[ring_slots(front)]]
    L_r = parameters.beta * (float(sizes[0]) if parameters.sized else L)
    right, left = z[1] - z[0], z[-1] - z[0]
    theta = turn_of(right, left)
    entries: list[float] = []
    for j in range(n, 0, -1):
        v = z[-j % size] - z[0]
        entries += [min(1.0, abs(v) / L_r), (theta + shorter(left, v)) / math.pi]
    for j in range(1, n + 1):
        v = z[j % size] - z[0]
        entries += [min(1.0, abs(v) / L_r), shorter(right, v) / math.pi]
    axis = right / abs(right)
    neighbours = {j % size for j in range(-n, n + 1)}
    seen = [(abs(z[i] - z[0]), turn_of(right, z[i] - z[0])) for i in range(size) if i not in neighbours]
    seen = [(d, phi) for d, phi in seen if front.measure[TOLERANCE] < d <= L_r and phi <= theta]
    for j in range(g):
        inside = [(d, phi) for d, phi in seen if min(g - 1, int(phi * g / theta)) == j]
        bisector = (j + 0.5) * theta / g
        if inside:
            d, phi = min(inside)
            entries += [d / L_r, phi / math.pi]
        else:
            entries += [first_hit(z, L_r, axis * complex(math.cos(bisector), math.sin(bisector))), bisector / math.pi]
    entries.append(front.measure[AREA] / front.measure[AREA_0])
    if parameters.sized:
        at = [0, *range(-n, 0), *range(1, n + 1)]
        told = np.append(z[[i % size for i in at]], z[0] + 2.0 * sizes[0] * axis * np.exp(0.5j * theta))
        given = sources(domain)
        cones = np.abs(told[:, None] - given[:, :2] @ [1.0, 1.0j]) * parameters.size_gradient + given[:, 2]
        h = np.minimum(cones.min(axis=1), given[:, 2].max())
        entries += np.clip(np.log(np.array([L, *h[1:]]) / h[0]) / math.log(4.0), -1.0, 1.0).tolist()
    return np.array(entries)


def placed(domain: Domain, turn: float, scale: float, shift: tuple[float, float]) -> Domain:
    """The domain rotated, scaled, and moved by ``shift`` in its own diameters."""
    c, s = np.cos(turn), np.sin(turn)
    moved = domain.points @ np.array([[c, s], [-s, c]]) + domain.diameter * np.array(shift)
    return replace(domain, points=scale * moved)


def documented(parameters: MeshingParameters) -> dict[int, Entry]:
    """The entries that the module's text lists for these parameters, by index."""
    n, g = parameters.n, parameters.g
    m = 4 * n + 2 * g + 1 + parameters.extended * (2 * n + 1)
    groups = {"l": range(1, n + 1), "r": range(1, n + 1), "zeta": range(1, g + 1)}
    row = re.compile(r"    ([\dm].*?)\s{2,}((?:(\w+)\{j\}_)?\w+)\s{2,}(\S.*?)\s{2,}\[(-?\d), (-?\d)\]")
    found: dict[int, Entry] = {}
    switched = {"lacks": parameters.extended, "size": parameters.drift, "_size": parameters.sized}
    for index, name, points, unit, low, high in row.findall(str(observation.__doc__)):
        if not all(on for end, on in switched.items() if name == end or (end != "size" and name.endswith(end))):
            continue
        for j in groups[points] if points else [0]:
            at = eval(re.sub(r"(\d) (?=[(a-z])", r"\1 * ", index), {"n": n, "g": g, "m": m, "j": j})
            assert at not in found
            found[at] = Entry(name.replace("{j}", str(j)), unit, int(low), int(high))
    return found


@given(parameter_sets, st.booleans(), scales)
def test_size_names_bounds_and_text_are_the_table_s(parameters: MeshingParameters, extended: bool, scale: str) -> None:
    parameters = replace(parameters, extended=extended, scale=scale)  # type: ignore[arg-type]
    table, size = entries(parameters), observation_size(parameters)
    n, g, sized = parameters.n, parameters.g, scale == "size"
    assert size == 4 * n + 2 * g + 1 + extended * (2 * n + 1) + (extended or sized) + sized * (2 * n + 1) == len(table)
    assert observation_names(parameters) == [entry.name for entry in table]
    assert len(set(observation_names(parameters))) == size
    told = documented(parameters)
    assert [told[at] for at in range(size)] == table
    assert len(told) == size
    box, _ = spaces_of(parameters)
    assert (box.shape, box.dtype) == ((size,), np.float32)
    assert [(entry.low, entry.high) for entry in table] == list(zip(box.low.tolist(), box.high.tolist(), strict=True))
    assert all(-np.inf < entry.low < entry.high < np.inf for entry in table)


def test_o2_is_laid_out_as_documented() -> None:
    parameters = MeshingParameters(**NAMED["observation"]["O2"])  # type: ignore[arg-type]
    assert parameters == MeshingParameters()
    assert observation_size(parameters) == 15
    points = ["l2", "l1", "r1", "r2", "zeta1", "zeta2", "zeta3"]
    assert observation_names(parameters) == [f"{p}_{part}" for p in points for part in ("length", "angle")] + ["rho"]


@settings(max_examples=25)
@given(parameter_sets, st.booleans(), scales, st.integers(0, 20))
def test_every_entry_is_written_and_nothing_beyond(
    parameters: MeshingParameters, extended: bool, scale: str, seed: int
) -> None:
    parameters = replace(parameters, extended=extended, scale=scale)  # type: ignore[arg-type]
    episodes = Episodes([generic("random:11", seed)], parameters, 1)
    episodes.start(0, 0)
    front, size = episodes.front(0), observation_size(parameters)
    out = np.full(size + 3, np.nan, dtype=np.float32)
    n, g, beta = parameters.n, parameters.g, parameters.beta
    observe(front, reference_slot(front), n, g, beta, extended, scale == "size", out)
    np.testing.assert_array_equal(np.isnan(out), np.arange(size + 3) >= size)


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


@pytest.mark.parametrize(
    ("points", "angles"),
    [([(0, 0), (1, 0), (1, 1), (1, 2), (0, 2), (0, 1)], [0.5, 0.5, 0.0, 0.25]),
     ([(0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (0, 1)], [0.25, 0.5, 0.0, 0.0])],
    ids=["on the right", "on the left"],
)  # fmt: skip
def test_where_the_front_turns_is_seen_on_its_side(points: list[tuple[float, float]], angles: list[float]) -> None:
    """A rectangle in six segments, from a corner: counter-clockwise from the front ahead, over pi."""
    corners = np.array(points, dtype=np.float64)
    domain = Domain("rectangle", corners, np.arange(6), np.stack([np.arange(6), (np.arange(6) + 1) % 6], axis=1))
    seen = record(domain, 0, 0)[0][0]
    np.testing.assert_allclose(seen[1:8:2], angles, atol=1e-6)


@settings(max_examples=25)
@given(parameter_sets, st.booleans(), scales, st.integers(0, 500), st.booleans(), st.integers(0, 2))
def test_play_stays_within_the_bounds(
    parameters: MeshingParameters, extended: bool, scale: str, seed: int, type2: bool, holes: int
) -> None:
    domain = load(f"random:{seed}?vertices=40&holes={holes}")
    options = {name: getattr(parameters, name) for name in ("n", "g", "beta", "n_rv")}
    observations = record(domain, seed, 150, type2=type2, extended=extended, scale=scale, **options)[0]
    table = entries(replace(parameters, extended=extended, scale=scale))  # type: ignore[arg-type]
    assert observations.dtype == np.float32
    assert observations.shape[1] == len(table)
    for entry, values in zip(table, observations.T, strict=True):
        assert entry.low <= values.min() <= values.max() <= entry.high, entry.name  # a NaN is neither


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("T1", {}), ("T2", {}), ("D9", {}), ("random:3", {}), ("random:5", {}),
        ("random:20", NAMED["observation"]["O3"]),
        ("random:11", {"n": 1, "g": 1, "beta": 2.0}), ("random:58?holes=2&vertices=60", {"n": 4, "g": 8, "beta": 10.0}),
        ("random:3", {"type2": True, "n": 8, "g": 16}), ("T1", {"scale": "size"}),
        ("random:3", {"scale": "size"}), ("random:5", {"scale": "size", "g": 5, "size_gradient": 0.05}),
    ],
    ids=str,
)  # fmt: skip
def test_play_is_observed_by_the_definition(name: str, options: dict) -> None:
    parameters = MeshingParameters(**options)
    domain = generic(name)
    for turn in turns(domain, 0, tries=8, limit=80, **options):
        out = turn.episodes.out
        if turn.chosen is not None and not out.terminated[turn.chosen]:
            np.testing.assert_allclose(
                out.observation[turn.chosen], definition(turn.after, parameters, domain), atol=4e-6
            )


@settings(max_examples=20)
@given(
    seed=st.integers(0, 500), turn=st.floats(-7.0, 7.0), exponent=st.floats(-6.0, 6.0),
    shift=st.tuples(st.floats(-50, 50), st.floats(-50, 50)), holes=st.integers(0, 1), type2=st.booleans(),
    scale=scales,
)  # fmt: skip
@example(seed=1, turn=1.0, exponent=-6.0, shift=(50.0, -50.0), holes=1, type2=True, scale="size")
@example(seed=2, turn=2.0, exponent=6.0, shift=(-50.0, 50.0), holes=0, type2=False, scale="front")
def test_episodes_do_not_depend_on_where_the_domain_lies(
    seed: int, turn: float, exponent: float, shift: tuple[float, float], holes: int, type2: bool, scale: str
) -> None:
    domain = generic(f"random:{seed}?vertices=40&holes={holes}", seed)
    elsewhere = placed(domain, turn, 10.0**exponent, shift)
    here, there = (record(d, seed, 300, type2=type2, scale=scale) for d in (domain, elsewhere))
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
