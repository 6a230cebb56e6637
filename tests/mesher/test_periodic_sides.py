"""Sides said to be periodic have the same points, from a polygon to its mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import freemesh_ray
from envs.polygons.drawing import Drawing, Line
from envs.types import DomainError
from freemesh_ray.cli.command import main

#: From the west side of the cell to the east side.
EAST = np.array([1.0, 0.0])


def cell(wave: float, x: float) -> Drawing:
    """A cell of unit size whose west and east sides are one wavy line, with a hole nearer to one of them."""
    y = np.linspace(0.0, 1.0, 41)
    line = np.stack([wave * np.sin(2.0 * np.pi * y), y], axis=1)
    line[0], line[-1] = (0.0, 0.0), (0.0, 1.0)
    turn = -2.0 * np.pi * np.arange(24) / 24
    hole = np.array([x, 0.45]) + 0.15 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    sides = [Line(line, "west"), Line(line + EAST, "east"), Line(line[[0, 0]] + [[0, 0], [1, 0]], "south")]
    return Drawing([[np.concatenate([line[::-1], line + EAST]), hole]], lines=sides)


@settings(max_examples=15)
@given(st.floats(0.05, 0.15), st.floats(0.04, 0.15), st.floats(1.0, 4.0), st.floats(0.35, 0.6))
def test_points_of_periodic_sides_are_images(edge: float, wave: float, grading: float, x: float) -> None:
    made = freemesh_ray.mesh(cell(wave, x), edge_length=edge, grading=grading, periodic=[("west", "east")])
    pairs = made.periodic["west", "east"]
    assert len(pairs) == len(made.groups.sides["west"]) + 1 == len(made.groups.sides["east"]) + 1
    np.testing.assert_allclose(made.vertices[pairs[:, 0]] + EAST, made.vertices[pairs[:, 1]], atol=1e-9)
    assert made.defects(float(made.areas.sum())) == []


BOX = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)])


def test_both_pairs_of_a_graded_cell() -> None:
    """A small hole near one corner refines the sides beside it, and so the sides far from it."""
    hole = np.array([0.25, 0.2]) + 0.1 * np.stack([np.cos(t := -2 * np.pi * np.arange(24) / 24), np.sin(t)], axis=1)
    asked = [("left", "right"), ("bottom", "top")]
    made = freemesh_ray.mesh([BOX, hole], edge_length=0.2, grading=6.0, periodic=asked)
    plain = freemesh_ray.mesh([BOX, hole], edge_length=0.2, grading=6.0)
    counts = {name: len(rows) for name, rows in plain.groups.sides.items()}
    assert counts["left"] != counts["right"]
    for (first, second), shift in zip(asked, ([2.0, 0.0], [0.0, 1.0]), strict=True):
        pairs = made.periodic[first, second]
        assert len(pairs) == len(made.groups.sides[first]) + 1 == len(made.groups.sides[second]) + 1
        moved = made.vertices[pairs[:, 0]] + shift
        np.testing.assert_allclose(moved, made.vertices[pairs[:, 1]], atol=1e-9)


def test_what_is_not_periodic_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(DomainError, match="sides 'left' and 'bottom' are not periodic"):
        freemesh_ray.mesh(BOX, edge_length=0.2, periodic=[("left", "bottom")])
    told = r"no side is called rigth; the sides are left, right, bottom, top; .*--list-names"
    with pytest.raises(DomainError, match=told):
        freemesh_ray.mesh(BOX, edge_length=0.2, periodic=[("left", "rigth")])
    part = tmp_path / "part.wkt"
    part.write_text(shapely.Polygon(BOX).wkt)
    command = ["mesh", str(part), "--edge-length", "0.2", "-o", str(tmp_path / "part.msh")]
    assert main([*command, "--periodic", "left", "right"]) == 0
    assert main([*command, "--periodic", "left", "nowhere"]) == 2
    assert "no side is called nowhere" in capsys.readouterr().err
