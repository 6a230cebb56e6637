"""Random domains: sound, repeatable, varied, and as wished."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.domains import random_domain as generator
from envs.domains.load import load
from envs.domains.random_domain import (
    FAMILIES,
    LEAST_ANGLE,
    LEAST_CLEARANCE,
    LEAST_SEGMENT,
    RandomDomains,
    random_domain,
)
from envs.polygons.turning import signed_angles
from envs.types import Domain, DomainError

SAMPLE = range(0, 2001, 23)
#: What names of files may be made of on every system, and in a shell without quotes.
EVERYWHERE = r"[A-Za-z0-9._=-]{1,100}"


@pytest.fixture(scope="module")
def sample() -> list[Domain]:
    """Domains of a share of the seeds."""
    return [random_domain(seed) for seed in SAMPLE]


def holes_of(domain: Domain) -> int:
    """How many holes a domain has: its segments enclose one face more."""
    faces = shapely.polygonize(shapely.linestrings(domain.points[domain.segments]))
    return len(faces.geoms) - 1


def filled(domain: Domain) -> float:
    """Share of its convex hull that a domain without holes fills: 1 for a convex one."""
    polygon = shapely.Polygon(domain.vertices)
    return polygon.area / polygon.convex_hull.area


def test_sound(sample: list[Domain]) -> None:
    for domain in sample:
        assert len(domain.ring) % 2 == len(domain.segments) % 2 == 0
        assert 24 <= len(domain.segments) <= 200
        assert domain.area > 0
        lines = shapely.union_all(shapely.linestrings(domain.points[domain.segments]))
        assert shapely.get_num_geometries(lines) == len(domain.segments), domain.name


def test_roomy(sample: list[Domain]) -> None:
    for domain in sample:
        ends = domain.points[domain.segments]
        ahead = ends[:, 1] - ends[:, 0]
        length = np.linalg.norm(ahead, axis=1)
        before = np.argsort(domain.segments[:, 1])  # the segment that ends where each one begins
        assert length.min() >= LEAST_SEGMENT * length.mean()
        assert np.abs(signed_angles(ahead, -ahead[before])).min() >= LEAST_ANGLE
        local = 0.5 * (length + length[before])
        apart = shapely.distance(shapely.points(ends[:, 0])[:, None], shapely.linestrings(ends)[None])
        for near in (0, 1):  # a vertex's own segments, and their neighbours
            here = domain.segments[:, near]
            apart[(here[None] == np.arange(len(ends))[:, None])] = np.inf
            apart[(here[None] == domain.segments[:, 1][:, None])] = np.inf
            apart[(here[None] == domain.segments[before, 0][:, None])] = np.inf
        assert (apart.min(axis=1) >= LEAST_CLEARANCE * local).all(), domain.name


def test_repeatable(sample: list[Domain]) -> None:
    for seed, domain in list(zip(SAMPLE, sample, strict=True))[::10]:
        again = load(f"random:{seed}")
        assert again.name == domain.name == f"random-{seed}"
        np.testing.assert_array_equal(again.points, domain.points)
        np.testing.assert_array_equal(again.ring, domain.ring)


def test_varied(sample: list[Domain]) -> None:
    holes = [holes_of(domain) for domain in sample]
    assert 0.5 < np.mean(np.array(holes) == 0) < 0.95
    assert max(holes) >= 2
    fill = np.array([filled(d) for d, h in zip(sample, holes, strict=True) if h == 0])
    assert fill.max() > 0.99, "convex ones"
    assert fill.min() < 0.6, "deeply notched ones"
    assert len({len(domain.segments) for domain in sample}) > 20


def test_spikiness_empties_the_hull() -> None:
    mild, sharp = ([filled(random_domain(seed, spikiness=x, holes=0)) for seed in range(30)] for x in (0.0, 1.0))
    assert np.mean(mild) > np.mean(sharp) + 0.1


def test_every_family_is_drawn() -> None:
    rng = np.random.default_rng(0)
    for family in FAMILIES:
        outlines = [family(rng, spikiness, 8) for spikiness in (0.0, 0.5, 1.0) for _ in range(5)]
        assert sum(shapely.Polygon(outline).is_valid for outline in outlines) >= 12, family.__name__


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    half=st.integers(12, 100),
    spikiness=st.floats(0, 1),
    holes=st.integers(0, 2),
    unevenness=st.floats(1, 4),
)
def test_wishes_are_met(seed: int, half: int, spikiness: float, holes: int, unevenness: float) -> None:
    domain = random_domain(seed, vertices=2 * half, spikiness=spikiness, holes=holes, unevenness=unevenness)
    assert len(domain.segments) == 2 * half
    assert holes_of(domain) == holes
    np.testing.assert_array_equal(load(domain.name).points, domain.points)
    assert re.fullmatch(EVERYWHERE, domain.name)


@pytest.mark.parametrize("holes", range(9))
def test_what_finds_no_room_falls_back_to_a_disc(monkeypatch: pytest.MonkeyPatch, holes: int) -> None:
    monkeypatch.setattr(generator, "ATTEMPTS", 0)
    domain = random_domain(3, vertices=60, holes=holes)
    assert len(domain.segments) == 60
    assert holes_of(domain) == holes
    assert filled(random_domain(3, vertices=60, holes=0)) > 0.99


def test_specs() -> None:
    domain = load("random:7?spikiness=0.5&holes=1&vertices=80")
    assert len(domain.segments) == 80
    assert holes_of(domain) == 1
    np.testing.assert_array_equal(domain.points, random_domain(7, spikiness=0.5, holes=1, vertices=80).points)
    again = load("RANDOM-7_Spikiness=0.5_holes=1_vertices=80")
    assert again.name == domain.name == "random-7_vertices=80_spikiness=0.5_holes=1"
    np.testing.assert_array_equal(again.points, domain.points)


@given(st.integers(0, 2**63 - 1), st.floats(0, 1) | st.none())
def test_a_name_names_one_domain(seed: int, spikiness: float | None) -> None:
    name = random_domain(seed, vertices=24, spikiness=spikiness, holes=0).name
    with pytest.MonkeyPatch.context() as patch:
        asked: list[object] = []
        patch.setattr(generator, "random_domain", lambda *found, **given: asked.append((found, given)))
        generator.from_spec(name)
    given_ = {"vertices": 24, "spikiness": spikiness, "holes": 0}
    assert asked == [((seed,), {key: value for key, value in given_.items() if value is not None})]


def test_those_kept_from_training_have_short_names() -> None:
    for i, domain in enumerate(RandomDomains().held_out(3)):
        assert domain.name == f"random-held-out-{i}"
        np.testing.assert_array_equal(domain.points, load(f"random:{2**62 + i}").points)
        np.testing.assert_array_equal(domain.points, load(domain.name).points)


def test_a_file_of_such_a_name_is_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("random-7.json", "random-7_a=1.json", "part-7.json"):
        (tmp_path / name).write_text("[[0, 0], [1, 0], [2, 0], [2, 1], [1, 1], [0, 1]]")
        assert load(name).name == Path(name).stem
        assert len(load(name).points) == 6


@pytest.mark.parametrize(("spec", "message"), [
    ("random:", "seed = '' is not a whole number"),
    ("random:x", "seed = 'x' is not a whole number"),
    ("random:-1", "seed = -1 is out of range"),
    ("random-7_shape=1", "unknown parameter 'shape'; use vertices, spikiness, holes, unevenness"),
    ("random-held-out-4611686018427387904", "out of range"),
    ("random:7?shape=1", "unknown parameter 'shape'; use vertices, spikiness, holes, unevenness"),
    ("random:7?holes=9", "holes = 9 is out of range; choose it from 0 to 8"),
    ("random:7?holes=1.5", "holes = '1.5' is not a whole number"),
    ("random:7?vertices=31", "vertices = 31 is odd"),
    ("random:7?vertices=14&holes=2", "vertices = 14 is out of range; choose it from 24"),
    ("random:7?spikiness=nan", "spikiness = nan is out of range"),
    ("random:7?spikiness", "spikiness = '' is not a number"),
])  # fmt: skip
def test_bad_specs(spec: str, message: str) -> None:
    with pytest.raises(DomainError, match=message) as caught:
        load(spec)
    assert str(caught.value).replace(":", "-", 1).startswith(re.split("[?_]", spec)[0].replace(":", "-"))
