"""Swept meshes: valid solids of the right volume, whose faces and names are those of the plane mesh."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from quad_grids import grid, random_mesh, whole

from envs.errors import UserError
from envs.mesh import CurvedEdges, Groups, Mesh, edges_of
from envs.polygons.axis import axis_of
from envs.types import Floats, Ints
from freemesh_ray.mesh_geometry.hexahedra import AROUND, EDGES, FACES, corner_jacobians, faces_of, volumes
from freemesh_ray.mesh_geometry.swept import SweptMesh, extruded, revolved
from freemesh_ray.storage import free_memory
from freemesh_ray.storage.free_memory import MemoryShortError

#: The powers of the 20-node hexahedron's shape functions, and its nodes.
CORNERS = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], dtype=float
)
NODES = np.concatenate([CORNERS, CORNERS[EDGES].mean(axis=1)])
POWERS = np.array([p for p in product(range(3), repeat=3) if sum(each for each in p if each == 2) <= 2])


class Circle:
    """Around the origin."""

    def __init__(self, radius: float) -> None:
        self.radius = radius

    def nearest(self, points: Floats) -> Floats:
        return np.arctan2(points[:, 1], points[:, 0])

    def at(self, parameters: Floats) -> Floats:
        return self.radius * np.stack([np.cos(parameters), np.sin(parameters)], axis=1)


def weights_and_jacobians(solid: SweptMesh) -> tuple[Floats, Floats]:
    """(q,) weights and (m, q) determinants of the 20-node hexahedra at the points of Gauss's rule of three."""
    x, w = np.polynomial.legendre.leggauss(3)
    points = np.array(list(product(x, repeat=3)))
    of_nodes = np.linalg.inv(np.prod(NODES[:, None] ** POWERS, axis=2))
    slopes = []
    for axis in range(3):
        lowered = POWERS.copy()
        lowered[:, axis] = np.maximum(lowered[:, axis] - 1, 0)
        slopes.append(POWERS[:, axis] * np.prod(points[:, None] ** lowered, axis=2) @ of_nodes)
    gradients = np.einsum("dqn,mnc->mqdc", np.array(slopes), solid.nodes[solid.hexes])
    return np.prod(list(product(w, repeat=3)), axis=1), np.linalg.det(gradients)


def keys(faces: Ints) -> set[tuple[int, ...]]:
    """Faces by their corners, whichever way they are walked."""
    return {tuple(face) for face in np.sort(faces[:, :4], axis=1).tolist()}


def directed(faces: Ints) -> set[tuple[int, ...]]:
    """Faces by their corners, from the lowest one on in the direction they are walked."""
    first = faces[:, :4].argmin(axis=1)[:, None]
    return {tuple(face) for face in np.take_along_axis(faces[:, :4], (first + np.arange(4)) % 4, axis=1).tolist()}


def check(solid: SweptMesh) -> None:
    """What holds for every solid."""
    assert np.isfinite(solid.nodes).all()
    assert set(solid.hexes.ravel().tolist()) == set(range(len(solid.nodes)))
    assert (corner_jacobians(solid.nodes, solid.hexes) > 0.0).all()
    everything = np.sort(faces_of(solid.hexes).reshape(-1, 4), axis=1)
    distinct, first, counts = np.unique(everything, axis=0, return_index=True, return_counts=True)
    assert counts.max() <= 2, "a face belongs to two hexahedra at most"
    outer = faces_of(solid.hexes).reshape(-1, 4)[first[counts == 1]]
    named = [face for group in solid.groups.faces.values() for face in directed(group)]
    assert len(named) == len(set(named)), "no outer face in two sets"
    assert set(named) == directed(outer), "every outer face in one set, as seen from outside"
    inner = keys(distinct[counts == 2])
    for group in solid.groups.interfaces.values():
        assert keys(group) <= inner
        assert len(keys(group)) == len(group)
    ends = {tuple(edge) for edge in np.sort(solid.hexes[:, EDGES].reshape(-1, 2), axis=1).tolist()}
    for group in solid.groups.edges.values():
        assert {tuple(edge) for edge in np.sort(group[:, :2], axis=1).tolist()} <= ends
        assert (group[1:, 0] == group[:-1, 1]).all(), "one after the other"
    if solid.order == 2:
        middle = {
            (*sorted(edge), node)
            for hexahedron in solid.hexes.tolist()
            for edge, node in zip(np.array(hexahedron)[EDGES].tolist(), hexahedron[8:], strict=True)
        }
        assert len(middle) == len({edge[:2] for edge in middle}) == len({edge[2] for edge in middle})
        for group in [*solid.groups.faces.values(), *solid.groups.interfaces.values()]:
            for i in range(4):
                triples = np.column_stack([np.sort(group[:, [i, (i + 1) % 4]], axis=1), group[:, 4 + i]]).tolist()
                assert {tuple(each) for each in triples} <= middle
        for group in solid.groups.edges.values():
            triples = np.column_stack([np.sort(group[:, :2], axis=1), group[:, 2]]).tolist()
            assert {tuple(each) for each in triples} <= middle


def area(faces: Ints, nodes: Floats) -> float:
    """Of plane faces."""
    diagonals = nodes[faces[:, 2:4]] - nodes[faces[:, :2]]
    return float(np.linalg.norm(np.cross(diagonals[:, 0], diagonals[:, 1]), axis=1).sum() / 2.0)


def length(mesh: Mesh, segments: Ints) -> float:
    return float(np.linalg.norm(np.diff(mesh.vertices[segments], axis=1), axis=2).sum())


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10_000), height=st.floats(1e-3, 1e3), layers=st.integers(1, 5), ratio=st.floats(0.1, 10.0),
    order=st.sampled_from([1, 2]),
)  # fmt: skip
def test_an_extrusion_is_its_area_times_its_height(
    seed: int, height: float, layers: int, ratio: float, order: int
) -> None:
    mesh = random_mesh(seed)
    solid = extruded(mesh, height, layers, ratio, order=order)
    check(solid)
    each = volumes(solid.nodes, solid.hexes).reshape(layers, -1)
    thickness = ratio ** (np.arange(layers) / max(1, layers - 1))
    thickness *= height / thickness.sum()
    np.testing.assert_allclose(each, np.outer(thickness, mesh.areas), rtol=1e-9)
    if order == 2:
        weights, jacobians = weights_and_jacobians(solid)
        assert jacobians.min() > 0.0
        np.testing.assert_allclose((jacobians @ weights).reshape(layers, -1), each, rtol=1e-9)
    np.testing.assert_array_equal(solid.nodes[: len(mesh.vertices), :2], mesh.vertices)
    groups = solid.groups
    assert set(mesh.groups.sides) <= set(groups.faces)
    for name, segments in mesh.groups.sides.items():
        assert area(groups.faces[name], solid.nodes) == pytest.approx(length(mesh, segments) * height)
    for name, segments in mesh.groups.lines.items():
        assert area(groups.interfaces[name], solid.nodes) == pytest.approx(length(mesh, segments) * height)
    for name, quads in mesh.groups.regions.items():
        found = volumes(solid.nodes, solid.hexes[groups.regions[name]]).sum()
        assert found == pytest.approx(mesh.areas[quads].sum() * height)
    for name, vertex in mesh.groups.points.items():
        np.testing.assert_array_equal(
            solid.nodes[groups.edges[name].ravel(), :2],
            np.tile(mesh.vertices[vertex], (groups.edges[name].size, 1)),
        )
        assert len(groups.edges[name]) == layers


def test_ends_and_rest_have_names_that_are_free() -> None:
    mesh = grid(2, 1)
    names = set(extruded(mesh, 1.0, 1).groups.faces)
    assert names == {"bottom", "top", "sides"}
    sides = {"Bottom": mesh.segments[:1], "sides": mesh.segments[1:2]}
    taken = replace(mesh, groups=Groups(sides, regions={"bottom_2": np.array([0])}, points={"TOP": 0}))
    solid = extruded(taken, 1.0, 1)
    assert set(solid.groups.faces) == {"Bottom", "bottom_3", "top_2", "sides", "sides_2"}
    assert (solid.nodes[solid.groups.faces["bottom_3"], 2] == 0.0).all()
    assert (solid.nodes[solid.groups.faces["top_2"], 2] == 1.0).all()
    whole_named = replace(mesh, groups=Groups({"edge": mesh.segments}))
    assert set(revolved(whole_named, 90.0, 4, axis_of("-1.0,0.0,-1.0,1.0", "test")).groups.faces) == {
        "edge",
        "start",
        "end",
    }
    assert set(revolved(whole_named, 360.0, 4, axis_of("-1.0,0.0,-1.0,1.0", "test")).groups.faces) == {"edge"}


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10_000), degrees=st.one_of(st.just(360.0), st.floats(5.0, 360.0)), layers=st.integers(4, 9),
    turn=st.floats(0.0, 7.0), side=st.sampled_from([-1.0, 1.0]), gap=st.floats(1e-3, 10.0),
    order=st.sampled_from([1, 2]),
)  # fmt: skip
def test_a_revolution_has_the_volume_of_pappus_between_chords(
    seed: int, degrees: float, layers: int, turn: float, side: float, gap: float, order: int
) -> None:
    plain = random_mesh(seed)
    # The axis anywhere, the mesh on either side of it.
    flat = plain.vertices - [plain.vertices[:, 0].min() - gap, 0.0]
    radius = flat[:, 0]
    along = np.array([np.cos(turn), np.sin(turn)])
    across = side * np.array([along[1], -along[0]])
    origin = np.array([3.0, -2.0])
    vertices = origin + np.outer(flat[:, 1], along) + np.outer(radius, across)
    mesh = replace(plain, vertices=vertices)
    if mesh.areas[0] < 0.0:
        groups = replace(plain.groups, sides={k: v[:, ::-1] for k, v in plain.groups.sides.items()})
        mesh = whole(vertices, plain.quads[:, ::-1], groups)
    axis = axis_of([origin, origin + 7.0 * along], "test")
    solid = revolved(mesh, degrees, layers, axis, order=order)
    check(solid)
    step = np.radians(degrees / layers)
    each = volumes(solid.nodes, solid.hexes).reshape(layers, -1)
    np.testing.assert_allclose(each, np.tile(np.sin(step) * moments(radius, flat, mesh.quads), (layers, 1)), rtol=1e-7)
    np.testing.assert_array_equal(solid.nodes[: len(vertices), :2], vertices)
    assert (solid.nodes[len(vertices) : 2 * len(vertices), 2] > 0.0).all() or step >= np.pi, "first to z > 0"
    distance = np.hypot((solid.nodes[:, :2] - origin) @ across, solid.nodes[:, 2])
    rows = layers if degrees == 360.0 else layers + 1
    np.testing.assert_allclose(distance[: rows * len(vertices)], np.tile(radius, rows), rtol=1e-9)
    assert ("start" in solid.groups.faces) == ("end" in solid.groups.faces) == (degrees < 360.0)
    if order == 2:
        assert weights_and_jacobians(solid)[1].min() > 0.0
        edges, _ = edges_of(mesh.quads)
        np.testing.assert_allclose(
            distance[rows * len(vertices) :].sum(),
            rows * radius[edges].mean(axis=1).sum() + layers * radius.sum(), rtol=1e-9,
        )  # fmt: skip
    for name, quads in mesh.groups.regions.items():
        assert volumes(solid.nodes, solid.hexes[solid.groups.regions[name]]).sum() == pytest.approx(
            each[:, quads].sum()
        )
    for name, segments in mesh.groups.sides.items():
        assert len(solid.groups.faces[name]) == layers * len(segments)
    for name, vertex in mesh.groups.points.items():
        path = solid.groups.edges[name]
        assert len(path) == layers
        assert (path[-1, 1] == path[0, 0]) == (degrees == 360.0)
        np.testing.assert_allclose(distance[path.ravel()], radius[vertex], rtol=1e-9)


@pytest.mark.parametrize("order", [1, 2])
def test_a_revolution_converges_to_the_volume_of_pappus(order: int) -> None:
    mesh = grid(2, 3, (1.0, 0.0), (2.0, 1.0))
    exact = 2.0 * np.pi * 1.5
    errors = []
    for layers in (8, 16, 32):
        solid = revolved(mesh, 360.0, layers, order=order)
        weights, jacobians = weights_and_jacobians(solid) if order == 2 else (np.ones(1), None)
        found = float((volumes(solid.nodes, solid.hexes) if jacobians is None else jacobians @ weights).sum())
        errors.append(abs(found / exact - 1.0))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(rates, 2.0 * order, atol=0.1)


def moments(radius: Floats, vertices: Floats, quads: Ints) -> Floats:
    """(m,) the integral of the radius over each element, by two triangles; positive."""
    found = np.zeros(len(quads))
    for t in ([0, 1, 2], [0, 2, 3]):
        a, b, c = np.moveaxis(vertices[quads[:, t]], 1, 0)
        found += cross(b - a, c - a) / 2.0 * radius[quads[:, t]].mean(axis=1)
    return np.abs(found)


def cross(first: Floats, second: Floats) -> Floats:
    return first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]


def shaft(slope: float) -> Mesh:
    """Half of the section of a solid shaft of radius 2 of two materials, its ends cones unless the slope is 0."""
    even = grid(3, 4, (0.0, 0.0), (2.0, 4.0))
    x, y = even.vertices.T
    on_axis, at_end = ((side[even.segments] == bound).all(axis=1) for side, bound in ((x, 0.0), (y, 4.0)))
    groups = Groups(
        {"axis": even.segments[on_axis], "end": even.segments[at_end], "rest": even.segments[~(on_axis | at_end)]},
        {"joint": np.array([[2, 7], [12, 7], [12, 17]])},
        {"steel": np.flatnonzero(y[even.quads].mean(axis=1) < 2.0)},
        {"middle": 2, "off": 7},
    )
    return whole(np.stack([x, y + slope * x * (y - 1.0)], axis=1), even.quads, groups)


@pytest.mark.parametrize("degrees", [10.0, 45.0, 90.0, 134.0, 180.0, 270.0, 360.0])
@pytest.mark.parametrize("pieces", [2, 4, 8, 22])
@pytest.mark.parametrize("slope", [0.0, 0.3, -0.2])
@pytest.mark.parametrize("order", [1, 2])
def test_what_touches_the_axis_has_a_core_without_wedges(degrees: float, pieces: int, slope: float, order: int) -> None:
    mesh = shaft(slope)
    sectors = max(1, round(degrees / 90.0))
    solid = revolved(mesh, degrees, sectors * pieces, order=order)
    check(solid)
    step = np.radians(degrees / (sectors * pieces))
    chords = sectors * pieces * np.sin(step)
    each = moments(mesh.vertices[:, 0], mesh.vertices, mesh.quads)
    # Of a cone between chords the faces are not plane.
    near = 1e-12 if slope == 0.0 else 0.005 * step**2
    assert volumes(solid.nodes, solid.hexes).sum() == pytest.approx(chords * each.sum(), rel=near)
    steel = solid.hexes[solid.groups.regions["steel"]]
    found = volumes(solid.nodes, steel).sum()
    assert found == pytest.approx(chords * each[mesh.groups.regions["steel"]].sum(), rel=near)
    faces = solid.groups.faces
    assert set(faces) == {"end", "rest"} | ({"start", "end_2"} if degrees < 360.0 else set())
    radius = np.hypot(solid.nodes[:, 0], solid.nodes[:, 2])
    for group, level in ((faces["end"], 4.0), (solid.groups.interfaces["joint"], 2.0)):
        corners = group[:, :4]
        nodes = np.unique(corners)
        np.testing.assert_allclose(solid.nodes[nodes, 1], level + slope * radius[nodes] * (level - 1.0))
        shadow = solid.nodes[corners][:, :, [2, 0]]
        turned = cross(shadow[:, 2] - shadow[:, 0], shadow[:, 3] - shadow[:, 1]) / 2.0
        assert abs(turned.sum() if level == 4.0 else np.abs(turned).sum()) == pytest.approx(2.0 * chords)
    np.testing.assert_allclose(solid.nodes[solid.groups.points["middle"]], [0.0, 2.0, 0.0], atol=1e-15)
    assert set(solid.groups.edges) == {"off"}
    if order == 2:
        weights, jacobians = weights_and_jacobians(solid)
        assert jacobians.min() > 0.0
        assert (jacobians @ weights).sum() == pytest.approx(
            np.radians(degrees) * each.sum(), rel=step**4 / 200.0 + near
        )


@pytest.mark.parametrize("order", [1, 2])
def test_middles_of_curved_edges_lie_on_their_curves(order: int) -> None:
    # Part of a ring, its elements' inner and outer sides on circles.
    flat = grid(2, 4)
    r, t = 1.0 + flat.vertices[:, 0], 0.4 * np.pi * flat.vertices[:, 1]
    vertices = np.stack([r * np.cos(t), r * np.sin(t)], axis=1)
    edges, _ = edges_of(flat.quads)
    curve_of = np.where(
        np.isclose(r[edges], 1.0).all(axis=1), 0, np.where(np.isclose(r[edges], 2.0).all(axis=1), 1, -1)
    )
    curved = CurvedEdges(edges[curve_of >= 0], curve_of[curve_of >= 0], (Circle(1.0), Circle(2.0)))
    solid = extruded(replace(whole(vertices, flat.quads), curved=curved), 1.0, 2, order=order)
    check(solid)
    distance = np.hypot(solid.nodes[:, 0], solid.nodes[:, 1])
    on = [np.isclose(distance, radius, rtol=1e-12).sum() for radius in (1.0, 2.0)]
    assert on == ([15, 15] if order == 1 else [37, 37])
    if order == 2:
        weights, jacobians = weights_and_jacobians(solid)
        assert jacobians.min() > 0.0
        assert (jacobians @ weights).sum() == pytest.approx(0.5 * 3.0 * 0.4 * np.pi, rel=3e-4)


def test_the_faces_of_a_hexahedron_look_outwards() -> None:
    corners = CORNERS[FACES]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0])
    assert ((normals * corners.mean(axis=1)).sum(axis=1) > 0.0).all()
    np.testing.assert_allclose(corner_jacobians(CORNERS, np.arange(8)[None]), 8.0)
    assert {frozenset((i, int(j))) for i in range(8) for j in AROUND[i]} == {frozenset(e) for e in EDGES.tolist()}


@settings(max_examples=30)
@given(seed=st.integers(0, 1000))
def test_volumes_are_those_of_the_trilinear_map(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = CORNERS + rng.uniform(-0.4, 0.4, (8, 3)) + 50.0
    x, w = np.polynomial.legendre.leggauss(3)
    total = 0.0
    for (u, v, s), weight in zip(product(x, repeat=3), product(w, repeat=3), strict=True):
        parts = 1.0 + CORNERS * [u, v, s]
        slopes = np.stack([CORNERS[:, i] * np.prod(np.delete(parts, i, axis=1), axis=1) for i in range(3)]) / 8.0
        total += float(np.prod(weight) * np.linalg.det(slopes @ points))
    assert volumes(points, np.arange(8)[None])[0] == pytest.approx(total, rel=1e-9)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m: extruded(m, 0.0, 1), r"^grid: height 0 of an extrusion; give --extrude a number above 0$"),
        (lambda m: extruded(m, np.inf, 1), "height inf"),
        (lambda m: extruded(m, np.nan, 1), "height nan"),
        (lambda m: extruded(m, 1.0, 0), r"^grid: 0 layers; give --layers 1 or more$"),
        (lambda m: extruded(m, 1.0, 1, 0.0), "ratio 0 of layers"),
        (lambda m: extruded(m, 1.0, 4, 1e4), r"ratio 10000 of layers; give one from 0\.001 to 1000"),
        (lambda m: extruded(m, 1.0, 3_000_000), "3,000,000 layers of 2 elements, at most 5,000,000 hexahedra"),
        (lambda m: extruded(m, 1.0, 1, order=3), "order 3"),
        (lambda m: extruded(replace(m, complete=False), 1.0, 1), "not complete"),
        (lambda m: revolved(m, 0.0, 4), r"a turn of 0 degrees; give --revolve a number above 0, at most 360"),
        (lambda m: revolved(m, 361.0, 4), "a turn of 361 degrees"),
        (lambda m: revolved(m, np.nan, 4), "a turn of nan degrees"),
        (lambda m: revolved(m, 360.0, 2), r"2 layers in 360 degrees; give --layers 3 or more$"),
        (lambda m: revolved(m, 90.0, 2, axis_of("0.5,0,0.5,1", "t")), r"crosses the axis .*: \(.*\) is beyond it;"),
        (lambda m: revolved(m, 90.0, 3), r"touches the axis of revolution at \(0\.0, .*a multiple of 2 .* 4$"),
        (lambda m: revolved(m, 360.0, 12), r"a multiple of 8 layers; give --layers 16$"),
        (lambda m: revolved(m, 90.0, 4, axis_of("1,1,2,0", "t")), r"at \(1\.0, 1\.0\) an element touches"),
    ],
)  # fmt: skip
def test_what_cannot_be_swept_is_told_in_one_line(call: object, message: str) -> None:
    mesh = grid(2, 1)
    assert callable(call)
    with pytest.raises(UserError, match=message):
        call(mesh)


def test_a_pinch_on_the_axis_is_told() -> None:
    one = grid(1, 1)
    vertices = np.concatenate([one.vertices, [[0.0, 2.0], [1.0, 1.5], [1.0, 2.5]]])
    # Both elements have the axis's point (0, 1), and share no edge.
    mesh = whole(vertices, np.concatenate([one.quads, [[1, 5, 6, 4]]]))
    with pytest.raises(UserError, match=r"^grid: at \(0\.0, 1\.0\) two parts of the mesh touch the axis"):
        revolved(mesh, 90.0, 4)


def test_a_solid_that_memory_has_no_room_for_is_not_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(free_memory, "available", lambda: 1e6)
    with pytest.raises(MemoryShortError, match=r"^grid: a solid of 2,000 hexahedra takes .* use fewer --layers"):
        extruded(grid(2, 1), 1.0, 1000)
