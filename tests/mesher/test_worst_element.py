"""The worst element of a mesh is told with its place, the cause and the fix."""

from __future__ import annotations

import numpy as np

from envs.mesh import Mesh
from freemesh_ray.mesher.worst_element import worst_note

#: A strip of quads and the boundary around it.
STRIP = np.array([[0, 1, 4, 3], [1, 2, 5, 4]])
AROUND = np.array([[0, 1], [1, 2], [2, 5], [5, 4], [4, 3], [3, 0]])


def strip(vertices: list[list[float]]) -> Mesh:
    return Mesh("strip", np.array(vertices, dtype=float), STRIP, AROUND, complete=True)


def test_good_elements_are_not_told() -> None:
    assert worst_note(strip([[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]])) == ""


def test_a_narrow_place() -> None:
    line = worst_note(strip([[0, 0], [1, 0], [2, 0], [0, 1e-3], [1, 1e-3], [2, 1e-3]]))
    assert "at (0.5, 0.0005)" in line
    assert "0.001 wide" in line
    assert "--edge-length 0.0005" in line


def test_a_sharp_corner() -> None:
    line = worst_note(strip([[0, 0], [1, 0], [2, 0], [0.5, 0.005], [1, 0.0099], [2, 1]]))
    assert "a corner of the outline has 0.57 degrees there" in line


def test_segments_that_are_too_coarse() -> None:
    vertices = np.array([[x, y] for y in (0.0, 1.0, 2.0) for x in (0.0, 1.0, 2.0)])
    vertices[4] = [1.0, 5e-4]
    quads = np.array([[a, a + 1, a + 4, a + 3] for a in (0, 1, 3, 4)])
    around = np.array([0, 1, 2, 5, 8, 7, 6, 3])
    mesh = Mesh("grid", vertices, quads, np.stack([around, np.roll(around, -1)], axis=1), complete=True)
    assert "segments of up to 1 are near; give a finer --edge-length there, 0.5 at most" in worst_note(mesh)
