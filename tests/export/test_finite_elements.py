"""Elements of a higher order, sides that make up the boundary, regions that make up the domain."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapes import block, cracked, grid, holed, meshes, named, outline

from envs.mesh import Groups, Mesh
from freemesh_ray.export import gmsh, vtk
from freemesh_ray.export.element_kinds import EDGES, FACES, ORDERS, hexahedron, quadrilateral
from freemesh_ray.export.plane import plane_elements
from freemesh_ray.export.solid import solid_elements

NODES = (4, 8, 9, 16, 25)


def edge_set(pairs: np.ndarray) -> set[frozenset[int]]:
    return {frozenset(pair) for pair in np.asarray(pairs)[:, :2].tolist()}


# ---- the order of nodes ----------------------------------------------------------------------------------------------


def test_a_quadrilateral_of_order_3_has_its_nodes_where_the_picture_shows_them():
    places = quadrilateral(16).places
    picture = [[3, 9, 8, 2], [10, 14, 15, 7], [11, 12, 13, 6], [0, 4, 5, 1]]
    assert [[places.index((i, j)) for i in range(4)] for j in (3, 2, 1, 0)] == picture


@pytest.mark.parametrize("nodes", NODES)
def test_sides_walk_around_with_their_inner_nodes_in_order(nodes: int):
    kind = quadrilateral(nodes)
    k = ORDERS[nodes]
    assert kind.nodes == nodes
    assert kind.serendipity == (nodes == 8)
    assert len(set(kind.places)) == nodes
    for side, (a, b, *inner) in enumerate(kind.sides):
        assert (a, b) == (side, (side + 1) % 4)
        walked = np.array([kind.places[i] for i in (a, *inner, b)])
        assert len(walked) == k + 1
        assert (np.diff(walked, axis=0) == np.diff(walked, axis=0)[0]).all()


@pytest.mark.parametrize("nodes", [8, 20])
def test_faces_of_a_hexahedron_look_outwards_and_middles_lie_between(nodes: int):
    kind = hexahedron(nodes)
    places = np.array(kind.places, dtype=float)
    for face, corners in zip(kind.sides, FACES, strict=True):
        assert face[:4] == corners
        p = places[list(corners)]
        normal = np.cross(p[1] - p[0], p[3] - p[0])
        assert normal @ (p.mean(axis=0) - places[:8].mean(axis=0)) > 0.0
        for i, middle in enumerate(face[4:]):
            assert np.array_equal(places[middle], (p[i] + p[(i + 1) % 4]) / 2)
    for (a, b), middle in zip(EDGES, places[8:], strict=False):
        assert np.array_equal(middle, (places[a] + places[b]) / 2)


@pytest.mark.slow
@pytest.mark.parametrize("nodes", NODES)
def test_vtk_has_its_nodes_where_vtk_says(nodes: int):
    cells = pytest.importorskip("vtk")
    k = ORDERS[nodes]
    lattice = {cells.vtkHigherOrderQuadrilateral.PointIndexFromIJK(i, j, [k, k]): (i, j)
               for i in range(k + 1) for j in range(k + 1)}  # fmt: skip
    assert vtk._places(quadrilateral(nodes)) == [lattice[i] for i in range(nodes)]


#: Where Gmsh has the nodes of its quadrilaterals of order 3 and 4: corners and sides, then the same of what is inside.
GMSH = {
    16: "00 30 33 03 10 20 31 32 23 13 02 01 11 21 22 12",
    25: "00 40 44 04 10 20 30 41 42 43 34 24 14 03 02 01 11 31 33 13 21 32 23 12 22",
}


@pytest.mark.parametrize("nodes", [16, 25])
def test_gmsh_has_its_nodes_in_rings(nodes: int):
    assert gmsh._places(quadrilateral(nodes)) == [(int(text[0]), int(text[1])) for text in GMSH[nodes].split()]


@pytest.mark.parametrize("nodes", [4, 8, 9, 16, 25, 108, 120])
def test_gmsh_has_its_nodes_where_gmsh_says(nodes: int):
    program = pytest.importorskip("gmsh")
    kind = quadrilateral(nodes) if nodes < 100 else hexahedron(nodes - 100)
    program.initialize(interruptible=False)
    try:
        properties = program.model.mesh.getElementProperties(gmsh.TYPES[kind.dimension, kind.nodes])
    finally:
        program.finalize()
    places = (np.array(properties[4]).reshape(kind.nodes, -1) + 1.0) / 2.0 * kind.order
    assert np.array_equal(np.rint(places), np.array(gmsh._places(kind)))


# ---- nodes of a higher order -----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("nodes", NODES)
@given(mesh=meshes())
def test_nodes_are_where_the_element_has_them(nodes: int, mesh: Mesh):
    found, kind = plane_elements(mesh, nodes), quadrilateral(nodes)
    n, k = len(mesh.vertices), kind.order
    assert found.nodes[:n].tobytes() == mesh.vertices.tobytes()
    assert found.elements[:, :4].tolist() == mesh.quads.tolist()
    edges, _ = mesh.edges
    inside = 0 if kind.serendipity else (k - 1) ** 2
    assert len(found.nodes) == n + len(edges) * (k - 1) + len(mesh.quads) * inside
    assert set(found.elements[:, 4:].ravel().tolist()) == set(range(n, len(found.nodes)))
    x, y = np.array(kind.places).T / k
    shape = np.stack([(1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y], axis=1)
    wanted = np.einsum("kc,mcd->mkd", shape, mesh.vertices[mesh.quads])
    np.testing.assert_allclose(found.nodes[found.elements], wanted, rtol=0, atol=1e-14 * np.abs(mesh.vertices).max())


@pytest.mark.parametrize("nodes", NODES[1:])
def test_elements_on_both_sides_of_an_edge_share_its_nodes(nodes: int):
    mesh, found = named(), plane_elements(named(), nodes)
    by_ends: dict[frozenset[int], set[tuple[int, ...]]] = {}
    for element in found.elements.tolist():
        for a, b, *inner in found.kind.sides:
            key = frozenset((element[a], element[b]))
            order = [element[i] for i in inner]
            by_ends.setdefault(key, set()).add(tuple(order if element[a] < element[b] else order[::-1]))
    assert all(len(walks) == 1 for walks in by_ends.values())
    assert len(by_ends) == len(mesh.edges[0])


# ---- sides, regions, lines, points -----------------------------------------------------------------------------------


@pytest.mark.parametrize("nodes", NODES)
@given(mesh=meshes())
def test_every_boundary_edge_is_in_one_side_and_every_element_in_one_region(nodes: int, mesh: Mesh):
    found = plane_elements(mesh, nodes)
    edges = [edge for side in found.sides for edge in edge_set(side.facets)]
    assert len(edges) == len(set(edges)) == len(mesh.segments)
    assert set(edges) == edge_set(mesh.segments)
    assert sorted(np.concatenate([region.elements for region in found.regions]).tolist()) == list(
        range(len(mesh.quads))
    )
    for side in found.sides:
        assert np.array_equal(
            found.elements[side.elements][:, found.kind.side_nodes][np.arange(len(side.sides)), side.sides], side.facets
        )
        assert set(side.nodes.tolist()) == set(side.facets.ravel().tolist())
        assert (np.diff(side.elements) >= 0).all()
    for name, edges_of in mesh.groups.sides.items():
        (side,) = (side for side in found.sides if side.name == name)
        assert edge_set(edges_of) <= edge_set(side.facets)
    for name, vertex in mesh.groups.points.items():
        assert [point.nodes.tolist() for point in found.points if point.name == name] == [[vertex]]
    for name, members in mesh.groups.regions.items():
        assert [region.elements.tolist() for region in found.regions if region.name == name] == [members.tolist()]
    assert [line.name for line in found.lines] == list(mesh.groups.lines)
    numbers = [group.number for group in found.groups()]
    assert numbers == list(range(1, len(numbers) + 1))
    assert sorted(np.concatenate(found.cell_numbers()).tolist()) == list(range(sum(map(len, found.cell_numbers()))))


@pytest.mark.parametrize("nodes", [4, 8])
def test_loops_without_names_are_told_apart(nodes: int):
    mesh = holed()
    found = plane_elements(mesh, nodes)
    corners = [set(side.nodes[side.nodes < len(mesh.vertices)].tolist()) for side in found.sides]
    assert [side.name for side in found.sides] == ["outer", "hole_1", "hole_2"]
    assert corners[1:] == [{9, 10, 16, 17}, {23, 24, 25, 26, 30, 31, 32, 33}]
    assert len(corners[0]) == 24
    assert edge_set(found.boundary.facets) == edge_set(mesh.segments)
    assert [side.name for side in plane_elements(grid(), nodes).sides] == ["boundary"]


def test_sides_have_the_domain_on_their_left():
    found = plane_elements(holed())
    areas = []
    for side in found.sides:
        a, b = found.nodes[side.facets[:, 0]], found.nodes[side.facets[:, 1]]
        areas.append(0.5 * float((a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]).sum()))
    assert [area > 0 for area in areas] == [True, False, False]
    assert math.isclose(sum(areas), holed().areas.sum())


@given(st.permutations(range(42)))
def test_sides_do_not_depend_on_the_order_of_the_segments(order: list[int]):
    mesh = holed()
    order = [i for i in order if i < len(mesh.segments)]
    shuffled = plane_elements(replace(mesh, segments=mesh.segments[order]))
    for side, other in zip(plane_elements(mesh).sides, shuffled.sides, strict=True):
        assert side.name == other.name
        assert side.nodes.tolist() == other.nodes.tolist()
        assert side.facets.tolist() == other.facets.tolist()


def test_what_has_no_name_keeps_its_loop_and_gives_way_to_names_that_are_taken():
    mesh = holed()
    hole = mesh.segments[np.isin(mesh.segments, [9, 10, 16, 17]).all(axis=1)]
    part = mesh.segments[:3]
    sides = Groups(sides={"outer": part, "bolt": hole})
    assert [side.name for side in plane_elements(replace(mesh, groups=sides)).sides] == [
        "outer",
        "bolt",
        "outer_2",
        "hole_2",
    ]
    regions = Groups(regions={"domain": np.array([3, 4])})
    assert [region.name for region in plane_elements(replace(mesh, groups=regions)).regions] == ["domain", "domain_2"]


def test_several_outer_loops_are_numbered():
    mesh = grid(5, 1)
    quads = mesh.quads[[0, 2, 4]]
    apart = replace(mesh, quads=quads, segments=outline(quads))
    assert [side.name for side in plane_elements(apart).sides] == ["outer_1", "outer_2", "outer_3"]


def test_elements_that_touch_at_a_corner_alone_are_one_loop():
    mesh = grid(2, 2)
    quads = mesh.quads[[0, 3]]
    (side,) = plane_elements(replace(mesh, quads=quads, segments=outline(quads))).sides
    assert (side.name, len(side.facets)) == ("boundary", 8)


def test_a_crack_has_two_sides_of_different_nodes():
    found = plane_elements(cracked())
    assert [side.name for side in found.sides] == ["crack_above", "crack_below", "outer"]
    above, below = found.sides[:2]
    assert len(above.facets) == len(below.facets) == 4
    assert len(np.intersect1d(above.nodes, below.nodes)) == 2
    ends = [found.nodes[side.facets].reshape(-1, 4) for side in (above, below)]
    assert {tuple(row) for row in ends[0]} == {(*row[2:], *row[:2]) for row in ends[1].tolist()}
    assert not set(above.elements.tolist()) & set(below.elements.tolist())


def test_a_line_inside_has_the_elements_on_its_left():
    mesh = named()
    (line,) = plane_elements(mesh).lines
    centres = mesh.vertices[mesh.quads[line.elements]].mean(axis=1)
    (given_edges,) = mesh.groups.lines.values()
    assert edge_set(line.facets) == edge_set(given_edges)
    # The edges run upwards, from the lower vertex to the higher one.
    assert (centres[:, 0] < 3.0).all()
    back = replace(mesh, groups=replace(mesh.groups, lines={"seam": given_edges[:, ::-1]}))
    (other,) = plane_elements(back).lines
    assert edge_set(other.facets) == edge_set(given_edges)
    assert (mesh.vertices[mesh.quads[other.elements]].mean(axis=1)[:, 0] > 3.0).all()


def test_an_incomplete_mesh_keeps_the_nodes_of_segments_that_nothing_reaches():
    whole = holed()
    part = replace(whole, quads=whole.quads[:5], complete=False)
    found = plane_elements(part, 8)
    assert set(found.boundary.nodes.tolist()) >= set(whole.segments.ravel().tolist())
    assert len(found.boundary.facets) < len(whole.segments)


@pytest.mark.parametrize("nodes", [8, 20])
def test_every_outer_face_of_a_solid_is_in_one_side(nodes: int):
    found = solid_elements(block(nodes))
    assert [side.name for side in found.sides] == ["left side", "right", "back", "boundary"]
    faces = [frozenset(face) for side in found.sides for face in side.facets[:, :4].tolist()]
    counts: dict[frozenset[int], int] = {}
    for element in found.elements.tolist():
        for face in FACES:
            key = frozenset(element[i] for i in face)
            counts[key] = counts.get(key, 0) + 1
    assert len(faces) == len(set(faces))
    assert set(faces) == {face for face, count in counts.items() if count == 1}
    (seam,) = found.lines
    assert all(counts[frozenset(face)] == 2 for face in seam.facets[:, :4].tolist())
    assert [(region.name, len(region.elements)) for region in found.regions] == [("steel", 32), ("copper", 34)]
    (gauge,) = found.points
    assert len(gauge.nodes) == (3 if nodes == 8 else 5)
