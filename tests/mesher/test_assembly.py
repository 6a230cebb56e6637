"""Regions that share boundary come out as one conforming mesh, with every name where it belongs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from checkout import ROOT

import freemesh_ray
from envs.polygons.drawing import Drawing, Line, Place
from envs.types import DomainError

LEFT = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
RIGHT = [[1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0]]


def test_two_materials_are_one_mesh() -> None:
    clamp = Line(np.array([[0.0, 0.0], [0.0, 1.0]]), "clamped")
    mesh = freemesh_ray.mesh(Drawing([[LEFT], [RIGHT]], ["steel", "copper"], [clamp]), edge_length=0.2)
    assert mesh.defects(area=2.0) == []
    assert mesh.complete
    steel, copper = mesh.groups.regions["steel"], mesh.groups.regions["copper"]
    assert sorted([*steel, *copper]) == list(range(len(mesh.quads)))
    assert (mesh.vertices[mesh.quads[steel]].mean(axis=1)[:, 0] < 1.0).all()
    assert (mesh.vertices[mesh.quads[copper]].mean(axis=1)[:, 0] > 1.0).all()
    interface = mesh.groups.lines["steel_copper"]
    assert (mesh.vertices[interface, 0] == 1.0).all()
    assert np.linalg.norm(np.diff(mesh.vertices[interface], axis=1), axis=-1).sum() == pytest.approx(1.0)
    assert (mesh.vertices[mesh.groups.sides["clamped"], 0] == 0.0).all()
    assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices)


def test_a_named_interface_keeps_its_name_and_an_inclusion_its_region() -> None:
    disc = np.asarray(shapely.Point(0, 0).buffer(0.5, quad_segs=8).exterior.coords)[:-1]
    plate = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
    rim = Line(np.concatenate([disc, disc[:1]]), "bond")
    mesh = freemesh_ray.mesh(Drawing([[plate, disc], [disc]], ["matrix", "fibre"], [rim]), edge_length=0.25)
    assert mesh.defects() == []
    assert list(mesh.groups.lines) == ["bond"]
    assert set(mesh.groups.regions) == {"matrix", "fibre"}
    assert len(mesh.segments) == sum(len(rows) for rows in mesh.groups.sides.values()) or not mesh.groups.sides
    radii = np.linalg.norm(mesh.vertices[mesh.groups.lines["bond"]], axis=-1)
    np.testing.assert_allclose(radii, 0.5, rtol=0.02)


def test_parts_that_do_not_touch_are_one_mesh_too() -> None:
    apart = (np.array(RIGHT) + np.array([1.0, 0.0])).tolist()
    mesh = freemesh_ray.mesh([[LEFT], [apart]], edge_length=0.25)
    assert mesh.complete
    assert mesh.defects(area=2.0) == []
    assert set(mesh.groups.regions) == {"region_1", "region_2"}
    assert mesh.groups.lines == {}


def test_names_by_python_go_before_those_that_are_offered() -> None:
    mesh = freemesh_ray.mesh(
        LEFT, edge_length=0.25, names={"inlet": lambda at: (at[:, 0] == 0.0) & (at[:, 1] <= 0.5)}, regions=["water"]
    )  # fmt: skip
    assert list(mesh.groups.regions) == ["water"]
    inlet = mesh.vertices[mesh.groups.sides["inlet"]]
    assert len(inlet) == 2
    assert (inlet[..., 1] <= 0.5).all()
    assert len(mesh.groups.sides["left"]) == 2
    assert {len(mesh.groups.sides[name]) for name in ("right", "bottom", "top")} == {4}


def test_as_many_names_as_regions() -> None:
    with pytest.raises(DomainError, match="box: 2 names for 1 regions; give one for each polygon"):
        freemesh_ray.mesh(LEFT, edge_length=0.25, name="box", regions=["a", "b"])


def test_lines_cracks_and_points_of_a_drawing_are_in_the_mesh() -> None:
    weld = Line(np.array([[0.0, 0.5], [0.5, 0.5]]), "weld")
    crack = Line(np.array([[0.7, 0.2], [0.9, 0.4]]), "notch", crack=True)
    mesh = freemesh_ray.mesh(Drawing([[LEFT]], lines=[weld, crack], places=[Place(0.3, 0.2, "gauge")]), edge_length=0.1)
    assert mesh.defects(area=1.0) == []
    ends = mesh.vertices[mesh.groups.lines["weld"]]
    assert (ends[..., 1] == 0.5).all()
    assert np.abs(ends[:, 1, 0] - ends[:, 0, 0]).sum() == pytest.approx(0.5)
    left, right = (mesh.groups.sides[f"notch_{side}"] for side in ("left", "right"))
    assert len(left) == len(right)
    shared = np.intersect1d(left, right)
    np.testing.assert_allclose(np.sort(mesh.vertices[shared, 0]), [0.7, 0.9])  # the tips alone
    apart = [np.unique(mesh.vertices[np.setdiff1d(side, shared)], axis=0) for side in (left, right)]
    np.testing.assert_array_equal(*apart)
    np.testing.assert_array_equal(mesh.vertices[mesh.groups.points["gauge"]], [0.3, 0.2])
    assert {"left", "right", "bottom", "top"} <= set(mesh.groups.sides)


def test_a_line_from_side_to_side_divides() -> None:
    cut = Line(np.array([[0.5, -0.0], [0.5, 1.0]]), "glue")
    mesh = freemesh_ray.mesh(Drawing([[LEFT]], lines=[cut]), edge_length=0.125)
    assert mesh.defects(area=1.0) == []
    assert set(mesh.groups.regions) == {"region_1", "region_2"}
    glue = mesh.vertices[mesh.groups.lines["glue"]]
    assert (glue[..., 0] == 0.5).all()
    assert np.abs(glue[:, 1, 1] - glue[:, 0, 1]).sum() == pytest.approx(1.0)


def test_half_of_a_symmetric_plate_is_mirrored() -> None:
    plate = [[-2.0, -1.0], [2.0, -1.0], [2.0, 1.0], [-2.0, 1.0]]
    hole = np.asarray(shapely.Point(0, 0).buffer(0.4, quad_segs=8).exterior.coords)[:-1]
    mesh = freemesh_ray.mesh([plate, hole], edge_length=0.2, mirror="y")
    assert mesh.complete
    assert mesh.defects() == []
    there = set(map(tuple, np.round(mesh.vertices, 12).tolist()))
    assert {(0.0 - x, y) for x, y in there} == there


@pytest.mark.slow
def test_curved_sides_of_a_drawing_have_their_nodes_on_the_curve(tmp_path: Path) -> None:
    import meshio

    mesh = freemesh_ray.mesh(ROOT / "docs/examples/plate.dxf", edge_length=0.5)
    assert len(mesh.curved.edges)
    mesh.write(tmp_path / "plate.msh", order=3)
    cells = {block.type for block in meshio.read(tmp_path / "plate.msh").cells}
    assert {"quad16", "line4"} <= cells


def test_a_mesh_is_swept_and_written(tmp_path: Path) -> None:
    mesh = freemesh_ray.mesh(LEFT, edge_length=0.25)
    solid = mesh.extruded(0.5, 2)
    assert len(solid.hexes) == 2 * len(mesh.quads)
    assert set(solid.groups.faces) >= {"left", "right", "bottom", "top"}
