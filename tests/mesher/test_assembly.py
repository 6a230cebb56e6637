"""Regions that share boundary come out as one conforming mesh, with every name where it belongs."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import freemesh_ray
from envs.drawing import Drawing, Line
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
