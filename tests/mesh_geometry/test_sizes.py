"""Sizes of elements against those wanted: shapely and plain loops as oracles, grids whose values are known."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from freemesh_ray.compare.mixed_mesh import MixedMesh, assembled
from freemesh_ray.mesh_geometry.wanted_sizes import elements_over_wanted, longest_edge, neighbour_ratio, sized_share


def grid(columns: int, rows: int, seed: int, moved: float = 0.3) -> MixedMesh:
    """Cells of 2 by 1, vertices moved at random, some cells in two triangles."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(2.0 * np.arange(columns + 1), np.arange(rows + 1.0))
    points = np.stack([x.ravel(), y.ravel()], axis=1) + rng.uniform(-moved, moved, (x.size, 2))
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    cells = np.stack([corner, corner + 1, corner + columns + 2, corner + columns + 1], axis=1)
    split = rng.random(len(cells)) < (0.3 if moved else 0.0)
    triangles = np.concatenate([cells[split][:, [0, 1, 2]], cells[split][:, [0, 2, 3]]])
    return assembled("grid", points, cells[~split], triangles, 0.0)


def rising(places: np.ndarray) -> np.ndarray:
    """Sizes that differ from place to place."""
    return 1.0 + 0.1 * places[:, 0] + 0.05 * places[:, 1]


def outlines(mesh: MixedMesh) -> list[list[int]]:
    return [*mesh.quads.tolist(), *mesh.triangles.tolist()]


@given(st.integers(1, 5), st.integers(1, 5), st.integers(0, 10_000))
def test_shapely_and_loops_say_the_same(columns: int, rows: int, seed: int) -> None:
    mesh = grid(columns, rows, seed)
    shapes = [shapely.Polygon(mesh.vertices[element]) for element in outlines(mesh)]
    centres = np.array([shape.centroid.coords[0] for shape in shapes])
    wanted = rising(centres)
    means = np.array([shape.length / (len(shape.exterior.coords) - 1) for shape in shapes])
    assert elements_over_wanted(mesh, rising) == pytest.approx(
        len(shapes) / sum(shape.area / h**2 for shape, h in zip(shapes, wanted, strict=True))
    )
    for near in (0.25, 0.1):
        assert sized_share(mesh, rising, near) == pytest.approx((abs(means / wanted - 1) <= near).mean())
    longest, owners = 0.0, defaultdict(list)
    for number, element in enumerate(outlines(mesh)):
        for a, b in zip(element, element[1:] + element[:1], strict=True):
            ends = mesh.vertices[[a, b]]
            longest = max(longest, float(np.linalg.norm(ends[1] - ends[0]) / rising(ends.mean(axis=0)[None])[0]))
            owners[frozenset((a, b))].append(number)
    assert longest_edge(mesh, rising) == pytest.approx(longest)
    ratios = [max(means[pair]) / min(means[pair]) for pair in owners.values() if len(pair) == 2]
    for percentile in (99.0, 50.0):
        assert neighbour_ratio(mesh, percentile) == pytest.approx(np.percentile(ratios, percentile) if ratios else 1.0)


@given(st.floats(0.1, 10.0))
def test_a_grid_of_rectangles_by_hand(h: float) -> None:
    mesh = grid(4, 3, 0, moved=0.0)

    def wanted(places: np.ndarray) -> np.ndarray:
        return np.full(len(places), h)

    assert longest_edge(mesh, wanted) == pytest.approx(2 / h)
    assert elements_over_wanted(mesh, wanted) == pytest.approx(h**2 / 2)
    assert sized_share(mesh, wanted) == (1.0 if abs(1.5 / h - 1) <= 0.25 else 0.0)
    assert neighbour_ratio(mesh) == pytest.approx(1.0)


def test_one_element_has_no_neighbour() -> None:
    mesh = assembled("one", [[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2, 3]], [], 0.0)
    assert neighbour_ratio(mesh) == 1.0


def test_a_collapsed_element_has_numbers() -> None:
    mesh = assembled("flat", [[0, 0], [1, 0], [2, 0], [3, 0], [3, 1], [0, 1]], [[0, 1, 2, 3], [0, 3, 4, 5]], [], 0.0)
    assert elements_over_wanted(mesh, rising) > 0
    assert 0 <= sized_share(mesh, rising) <= 1
    assert neighbour_ratio(mesh) == pytest.approx(8 / 6)
