"""Polygons of Python programs: every way to hold one gives the same domain."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.domains.load import from_object, from_rings, load
from envs.domains.random_domain import random_domain
from envs.types import DomainError

SQUARE = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]
HOLE = [[1.0, 1.0], [1.0, 2.0], [2.0, 2.0], [2.0, 1.0]]
POLYGON = shapely.Polygon(SQUARE, [HOLE])
ONE = {
    "list of rings": [SQUARE, HOLE],
    "tuple of arrays": (np.array(SQUARE), np.array(HOLE)),
    "array of rings": np.array([SQUARE, HOLE]),
    "polygons": [[SQUARE, HOLE]],
    "shapely": POLYGON,
    "one part": shapely.MultiPolygon([POLYGON]),
    "list of shapely": [POLYGON],
    "mapping": shapely.geometry.mapping(POLYGON),
    "feature": {"type": "Feature", "geometry": shapely.geometry.mapping(POLYGON)},
    "geo interface": SimpleNamespace(__geo_interface__=shapely.geometry.mapping(POLYGON)),
    "rings": {"rings": [SQUARE, HOLE]},
}


@pytest.mark.parametrize("shape", ONE.values(), ids=ONE.keys())
def test_every_shape_gives_the_same_domain(shape: Any) -> None:
    (domain,) = from_object(shape, "plate")
    assert domain.name == "plate"
    np.testing.assert_array_equal(domain.points[:8], [*SQUARE, *HOLE])
    assert domain.area == 15.0


@pytest.mark.parametrize("shape", [SQUARE, np.array(SQUARE), np.array(SQUARE, dtype=int), shapely.LinearRing(SQUARE)])
def test_a_ring_alone(shape: Any) -> None:
    assert from_object(shape)[0].area == 16.0


@pytest.mark.parametrize("shape", [
    shapely.MultiPolygon([shapely.box(0, 0, 1, 1), shapely.box(2, 0, 3, 1)]),
    [shapely.box(0, 0, 1, 1), shapely.box(2, 0, 3, 1)],
    [[SQUARE, HOLE], [np.array(SQUARE) + 9.0]],
])  # fmt: skip
def test_several(shape: Any) -> None:
    assert [domain.name for domain in from_object(shape, "part")] == ["part[0]", "part[1]"]


@pytest.mark.parametrize("shape", [
    None, 3, "POLYGON", [], [[]], np.float64(1.0), [1.0, 2.0], shapely.Point(0, 0), shapely.Polygon(), {}, {"a": 1},
    {"rings": []}, {"rings": 3}, {"type": "Polygon"}, {"type": "MultiPolygon", "coordinates": []}, [[[[[0.0]]]]],
    np.zeros((0, 2)), np.zeros((3, 3)), [shapely.Point(0, 0)], [SQUARE, None], [None], [["a", "b"]] * 4, b"bytes",
    [[SQUARE], 3], np.array(None), np.full((4, 2), np.nan), {"type": "Polygon", "coordinates": "x"},
])  # fmt: skip
def test_what_holds_no_polygon(shape: Any) -> None:
    for edge_length in (None, 1.0):
        with pytest.raises(DomainError, match=r"^plate: ") as caught:
            from_object(shape, "plate", edge_length=edge_length)
        assert "\n" not in str(caught.value)


@pytest.mark.slow
@settings(max_examples=40)
@given(
    seed=st.integers(0, 1000), holes=st.integers(0, 2), scale=st.sampled_from([1e-6, 1.0, 1e6]),
    offset=st.sampled_from([0.0, 1e6]),
)  # fmt: skip
def test_coordinates_are_kept_at_every_scale(seed: int, holes: int, scale: float, offset: float) -> None:
    drawn = random_domain(seed, holes=holes, vertices=40)
    points = scale * (drawn.points / drawn.diameter + offset)
    starts = [0, *(np.flatnonzero(drawn.segments[:, 1] != drawn.segments[:, 0] + 1) + 1)]
    rings = [points[a:b] for a, b in zip(starts[:-1], starts[1:], strict=True)]
    (domain,) = from_object(rings)
    np.testing.assert_array_equal(domain.points[:40], points[:40])
    np.testing.assert_array_equal(domain.points, from_rings(rings[0], rings[1:]).points)
    (finer,) = from_object(rings, edge_length=0.01 * scale)
    assert {tuple(p) for p in points[:40].tolist()} <= {tuple(p) for p in finer.points.tolist()}
    assert finer.area == pytest.approx(drawn.area * (scale / drawn.diameter) ** 2, rel=1e-6)


@pytest.mark.parametrize("spec", ["T1", "D9", "random:3?holes=2"])
def test_names_load_as_before(spec: str) -> None:
    domain = load(spec)
    segments = domain.segments
    starts = [0, *(np.flatnonzero(segments[:, 1] != segments[:, 0] + 1) + 1)]
    rings = [domain.points[a:b] for a, b in zip(starts[:-1], starts[1:], strict=True)]
    np.testing.assert_array_equal(from_rings(rings[0], rings[1:]).points, domain.points)
