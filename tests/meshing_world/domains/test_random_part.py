"""Random parts: sound, repeatable, varied, evenly discretised, and none that a training could have met."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from envs.domains import outline_families, part_families
from envs.domains.load import load
from envs.domains.part_families import FAMILIES
from envs.domains.random_part import ALL, FEWEST, MOST, NEIGHBOURS, random_part
from envs.types import Domain, DomainError

SEEDS = range(0, 1200, 7)


@pytest.fixture(scope="module")
def parts() -> list[Domain]:
    """Parts of a share of the seeds."""
    return [random_part(seed) for seed in SEEDS]


def holes_of(domain: Domain) -> int:
    """How many holes a domain has: its segments enclose one face more."""
    return len(shapely.polygonize(shapely.linestrings(domain.points[domain.segments])).geoms) - 1


def lengths(domain: Domain) -> np.ndarray:
    """(s,) lengths of the given segments."""
    ends = domain.points[domain.segments]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


def test_sound(parts: list[Domain]) -> None:
    for part in parts:
        assert len(part.segments) % 2 == 0
        assert FEWEST <= len(part.segments) <= MOST
        lines = shapely.union_all(shapely.linestrings(part.points[part.segments]))
        assert shapely.get_num_geometries(lines) == len(part.segments), part.name
        faces = shapely.polygonize(shapely.linestrings(part.points[part.segments])).geoms
        outer = max(faces, key=lambda face: shapely.Polygon(face.exterior).area)
        assert part.area == pytest.approx(outer.area, rel=1e-9)


def test_segments_are_of_a_size(parts: list[Domain]) -> None:
    assert max(lengths(part).max() / lengths(part).min() for part in parts) <= ALL
    ratios = [lengths(part).max() / lengths(part).min() for part in parts]
    assert np.mean(np.array(ratios) < 2.0) > 0.4, "many are evenly spaced"
    assert np.mean(np.array(ratios) > 2.0) > 0.2, "many are graded"


def test_neighbouring_segments_are_alike(parts: list[Domain]) -> None:
    for part in parts:
        length = lengths(part)
        before = np.argsort(part.segments[:, 1])  # the segment that ends where each one begins
        assert (length <= (1 + 1e-12) * NEIGHBOURS * length[before]).all()
        assert (length[before] <= (1 + 1e-12) * NEIGHBOURS * length).all()


def test_varied(parts: list[Domain]) -> None:
    hollow = np.array([holes_of(part) for part in parts])
    assert 0.2 < np.mean(hollow > 0) < 0.45
    assert hollow.max() >= 4
    counts = np.array([len(part.segments) for part in parts])
    assert np.percentile(counts, 10) < 60 < 250 < np.percentile(counts, 90)


def test_repeatable(parts: list[Domain]) -> None:
    for seed, part in list(zip(SEEDS, parts, strict=True))[::12]:
        again = load(f"part-{seed}")
        assert again.name == part.name == load(f"part:{seed}").name == f"part-{seed}"
        np.testing.assert_array_equal(again.points, part.points)
        np.testing.assert_array_equal(again.ring, part.ring)


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.__name__)
def test_a_family_gives_polygons_of_unit_size(family: part_families.Family) -> None:
    rng = np.random.default_rng(1)
    shapes = [family(rng) for _ in range(20)]
    good = [shape for shape in shapes if isinstance(shape, shapely.Polygon) and shape.is_valid]
    assert len(good) >= 15
    assert all(0.5 < np.ptp(np.array(shape.bounds).reshape(2, 2), axis=0).max() < 5.0 for shape in good)
    assert len({round(shape.area, 6) for shape in good}) > 10


def test_families_are_not_those_of_training() -> None:
    trained = {family.__name__ for family in outline_families.FAMILIES}
    assert not {family.__name__ for family in FAMILIES} & trained


@pytest.mark.parametrize(("spec", "message"), [
    ("part:", "seed = '' is not a whole number"),
    ("part:x", "seed = 'x' is not a whole number"),
    ("part:-1", "seed = -1 is out of range; choose it from 0 to"),
])  # fmt: skip
def test_bad_specs(spec: str, message: str) -> None:
    with pytest.raises(DomainError, match=message) as caught:
        load(spec)
    assert str(caught.value).startswith((spec, spec.replace(":", "-")))
    assert "\n" not in str(caught.value)
