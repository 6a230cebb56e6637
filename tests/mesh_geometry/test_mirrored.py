"""Mirrored meshes: valid, conforming at the axis, with the names of both halves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from quad_grids import grid, random_groups, whole

from envs.errors import UserError
from envs.mesh import CurvedEdges, Groups
from envs.polygons.axis import axis_of
from envs.types import Floats
from freemesh_ray.mesh_geometry.mirrored import mirrored


class Circle:
    """Of radius 1 around (2, 1)."""

    def nearest(self, points: Floats) -> Floats:
        return np.arctan2(points[:, 1] - 1.0, points[:, 0] - 2.0)

    def at(self, parameters: Floats) -> Floats:
        return np.array([2.0, 1.0]) + np.stack([np.cos(parameters), np.sin(parameters)], axis=1)


@settings(max_examples=60)
@given(seed=st.integers(0, 10_000), turn=st.floats(0.0, 7.0), named=st.sampled_from(["x", "y", ""]), left=st.booleans())
def test_a_mesh_and_its_image_are_one(seed: int, turn: float, named: str, left: bool) -> None:
    rng = np.random.default_rng(seed)
    flat = grid(int(rng.integers(1, 6)), int(rng.integers(1, 6)))
    bent = flat.vertices + rng.uniform(-0.03, 0.03, flat.vertices.shape) * (flat.vertices != 0.0)
    axis = axis_of(named or [[2.0, 3.0], [2.0 + np.cos(turn), 3.0 + np.sin(turn)]], "test")
    sign = 1.0 if left else -1.0
    vertices = axis.start + bent @ np.array([axis.along, sign * axis.left])
    quads = flat.quads if left else flat.quads[:, ::-1]
    half = whole(vertices, quads)
    half = replace(half, groups=random_groups(half, rng))
    both = mirrored(half, axis)
    on = flat.vertices[:, 1] == 0.0
    assert both.defects(2.0 * half.areas.sum()) == []
    assert len(both.vertices) == 2 * len(vertices) - on.sum()
    assert len(both.quads) == 2 * len(quads)
    np.testing.assert_array_equal(both.vertices[: len(vertices)], vertices)
    np.testing.assert_allclose(both.areas[len(quads) :], half.areas)
    # The image of each corner.
    image = axis.mirrored(vertices[quads].reshape(-1, 2)).reshape(-1, 4, 2)[:, [0, 3, 2, 1]]
    np.testing.assert_allclose(both.vertices[both.quads[len(quads) :]], image, atol=1e-9)
    on_axis = on[half.segments].all(axis=1)
    assert len(both.segments) == 2 * (~on_axis).sum()
    boundary = {tuple(segment) for segment in both.segments.tolist()}
    lengths = np.linalg.norm(np.diff(both.vertices[both.segments], axis=1), axis=2).sum()
    before = np.linalg.norm(np.diff(vertices[half.segments[~on_axis]], axis=1), axis=2).sum()
    assert lengths == pytest.approx(2.0 * before)
    for name, group in half.groups.sides.items():
        away = ~on[group].all(axis=1)
        found = both.groups.sides.get(name, np.zeros((0, 2), dtype=np.int64))
        assert len(found) == 2 * away.sum()
        assert {tuple(segment) for segment in found.tolist()} <= boundary, "the mesh on their left"
        inside = both.groups.lines.get(name, np.zeros((0, 2), dtype=np.int64))
        np.testing.assert_array_equal(inside, group[~away])
    for name, group in half.groups.lines.items():
        edges = {tuple(edge) for edge in both.edges[0].tolist()}
        assert len(both.groups.lines[name]) == 2 * len(group)
        assert {tuple(edge) for edge in np.sort(both.groups.lines[name], axis=1).tolist()} <= edges
    for name, group in half.groups.regions.items():
        assert both.areas[both.groups.regions[name]].sum() == pytest.approx(2.0 * half.areas[group].sum())
    for name, vertex in half.groups.points.items():
        assert both.groups.points[name] == vertex
        if on[vertex]:
            assert f"{name}_mirrored" not in both.groups.points
        else:
            place = both.vertices[both.groups.points[f"{name}_mirrored"]]
            np.testing.assert_allclose(place, axis.mirrored(vertices[[vertex]])[0])


def test_nodes_on_a_coordinate_axis_and_images_are_exact() -> None:
    half = grid(3, 2, (0.0, 0.1), (0.7, 0.3))
    both = mirrored(half, axis_of("y", "test"))
    found = {tuple(point) for point in both.vertices.tolist()}
    assert len(found) == len(both.vertices)
    assert found == {(sign * x, y) for x, y in half.vertices.tolist() for sign in (1.0, -1.0)}


def test_curves_are_mirrored() -> None:
    half = grid(2, 2, (0.0, 0.0), (3.0, 2.0))
    curved = replace(half, curved=CurvedEdges(np.array([[6, 7]]), np.array([0]), (Circle(),)))
    found = mirrored(curved, axis_of("y", "test")).curved
    assert len(found.edges) == len(found.curve_of) == len(found.curves) == 2
    np.testing.assert_array_equal(found.curve_of, [0, 1])
    image = found.curves[1]
    np.testing.assert_allclose(image.at(image.nearest(np.array([[-5.0, 1.0]]))), [[-3.0, 1.0]])


def test_names_of_images_are_free() -> None:
    half = replace(grid(1, 1), groups=Groups(points={"a": 3, "a_mirrored": 2}))
    points = mirrored(half, axis_of("y", "test")).groups.points
    assert points == {"a": 3, "a_mirrored": 2, "a_mirrored_2": 5, "a_mirrored_mirrored": 4}


def test_a_mesh_beyond_or_away_from_the_axis_is_refused() -> None:
    half = grid(2, 2)
    with pytest.raises(UserError, match=r"^grid: the mesh crosses the axis 0\.5,0,0\.5,1: \(.*\) is beyond it; keep"):
        mirrored(half, axis_of("0.5,0,0.5,1", "test"))
    with pytest.raises(UserError, match=r"^grid: no side of the mesh lies on the axis -1,0,-1,1; mirror it"):
        mirrored(half, axis_of("-1,0,-1,1", "test"))
    with pytest.raises(UserError, match="no side of the mesh lies on the axis"):
        mirrored(half, axis_of("0,0,1,-1", "test"))
