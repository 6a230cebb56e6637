"""Mixed meshes: what is done to raw arrays, and whether a mesh keeps its domain's boundary."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.domains.load import from_rings
from freemesh_ray.compare.mixed_mesh import PeerError, assembled

#: A unit square of two triangles beside one quadrilateral.
VERTICES = np.array([[0, 0], [1, 0], [2, 0], [2, 1], [1, 1], [0, 1]], dtype=float)
QUADS, TRIANGLES = [[0, 1, 4, 5]], [[1, 2, 3], [1, 3, 4]]


def area(vertices: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Signed areas, (m,)."""
    x, y = np.moveaxis(vertices[elements], -1, 0)
    return 0.5 * (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)


@given(st.lists(st.booleans(), min_size=3, max_size=3), st.integers(0, 5), st.integers(0, 1000))
def test_elements_are_turned_and_vertices_without_use_dropped(flips: list[bool], extra: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    new = rng.permutation(len(VERTICES) + extra)
    scattered = rng.uniform(5.0, 6.0, (len(new), 2))
    scattered[new[: len(VERTICES)]] = VERTICES
    quads, first, second = (
        new[np.array(element)][:: -1 if flip else 1] for element, flip in zip([*QUADS, *TRIANGLES], flips, strict=True)
    )
    mesh = assembled("x", scattered, [quads], [first, second], 0.5)
    assert len(mesh.vertices) == len(VERTICES)
    assert len(mesh) == 3
    assert {tuple(p) for p in mesh.vertices.tolist()} == {tuple(p) for p in VERTICES.tolist()}
    np.testing.assert_allclose(area(mesh.vertices, mesh.quads), [1.0])
    np.testing.assert_allclose(area(mesh.vertices, mesh.triangles), [0.5, 0.5])
    assert len(mesh.segments) == 6


def test_no_elements_are_a_failure() -> None:
    with pytest.raises(PeerError, match="made no elements"):
        assembled("x", VERTICES, [], [], 0.0)


def test_the_boundary_is_kept_or_not() -> None:
    domain = from_rings(VERTICES)
    mesh = assembled("x", VERTICES, QUADS, TRIANGLES, 0.0)
    assert mesh.keeps(domain)
    assert not replace(mesh, vertices=np.add(mesh.vertices, [0.0, 1e-3])).keeps(domain)
    assert not assembled("x", VERTICES, QUADS, [], 0.0).keeps(domain)
    assert not mesh.keeps(from_rings(VERTICES[[0, 2, 3, 5]]))


@given(st.booleans())
def test_an_inverted_element_among_others_stays_inverted(mirrored: bool) -> None:
    vertices = VERTICES.copy()
    vertices[2:4, 0] = 0.8  # folds the right half back over the left one
    quads = np.array([[0, 1, 4, 5], [1, 2, 3, 4]])
    mesh = assembled("x", vertices, quads[:, ::-1] if mirrored else quads, [], 0.0)
    np.testing.assert_allclose(area(mesh.vertices, mesh.quads), [1.0, -0.2])
