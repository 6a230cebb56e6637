"""Varied domains: sound, repeatable, of all shapes, and no larger than is said."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from envs.domains.load import VariedDomains, load, source
from envs.domains.varied_domain import ATTEMPTS, ELEMENTS, FEWEST, MOST, SHAPES, SHARES, rectangle, varied_domain
from envs.polygons.element_count import expected_in_domain
from envs.types import Domain, DomainError

SAMPLE = range(0, 300, 3)


@pytest.fixture(scope="module")
def sample() -> list[Domain]:
    return [varied_domain(seed) for seed in SAMPLE]


def lengths(domain: Domain) -> np.ndarray:
    ends = domain.points[domain.segments]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


def test_sound(sample: list[Domain]) -> None:
    for domain in sample:
        assert len(domain.ring) % 2 == 0
        assert FEWEST - 12 <= len(domain.segments) <= MOST
        assert len(domain.ring) <= VariedDomains().vertices
        assert expected_in_domain(domain) <= ELEMENTS
        lines = shapely.union_all(shapely.linestrings(domain.points[domain.segments]))
        assert shapely.get_num_geometries(lines) == len(domain.segments), domain.name


def test_fine_and_coarse_uniform_and_graded(sample: list[Domain]) -> None:
    counts = np.array([len(domain.segments) for domain in sample])
    assert counts.min() < 30
    assert counts.max() > 400
    ratios = np.array([lengths(domain).max() / lengths(domain).min() for domain in sample])
    assert 0.2 < (ratios < 1.4).mean() < 0.8
    assert (ratios > 2.0).mean() > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.__name__)
def test_every_shape_makes_domains_of_every_size(shape) -> None:  # type: ignore[no-untyped-def]
    random = np.random.default_rng(0)
    for vertices in (20, 60, 200, 600):
        made = [domain for _ in range(ATTEMPTS // 8) if (domain := shape(random, vertices, "shape")) is not None]
        assert made, vertices
        assert max(len(domain.segments) for domain in made) <= MOST + 12


def test_shapes_are_drawn_as_often_as_said() -> None:
    assert len(SHAPES) == len(SHARES)
    assert sum(SHARES) == pytest.approx(1.0)


def test_rectangles_have_long_straight_rows_that_match() -> None:
    """Most are lattices: opposite sides with equal numbers of equal segments, of up to hundreds."""
    random, rows = np.random.default_rng(0), []
    for vertices in (40, 120, 300, 600):
        for _ in range(20):
            domain = rectangle(random, vertices, "rectangle")
            assert domain is not None
            step = np.roll(domain.vertices, -1, axis=0) - domain.vertices
            turn = np.abs(step[:, 0] * np.roll(step[:, 1], 1) - step[:, 1] * np.roll(step[:, 0], 1))
            corners = np.flatnonzero(turn > 1e-9 * (step**2).sum(axis=1))
            assert len(corners) == 4
            sides = np.diff(np.append(corners, corners[0] + len(step)))
            long = [
                np.linalg.norm(step[np.arange(c, c + s) % len(step)], axis=1)
                for c, s in zip(corners, sides, strict=True)
            ]
            if sides[0] == sides[2] and all(np.ptp(one) < 1e-9 for one in long):
                rows.append(sides.max())
    assert len(rows) >= 40
    assert max(rows) > 200


def test_repeatable_by_name_and_from_the_supply() -> None:
    supply = source("varied")
    assert isinstance(supply, VariedDomains)
    drawn = supply.draw(np.random.default_rng(5))
    again = load(drawn.name)
    np.testing.assert_array_equal(again.points, drawn.points)
    np.testing.assert_array_equal(again.ring, drawn.ring)
    for i, domain in enumerate(supply.held_out(3)):
        assert domain.name == f"varied-held-out-{i}"
        np.testing.assert_array_equal(load(domain.name).points, domain.points)
    np.testing.assert_array_equal(load("varied:9").points, varied_domain(9).points)


@pytest.mark.parametrize("spec", ["varied:", "varied:x", "varied:-1"])
def test_no_seed(spec: str) -> None:
    with pytest.raises(DomainError, match="seed"):
        load(spec)
