"""Every format, read back by its grammar: the same nodes and elements, and each named part with what is in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from file_parsers import PARSERS, Found
from hypothesis import HealthCheck, given, settings
from shapes import block, cracked, grid, holed, meshes, named

from envs.mesh import Mesh
from freemesh_ray.export import FORMATS, MSH_VERSIONS, write
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
        for name, nodes in expected.node_sets:
            assert found.sets[name].tolist() == nodes.tolist()
    else:
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
