"""What became of a boundary: grids of a rectangle whose sides are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.domains.load import from_rings
from envs.types import Domain
from freemesh_ray.compare.boundary_change import boundary_change
from freemesh_ray.compare.mixed_mesh import MixedMesh, assembled


def grid(columns: int, rows: int) -> MixedMesh:
    """Elements of the rectangle [0, 4] x [0, 2]."""
    x, y = np.meshgrid(np.linspace(0, 4, columns + 1), np.linspace(0, 2, rows + 1))
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    quads = np.stack([corner, corner + 1, corner + columns + 2, corner + columns + 1], axis=1)
    return assembled("grid", np.stack([x.ravel(), y.ravel()], axis=1), quads, [], 0.0)


def rectangle(columns: int, rows: int) -> Domain:
    """The same rectangle, its sides of so many segments."""
    x, y = np.linspace(0, 4, columns + 1), np.linspace(0, 2, rows + 1)
    ring = [
        *((a, 0) for a in x[:-1]),
        *((4, b) for b in y[:-1]),
        *((a, 2) for a in x[:0:-1]),
        *((0, b) for b in y[:0:-1]),
    ]
    return from_rings(ring)


@given(st.integers(1, 6), st.integers(1, 6), st.integers(1, 4))
def test_split_segments_are_counted(columns: int, rows: int, into: int) -> None:
    change = boundary_change(grid(into * columns, into * rows), rectangle(columns, rows))
    assert (change.added, change.lost, change.off) == ((into - 1) * 2 * (columns + rows), 0, 0)
    assert change.kept == (into == 1)
    assert change.split == (into > 1)
    assert str(change) == ("kept" if into == 1 else f"+{change.added} points")


def test_points_that_are_gone_are_counted() -> None:
    change = boundary_change(grid(2, 1), rectangle(4, 2))
    assert (change.added, change.lost, change.off) == (0, 6, 0)
    assert str(change) == "CHANGED +0 -6"


@pytest.mark.parametrize(("shift", "word"), [(1e-9, "kept"), (1e-3, "CHANGED +6 -6")])
def test_points_that_moved_are_told_beyond_the_tolerance(shift: float, word: str) -> None:
    mesh = grid(2, 1)
    moved = assembled("x", mesh.vertices * (1 + shift) + shift, mesh.quads, [], 0.0)
    assert str(boundary_change(moved, rectangle(2, 1))) == word


def test_points_off_the_boundary_are_no_split() -> None:
    mesh, domain = grid(4, 2), rectangle(2, 1)
    assert boundary_change(mesh, domain).split
    vertices = mesh.vertices.copy()
    vertices[(vertices == [1, 0]).all(axis=1)] = [1, 0.1]
    change = boundary_change(assembled("x", vertices, mesh.quads, [], 0.0), domain)
    assert (change.added, change.lost, change.off) == (6, 0, 1)
    assert not change.split
