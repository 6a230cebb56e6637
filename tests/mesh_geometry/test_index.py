"""The index: what is known by hand, what every mesh obeys, and where a ring begins or a boundary meets itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.mesh import Mesh
from envs.types import Floats, Ints
from freemesh_ray.mesh_geometry.index import boundary_of, ideal_elements, index, inner_quarters, least_irregular
from freemesh_ray.mesh_geometry.metrics import measure

SQUARE = np.array([[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]], dtype=float)
L_SHAPE = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], dtype=float)


def disc(n: int, radius: float = 1.0) -> Floats:
    turn = 2.0 * np.pi * np.arange(n) / n
    return radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def boundary(*rings: Floats) -> tuple[Floats, Ints]:
    """Vertices and segments of closed rings."""
    segments, first = [], 0
    for ring in rings:
        i = np.arange(len(ring))
        segments.append(first + np.stack([i, (i + 1) % len(ring)], axis=1))
        first += len(ring)
    return np.concatenate(rings), np.concatenate(segments)


@pytest.mark.parametrize(
    ("rings", "expected"),
    [
        ([SQUARE], 0),
        ([L_SHAPE], 0),
        ([disc(3)], 1),
        ([disc(5)], -1),
        ([disc(40)], 4),
        ([disc(1000)], 4),
        ([disc(40), disc(20, 0.4)[::-1]], 0),
        ([4.0 * SQUARE, (SQUARE + 1.0)[::-1]], 0),
        ([4.0 * SQUARE, (disc(12) + 3.0)[::-1]], -4),
        ([20.0 * SQUARE, (disc(12) + 5.0)[::-1], (disc(12) + 15.0)[::-1]], -8),
    ],
    ids=["square", "L", "triangle", "pentagon", "disc", "fine disc", "annulus", "frame", "hole", "two holes"],
)
def test_known_boundaries(rings: list[Floats], expected: int) -> None:
    vertices, segments = boundary(*rings)
    assert index(vertices, segments) == expected
    assert least_irregular(vertices, segments) == abs(expected)


@given(
    turn=st.floats(-7, 7), scale=st.floats(1e-3, 1e3), begin=st.integers(0, 7),
    shift=st.tuples(st.floats(-100, 100), st.floats(-100, 100)),
)  # fmt: skip
def test_place_size_direction_and_beginning_do_not_matter(
    turn: float, scale: float, begin: int, shift: tuple[float, float]
) -> None:
    matrix = scale * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    for ring, expected in ((SQUARE, 0), (L_SHAPE, 0), (disc(24), 4)):
        assert index(*boundary(np.roll(ring, begin, axis=0) @ matrix.T + scale * np.array(shift))) == expected


def test_a_boundary_that_meets_itself_is_cut_open_there() -> None:
    """Two unit squares that share a corner, and a frame whose hole touches its outside."""
    vertices = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [2, 1], [2, 2], [1, 2]], dtype=float)
    segments = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [2, 4], [4, 5], [5, 6], [6, 2]])
    np.testing.assert_allclose(inner_quarters(vertices, segments), 1.0)
    assert index(vertices, segments) == 0
    # The hole is a square that stands on a corner, which lies on the lower side of the frame.
    frame = np.array([[0, 0], [4, 0], [8, 0], [8, 8], [0, 8], [6, 2], [4, 4], [2, 2]], dtype=float)
    rings = np.array([[0, 1], [1, 2], [2, 3], [3, 4], [4, 0], [1, 7], [7, 6], [6, 5], [5, 1]])
    quarters = inner_quarters(frame, rings)
    assert quarters[rings[:, 1] == 1] == pytest.approx([0.5, 0.5])
    assert index(frame, rings) == round(float((ideal_elements(quarters) - quarters).sum()))


@settings(max_examples=40, deadline=None)
@given(
    cells=st.lists(st.lists(st.booleans(), min_size=4, max_size=4), min_size=2, max_size=5),
    splits=st.lists(st.integers(0, 10**6), max_size=4),
)
def test_every_mesh_obeys_the_theorem(cells: list[list[bool]], splits: list[int]) -> None:
    """Unit squares, some of them divided into five: irregular nodes inside and elements at the boundary balance."""
    filled = np.array(cells)
    if not filled.any():
        return
    rows, columns = filled.shape
    x, y = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0))
    vertices = np.stack([x.ravel(), y.ravel()], axis=1)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns))[filled]
    quads = np.stack([corner, corner + 1, corner + columns + 2, corner + columns + 1], axis=1)
    for chosen in splits:
        vertices, quads = divided(vertices, quads, chosen % len(quads))
    mesh = Mesh("cells", vertices, quads, np.empty((0, 2), dtype=np.int64), True)
    segments = boundary_of(mesh)
    passes = np.bincount(segments[:, 1], minlength=len(vertices))
    elements = np.bincount(quads.ravel(), minlength=len(vertices))
    valence = np.bincount(mesh.edges[0].ravel(), minlength=len(vertices))
    inside = (passes == 0) & (elements > 0)
    wanted = np.bincount(segments[:, 1], ideal_elements(inner_quarters(vertices, segments)), len(vertices))
    surplus = int((elements - wanted)[passes > 0].sum())
    assert (4 - valence[inside]).sum() == index(vertices, segments) + surplus


def divided(vertices: Floats, quads: Ints, chosen: int) -> tuple[Floats, Ints]:
    """One element replaced by five: a smaller one inside it, and one beside each of its sides."""
    a, b, c, d = quads[chosen]
    corners = vertices[quads[chosen]]
    n = len(vertices)
    inner = corners.mean(axis=0) + 0.4 * (corners - corners.mean(axis=0))
    five = [
        [n, n + 1, n + 2, n + 3], [a, b, n + 1, n], [b, c, n + 2, n + 1], [c, d, n + 3, n + 2], [d, a, n, n + 3],
    ]  # fmt: skip
    return np.concatenate([vertices, inner]), np.concatenate([np.delete(quads, chosen, axis=0), five])


def test_quality_tells_it_of_complete_meshes_alone() -> None:
    quads = np.array([[0, 1, 8, 7], [1, 2, 3, 8], [8, 3, 4, 5], [7, 8, 5, 6]])
    segments = np.stack([np.arange(8), (np.arange(8) + 1) % 8], axis=1)
    vertices = np.concatenate([SQUARE, [[1.0, 1.0]]])
    assert measure(Mesh("square", vertices, quads, segments, True))["singularity_least"] == 0.0
    assert np.isnan(measure(Mesh("square", vertices, quads[:2], segments, False))["singularity_least"])
