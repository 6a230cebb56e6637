"""Boundary layers along named sides, from a polygon to a file: rows where they were asked for, names that stay."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import freemesh_ray
from envs.polygons.drawing import Drawing, Line
from envs.types import DomainError
from freemesh_ray import BoundaryLayers
from freemesh_ray.cli.command import main

BOX = np.array([(0.0, 0.0), (3.0, 0.0), (3.0, 1.0), (0.0, 1.0)])
HOLE = np.array([0.8, 0.5]) + 0.15 * np.stack([np.cos(t := -2 * np.pi * np.arange(32) / 32), np.sin(t)], axis=1)


def lengths(mesh: freemesh_ray.Mesh, segments: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(mesh.vertices[segments], axis=1), axis=-1).sum())


@settings(max_examples=15)
@given(
    st.integers(1, 6), st.floats(0.002, 0.01), st.floats(1.0, 1.5),
    st.lists(st.sampled_from(["left", "right", "bottom", "top", "hole_1"]), min_size=1, unique=True),
)  # fmt: skip
def test_rows_lie_along_the_sides_named_and_all_names_stay(
    count: int, first: float, growth: float, along: list[str]
) -> None:
    plain = freemesh_ray.mesh([BOX, HOLE], edge_length=0.1)
    made = freemesh_ray.mesh(
        [BOX, HOLE], edge_length=0.1, boundary_layers=BoundaryLayers(tuple(along), count, first, growth)
    )
    assert made.defects(float(plain.areas.sum())) == []
    assert made.layered is not None
    assert set(made.groups.sides) == set(plain.groups.sides) == {"left", "right", "bottom", "top", "hole_1"}
    for name, segments in made.groups.sides.items():
        assert lengths(made, segments) == pytest.approx(lengths(plain, plain.groups.sides[name]), rel=1e-9)
    quads = made.quads[made.layered]
    edges = {tuple(sorted(edge)) for quad in quads.tolist() for edge in zip(quad, quad[1:] + quad[:1], strict=True)}
    thickness = first * growth ** np.arange(count)
    for name in along:
        assert all(tuple(sorted(segment)) in edges for segment in made.groups.sides[name].tolist())
    middle = shapely.LineString([(1.52, -1.0), (1.52, 0.5)]) if "bottom" in along else None
    if middle is not None:  # far from corners the rows are as high as asked for
        heights = [shapely.Polygon(made.vertices[quad]).intersection(middle).length for quad in quads.tolist()]
        np.testing.assert_allclose(np.sort([h for h in heights if h > 0.0]), thickness, rtol=1e-6)


def test_figures_of_the_others_alone_are_better() -> None:
    made = freemesh_ray.mesh(BOX, edge_length=0.1, boundary_layers=BoundaryLayers(("bottom",), 4, 0.002))
    assert made.layered is not None
    assert made.quality(boundary_layers=False)["eta_min"] > made.quality()["eta_min"]
    assert made.quality()["elements"] == len(made.quads)


def test_a_curve_stays_a_curve_behind_the_rows(tmp_path: Path) -> None:
    made = freemesh_ray.mesh([BOX, HOLE], edge_length=0.1, boundary_layers=BoundaryLayers(("hole_1",), 3, 0.01))
    made.write(tmp_path / "part.msh")
    read = meshio.read(tmp_path / "part.msh")
    assert "hole_1" in read.field_data


def test_interfaces_keep_their_points() -> None:
    two = Drawing(
        [[BOX], [BOX + np.array([0.0, 1.0])]],
        lines=[Line(BOX[:2], "wall"), Line(BOX[2:], "between"), Line(BOX[1:3], "outlet")],
        regions=["below", "above"],
    )
    made = freemesh_ray.mesh(two, edge_length=0.1, boundary_layers=BoundaryLayers(("wall", "between"), 3, 0.01))
    assert made.defects(6.0) == []
    assert set(made.groups.regions) == {"below", "above"}
    with pytest.raises(DomainError, match="layers end along the side between two regions near"):
        freemesh_ray.mesh(two, edge_length=0.1, boundary_layers=BoundaryLayers(("outlet",), 3, 0.01))


@pytest.mark.parametrize(
    ("wanted", "told"),
    [
        (
            BoundaryLayers(("botom",), 3, 0.01),
            "no side is called botom; the sides are left, right, bottom, top; .*--list-names",
        ),
        (BoundaryLayers(("bottom",), 0, 0.01), "0 layers; give --boundary-layers a whole number from 1 to 200"),
        (BoundaryLayers(("bottom",), 3, -1.0), "first layer -1 high"),
        (BoundaryLayers(("bottom",), 3, 0.01, 9.0), "growth 9 of layers"),
        (BoundaryLayers((), 3, 0.01), "along no side"),
    ],
)
def test_what_cannot_be_built_is_one_line(wanted: BoundaryLayers, told: str) -> None:
    with pytest.raises(DomainError, match=told):
        freemesh_ray.mesh(BOX, edge_length=0.1, boundary_layers=wanted)


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    part = tmp_path / "part.wkt"
    part.write_text(shapely.Polygon(BOX, [HOLE]).wkt)
    command = ["mesh", str(part), "--edge-length", "0.1", "-o", str(tmp_path / "part.msh"), "--boundary-layers", "4"]
    assert main(command) == 2
    assert "boundary layers need --along and --first, too" in capsys.readouterr().err
    assert main([*command, "--first", "0.004", "--along", "bottom", "--along", "hole_1"]) == 0
    assert "in boundary layers, the others eta" in capsys.readouterr().out
    assert main([*command, "--first", "0.2", "--along", "bottom", "--along", "top"]) == 0
    assert "less high than asked for" in capsys.readouterr().err
