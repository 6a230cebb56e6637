"""Every format, read back by its grammar: the same nodes and elements, and each named part with what is in it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from file_parsers import PARSERS, Found
from hypothesis import HealthCheck, given, settings
from shapes import block, cracked, grid, holed, meshes, named

from envs.mesh import Mesh
from freemesh_ray.export import FORMATS, MSH_VERSIONS, hohqmesh, write
from freemesh_ray.export.element_kinds import ORDERS
from freemesh_ray.export.finite_elements import FiniteElements
from freemesh_ray.export.names import renamed
from freemesh_ray.export.plane import plane_elements
from freemesh_ray.export.solid import solid_elements

#: Formats whose coordinates are of sixteen characters, fewer than all bits need.
ROUNDED = {".bdf": 5e-12, ".k": 5e-11}
#: Formats that put sides, lines and points down as sets of nodes alone.
NODE_SETS = {".bdf", ".k"}
#: Suffixes with the version of the format and the nodes of an element.
PLANE = [
    (suffix, version, nodes)
    for suffix, form in FORMATS.items()
    if suffix in PARSERS
    for version in (form.versions or MSH_VERSIONS[:1])
    for nodes in form.nodes
]
SOLID = [(suffix, nodes) for suffix, form in FORMATS.items() for nodes in form.hexes]


def options(nodes: int) -> dict:
    return {"quadratic": True} if nodes == 8 else {"order": ORDERS[nodes]}


def rows(facets: np.ndarray) -> set[frozenset[int]]:
    return {frozenset(row) for row in np.asarray(facets).tolist()}


def check_nodes(found: Found, expected: FiniteElements, suffix: str) -> np.ndarray:
    """The nodes are the same, every bit where the format has room; what number each has in the file, from 0."""
    places, flat = expected.nodes, np.ascontiguousarray(found.nodes[:, : expected.nodes.shape[1]])
    assert not found.nodes[:, places.shape[1] :].any()
    number = np.arange(len(places))
    if suffix == ".ism":  # corners alone
        corners = np.unique(expected.elements[:, :4])
        places, number = places[corners], np.searchsorted(corners, number)
    elif suffix == ".mesh":  # the vertices, then nodes that are numbered anew
        vertices = expected.elements[:, expected.kind.corners :].min(initial=len(places))
        assert sorted(map(tuple, flat.tolist())) == sorted(map(tuple, places.tolist()))
        places, flat = places[:vertices], flat[:vertices]
    if suffix in ROUNDED:
        np.testing.assert_allclose(flat, places, rtol=ROUNDED[suffix], atol=1e-300)
    else:
        assert flat.tobytes() == np.ascontiguousarray(places).tobytes()
    return number


def check(found: Found, expected: FiniteElements, suffix: str) -> None:
    """What was read is what was written, by its parts' names."""
    number, form, d = check_nodes(found, expected, suffix), FORMATS[suffix], expected.kind.dimension
    wanted = number[expected.elements[:, : expected.kind.corners]]
    foam = suffix in (".foam", ".zip")
    if not foam or d == 2:
        assert sorted(found.corners.tolist()) == sorted(wanted.tolist())
        if len(expected.regions) == 1 or suffix != ".msh":
            assert found.corners.tolist() == wanted.tolist()
    if d == 2:
        p = found.nodes[found.corners]
        u, v = p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]
        assert (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] > 0.0).all()
    if suffix in NODE_SETS:
        assert {name for name, _ in expected.node_sets} <= set(found.sets)
        for name, nodes in expected.node_sets:
            assert found.sets[name].tolist() == nodes.tolist()
    else:
        assert {side.name for side in expected.sides} <= set(found.sides)
        for side in expected.sides:
            assert rows(found.sides[side.name]) == rows(number[side.facets[:, : 2 * (d - 1)]])
            assert len(found.sides[side.name]) == len(side.facets)
        for line in expected.lines if form.lines else ():
            assert rows((found.lines if foam else found.sides)[line.name]) == rows(line.facets[:, : 2 * (d - 1)])
        for point in expected.points if form.points else ():
            assert set(found.sets[point.name].tolist()) == set(point.nodes.tolist())
    for region in expected.regions if form.regions else ():
        elements = found.regions[region.name]
        if foam:
            assert elements.tolist() == region.elements.tolist()
        else:
            assert rows(found.corners[elements]) == rows(wanted[region.elements])


@pytest.mark.parametrize(("suffix", "version", "nodes"), PLANE)
@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(mesh=meshes())
def test_a_plane_mesh_comes_back(tmp_path: Path, suffix: str, version: str, nodes: int, mesh: Mesh):
    path = tmp_path / f"mesh{suffix}"
    write(mesh, path, version=version, **options(nodes))
    expected, _ = renamed(plane_elements(mesh, nodes), FORMATS[suffix].rule)
    check(PARSERS[suffix](path), expected, suffix)


@pytest.mark.parametrize(("suffix", "nodes"), SOLID)
def test_hexahedra_come_back(tmp_path: Path, suffix: str, nodes: int):
    mesh = block(nodes)
    path = tmp_path / f"mesh{suffix}"
    write(mesh, path)
    expected, _ = renamed(solid_elements(mesh), FORMATS[suffix].rule)
    assert [side.name for side in expected.sides][-1].lower() == "boundary"
    assert len(expected.regions) == 2
    check(PARSERS[suffix](path), expected, suffix)


@pytest.mark.parametrize(("suffix", "version", "nodes"), PLANE)
@pytest.mark.parametrize("mesh", [named(), holed(), cracked(), grid(1, 1)], ids=["named", "holed", "cracked", "one"])
def test_every_boundary_edge_is_in_one_side_of_the_file(
    tmp_path: Path, suffix: str, version: str, nodes: int, mesh: Mesh
):
    path = tmp_path / f"mesh{suffix}"
    write(mesh, path, version=version, **options(nodes))
    found = PARSERS[suffix](path)
    expected, _ = renamed(plane_elements(mesh, nodes), FORMATS[suffix].rule)
    names = [side.name for side in expected.sides]
    if suffix in NODE_SETS:
        sides = [
            rows([edge for edge in mesh.segments if set(edge.tolist()) <= set(found.sets[name].tolist())])
            for name in names
        ]
        assert set().union(*sides) == rows(mesh.segments)
        return
    edges = [edge for name in names for edge in rows(found.sides[name])]
    assert len(edges) == len(set(edges)) == len(mesh.segments)
    numbers = np.unique(mesh.quads) if suffix == ".ism" else np.arange(len(mesh.vertices))
    assert {frozenset(numbers[list(edge)].tolist()) for edge in edges} == rows(mesh.segments)


def test_every_format_with_parts_has_a_parser():
    assert set(PARSERS) == {suffix for suffix, form in FORMATS.items() if form.sides}


# ---- the order of an element's nodes ---------------------------------------------------------------------------------

BELOW, ABOVE, UPRIGHT = ["01", "12", "23", "30"], ["45", "56", "67", "74"], ["04", "15", "26", "37"]
#: The nodes of an element, by its corners: one itself, the middle between two, or that of all.
ORDER = {
    (".inp", 8): ["0", "1", "2", "3", *BELOW],
    (".bdf", 8): ["0", "1", "2", "3", *BELOW],
    (".unv", 8): ["0", "01", "1", "12", "2", "23", "3", "30"],
    (".e", 8): ["0", "1", "2", "3", *BELOW],
    (".e", 9): ["0", "1", "2", "3", *BELOW, "0123"],
    (".xdmf", 9): ["0", "1", "2", "3", *BELOW, "0123"],
    (".mesh", 9): ["0", "01", "1", "30", "0123", "12", "3", "23", "2"],
    (".inp", 20): [*"01234567", *BELOW, *ABOVE, *UPRIGHT],
    (".xdmf", 20): [*"01234567", *BELOW, *ABOVE, *UPRIGHT],
    (".bdf", 20): [*"01234567", *BELOW, *UPRIGHT, *ABOVE],
    (".e", 20): [*"01234567", *BELOW, *UPRIGHT, *ABOVE],
    (".unv", 20): [
        "0",
        "01",
        "1",
        "12",
        "2",
        "23",
        "3",
        "30",
        "04",
        "15",
        "26",
        "37",
        "4",
        "45",
        "5",
        "56",
        "6",
        "67",
        "7",
        "74",
    ],
}


@pytest.mark.parametrize(("suffix", "nodes"), ORDER)
def test_nodes_of_order_2_are_where_the_format_has_them(tmp_path: Path, suffix: str, nodes: int):
    path = tmp_path / f"mesh{suffix}"
    write(block(20), path) if nodes == 20 else write(named(), path, **options(nodes))
    found = PARSERS[suffix](path)
    corners = found.nodes[found.corners]
    wanted = np.stack([corners[:, [int(c) for c in text]].mean(axis=1) for text in ORDER[suffix, nodes]], axis=1)
    np.testing.assert_allclose(found.nodes[found.cells], wanted, atol=1e-9)


@pytest.mark.parametrize("order", [2, 3, 4])
def test_the_nodes_of_mfem_are_those_of_a_continuous_function(tmp_path: Path, order: int):
    write(named(), tmp_path / "mesh.mesh", order=order)
    found = PARSERS[".mesh"](tmp_path / "mesh.mesh")
    places = [(i / order, j / order) for j in range(order + 1) for i in range(order + 1)]
    shape = np.array([[(1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y] for x, y in places])
    wanted = np.einsum("kc,mcd->mkd", shape, found.nodes[found.corners])
    np.testing.assert_allclose(found.nodes[found.cells], wanted, atol=1e-12)


@pytest.mark.parametrize("order", [2, 3, 4])
def test_curved_sides_of_ism_are_polynomials_at_chebyshev_points(tmp_path: Path, order: int):
    flat, _ = renamed(plane_elements(named(), (order + 1) ** 2), FORMATS[".ism"].rule)
    bend = lambda p: np.column_stack([p[:, 0] + 0.02 * p[:, 1] ** 2, p[:, 1]])  # noqa: E731
    corners = flat.elements[:, :4].max() + 1
    bent = np.concatenate([flat.nodes[:corners], bend(flat.nodes)[corners:]])
    hohqmesh.write(replace(flat, nodes=bent), tmp_path / "mesh.ism")
    hohqmesh_file = PARSERS[".ism"](tmp_path / "mesh.ism")
    stations = (1 - np.cos(np.pi * np.arange(order + 1) / order)) / 2
    assert len(hohqmesh_file.curves) == 4 * len(flat.elements)
    for (element, side), curve in hohqmesh_file.curves.items():
        a, b, *inner = flat.elements[element][list(flat.kind.sides[side])]
        walked = bent[[a, *inner, b] if side < 2 else [b, *inner[::-1], a]]
        for axis in (0, 1):
            exact = np.polynomial.Polynomial.fit(np.arange(order + 1) / order, walked[:, axis], order)(stations)
            np.testing.assert_allclose(curve[:, axis], exact, atol=1e-10)
    write(named(), tmp_path / "straight.ism", order=order)
    assert not PARSERS[".ism"](tmp_path / "straight.ism").curves
