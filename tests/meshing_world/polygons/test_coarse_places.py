"""Outlines that are too coarse for what is near are told; those of the catalogue, and drawn ones, are not."""

from __future__ import annotations

import numpy as np
import pytest

from envs.domains.load import catalogue, from_rings, load
from envs.polygons.coarse_places import coarse_places, suggestion
from envs.types import Domain


def plate(width: float, count: int, radius: float = 1.0) -> Domain:
    """A square with a regular polygon as its hole."""
    turn = 2.0 * np.pi * np.arange(count) / count
    half = width / 2.0
    outer = [[-half, -half], [half, -half], [half, half], [-half, half]]
    return from_rings(outer, [radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)], "plate")


@pytest.mark.parametrize("name", [*catalogue(), *(f"random-{k}" for k in range(20)), *(f"part-{k}" for k in range(20))])
def test_what_is_well_discretised_has_none(name: str) -> None:
    assert coarse_places(load(name)) == []


@pytest.mark.parametrize(("width", "count"), [(10, 16), (3, 16), (2.2, 64), (2.2, 6), (4, 8), (1000, 32)])
def test_a_plate_of_four_corners_is_too_coarse_for_its_hole(width: float, count: int) -> None:
    found = coarse_places(plate(width, count))
    assert found
    assert found[0].length == width  # a side
    assert found[0].excess >= 1.0
    assert [place.excess for place in found] == sorted((place.excess for place in found), reverse=True)


@pytest.mark.parametrize(("width", "count"), [(10, 16), (2.2, 64), (2.2, 6)])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_the_suggestion_helps(width: float, count: int, scale: float) -> None:
    """Split by it the same outline has no such place, at whatever scale."""
    from envs.domains.load import from_object

    domain = plate(width * scale, count, scale)
    words = suggestion(coarse_places(domain), domain.area).split()
    options = {
        word.removeprefix("--").replace("-", "_"): float(value)
        for word, value in zip(words[::2], words[1::2], strict=True)
    }
    rings = [domain.points[:4], domain.points[4 : 4 + count]]
    (split,) = from_object(rings, **options)
    assert coarse_places(split) == []


def test_an_element_by_itself_has_none() -> None:
    assert coarse_places(from_rings([[0, 0], [100, 0], [100, 1], [0, 1]])) == []


def test_what_is_near_outside_does_not_count() -> None:
    """Two long sides that face each other across a slot outside, at the mouth of a C."""
    outline = [[0, 0], [4, 0], [4, 1.9], [2, 1.9], [2, 2.1], [4, 2.1], [4, 4], [0, 4]]
    assert not any(place.apart == pytest.approx(0.2) for place in coarse_places(from_rings(outline)))
