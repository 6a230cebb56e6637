"""Exodus II files: made with SciPy as the format is documented, and broken ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from exodus_sample import write_exodus
from hypothesis import given
from hypothesis import strategies as st

from freemesh_ray.compare.exodus_file import read_exodus

POINTS = np.array([[0, 0], [1, 0], [2, 0], [2, 1], [1, 1], [0, 1]], dtype=float)
QUADS, TRIANGLES = np.array([[0, 1, 4, 5]]), np.array([[1, 2, 3], [1, 3, 4]])


@pytest.mark.parametrize("old", [False, True], ids=["coordx", "coord"])
@pytest.mark.parametrize("version", [1, 2], ids=["classic", "64-bit offset"])
def test_elements_of_all_blocks_are_read(old: bool, version: int, tmp_path: Path) -> None:
    write_exodus(tmp_path / "a.g", POINTS, [("QUAD", QUADS), ("TRI3", TRIANGLES)], old=old, version=version)
    points, quads, triangles = read_exodus(tmp_path / "a.g")
    np.testing.assert_array_equal(points, POINTS)
    np.testing.assert_array_equal(quads, QUADS)
    np.testing.assert_array_equal(triangles, TRIANGLES)


def test_bars_and_middles_of_edges_are_left_out(tmp_path: Path) -> None:
    eight = np.array([[0, 2, 3, 5, 1, 4, 4, 1]])
    write_exodus(tmp_path / "a.g", POINTS, [("BAR2", np.array([[0, 1]])), ("SHELL8", eight), ("HEX", eight)])
    _, quads, triangles = read_exodus(tmp_path / "a.g")
    assert quads.tolist() == [[0, 2, 3, 5]]
    assert len(triangles) == 0


@pytest.mark.parametrize(("content", "words"), [
    (b"", "no netCDF file"), (b"solid", "no netCDF file"), (b"\x89HDF\r\n\x1a\n", "netCDF-4"), (b"CDF\x01", "broken"),
])  # fmt: skip
def test_what_is_no_such_file_is_told(content: bytes, words: str, tmp_path: Path) -> None:
    (tmp_path / "a.g").write_bytes(content)
    with pytest.raises(ValueError, match=words):
        read_exodus(tmp_path / "a.g")


def test_nodes_that_are_not_there_are_told(tmp_path: Path) -> None:
    write_exodus(tmp_path / "a.g", POINTS[:5], [("QUAD", QUADS)])
    with pytest.raises(ValueError, match="a node that is not there"):
        read_exodus(tmp_path / "a.g")


@given(st.integers(0, 900), st.binary(min_size=1, max_size=8))
def test_broken_bytes_are_an_error_or_a_mesh(tmp_path_factory: pytest.TempPathFactory, at: int, other: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "broken.g"
    write_exodus(path, POINTS, [("QUAD", QUADS), ("TRI", TRIANGLES)])
    content = path.read_bytes()
    path.write_bytes(content[:at] + other + content[at + len(other) :])
    try:
        points, quads, triangles = read_exodus(path)
    except ValueError:
        return
    assert points.shape[1] == 2
    assert quads.shape[1:] == (4,)
    assert triangles.shape[1:] == (3,)
