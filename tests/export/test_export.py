"""Exported files: read back by other readers they are the same mesh, bit for bit where the format allows."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from shapes import cracked, grid, holed, named

from envs.mesh import Mesh, sides
from envs.polygons.rings import LARGEST_COORDINATE
from envs.quality import element_quality
from freemesh_ray.export import SUFFIXES, write
from freemesh_ray.export.fixed_width import parsed
from freemesh_ray.export.nastran import real
from freemesh_ray.export.plane import plane_elements
from freemesh_ray.storage.atomic import OutputError

FORMATS = [("mesh.vtu", "4.1"), ("mesh.msh", "4.1"), ("mesh.msh", "2.2"), ("mesh.inp", "4.1"), ("mesh.obj", "4.1")]
ALL = [*FORMATS, ("mesh.bdf", "4.1")]
#: Formats that have quadratic elements.
QUADRATIC = [form for form in ALL if form[0] != "mesh.obj"]


def read(path: Path) -> meshio.Mesh:
    if path.suffix == ".msh":
        return meshio.read(path, file_format="gmsh")
    if path.suffix == ".inp":  # meshio knows the plane strain elements only by other elements of the same nodes
        path.write_text(path.read_text().replace("CPE4", "CPS4").replace("CPE8", "S8R"))
    return meshio.read(path, file_format={".bdf": "nastran", ".inp": "abaqus"}.get(path.suffix))


def cards(deck: str) -> dict[str, list[str]]:
    """Keyword lines of an Abaqus deck -> their data lines."""
    found = [card.splitlines() for card in re.split(r"^(?=\*)", deck, flags=re.M)[1:]]
    return {card[0]: card[1:] for card in found}


def numbers(lines: list[str]) -> list[int]:
    return [int(number) for number in ", ".join(lines).split(", ")]


def edge_set(pairs: np.ndarray) -> set[frozenset[int]]:
    return {frozenset(pair) for pair in np.asarray(pairs)[:, :2].tolist()}


# ---- round trips -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "version"), FORMATS)
@settings(max_examples=6, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(scale=st.floats(1e-6, 1e6), shift=st.floats(-1e3, 1e3), quadratic=st.booleans())
def test_what_is_read_back_is_the_same_bit_for_bit(
    tmp_path: Path, name: str, version: str, scale: float, shift: float, quadratic: bool
):
    mesh, quadratic = grid(scale=scale, shift=shift), quadratic and (name, version) in QUADRATIC
    write(mesh, tmp_path / name, version=version, quadratic=quadratic)
    found, expected = read(tmp_path / name), plane_elements(mesh, 8 if quadratic else 4)
    assert np.ascontiguousarray(found.points[:, :2]).tobytes() == expected.nodes.tobytes()
    assert not found.points[:, 2:].any()
    assert found.cells[0].type == ("quad8" if quadratic else "quad")
    assert found.cells[0].data.tolist() == expected.elements.tolist()
    if "eta" in found.cell_data:
        assert found.cell_data["eta"][0].tobytes() == element_quality(mesh.vertices, mesh.quads).tobytes()
    assert ("eta" in found.cell_data) == ((name, version) in [("mesh.vtu", "4.1"), ("mesh.msh", "4.1")])


@pytest.mark.parametrize("quadratic", [False, True])
@pytest.mark.parametrize("scale", [1e-5, 1.0, 1e5])
def test_nastran_keeps_as_many_digits_as_its_fields_hold(tmp_path: Path, scale: float, quadratic: bool):
    mesh = grid(scale=scale)
    write(mesh, tmp_path / "mesh.bdf", quadratic=quadratic)
    found, expected = read(tmp_path / "mesh.bdf"), plane_elements(mesh, 8 if quadratic else 4)
    np.testing.assert_allclose(found.points[:, :2], expected.nodes, rtol=5e-12)
    assert [block.type for block in found.cells] == ["quad8" if quadratic else "quad"]
    assert found.cells[0].data.tolist() == expected.elements.tolist()


@given(st.floats(-LARGEST_COORDINATE, LARGEST_COORDINATE))
@example(-10000000000001.0)
def test_a_nastran_number_fits_its_field_and_is_as_near_as_it_can_be(value: float):
    text, size = real(value), abs(value)
    assert len(text) <= 16
    assert "." in text
    digits = (15 if 0.1 <= size < 1e14 else 13 if 1e-9 <= size < 0.1 else 11) - (value < 0)
    # Half a unit of the last digit, and the rounding of the double that is read.
    assert abs(parsed(text) - value) <= size * (0.5 * 10.0 ** (1 - digits) + 1e-15)
    exact = np.format_float_positional(value, unique=True, trim="0")
    if len(exact) <= 16:
        assert parsed(text) == value
        assert math.copysign(1.0, parsed(text)) == math.copysign(1.0, value)


@pytest.mark.parametrize(("name", "version"), ALL)
def test_the_same_mesh_gives_the_same_bytes(tmp_path: Path, name: str, version: str):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        write(holed(), tmp_path / folder / name, version=version)
    assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_an_incomplete_mesh_keeps_all_its_vertices(tmp_path: Path):
    whole = holed()
    part = replace(whole, quads=whole.quads[:5], complete=False)
    for name, version in FORMATS:
        write(part, tmp_path / name, version=version)
        assert np.ascontiguousarray(read(tmp_path / name).points[:, :2]).tobytes() == whole.vertices.tobytes()


# ---- finite elements -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mesh", [grid(1, 1), grid(7, 5), holed()], ids=["one", "grid", "holes"])
def test_middle_nodes_are_shared_halfway_and_numbered_after_the_corners(mesh: Mesh):
    found = plane_elements(mesh, 8)
    edges, _ = mesh.edges
    n = len(mesh.vertices)
    assert len(found.nodes) == n + len(edges)
    assert found.nodes[:n].tobytes() == mesh.vertices.tobytes()
    assert found.elements[:, :4].tolist() == mesh.quads.tolist()
    assert set(found.elements[:, 4:].ravel().tolist()) == set(range(n, n + len(edges)))
    ends = found.nodes[found.elements[:, :4]], found.nodes[np.roll(found.elements[:, :4], -1, axis=1)]
    assert np.array_equal(found.nodes[found.elements[:, 4:]], (ends[0] + ends[1]) / 2)


# ---- other readers ---------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("quadratic", [False, True])
def test_vtk_reads_the_vtu(tmp_path: Path, quadratic: bool):
    vtk = pytest.importorskip("vtk")
    mesh = grid()
    write(mesh, tmp_path / "mesh.vtu", quadratic=quadratic)
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(tmp_path / "mesh.vtu"))
    reader.Update()
    data, expected = reader.GetOutput(), plane_elements(mesh, 8 if quadratic else 4)
    assert [data.GetPoint(i) for i in range(data.GetNumberOfPoints())] == [(x, y, 0.0) for x, y in expected.nodes]
    assert data.GetCellType(0) == (vtk.VTK_QUADRATIC_QUAD if quadratic else vtk.VTK_QUAD)
    size = expected.elements.shape[1]
    cells = [[data.GetCell(i).GetPointId(k) for k in range(size)] for i in range(len(expected.elements))]
    assert cells == expected.elements.tolist()
    assert data.GetCellData().GetArray("eta").GetNumberOfTuples() == data.GetNumberOfCells() == 6 + 10


@pytest.mark.parametrize(("name", "version"), [("a.msh", "4.1"), ("a.msh", "2.2"), ("a.bdf", "4.1")])
@pytest.mark.parametrize("quadratic", [False, True])
def test_gmsh_opens_it(tmp_path: Path, name: str, version: str, quadratic: bool):
    gmsh = pytest.importorskip("gmsh")
    mesh, groups = holed(), {}
    write(mesh, tmp_path / name, version=version, quadratic=quadratic)
    expected = plane_elements(mesh, 8 if quadratic else 4)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.logger.start()
        gmsh.open(str(tmp_path / name))
        assert not [line for line in gmsh.logger.get() if not line.startswith("Info")]
        tags, points, _ = gmsh.model.mesh.getNodes()
        elements, nodes = gmsh.model.mesh.getElementsByType(16 if quadratic else 3)
        for dimension, tag in gmsh.model.getPhysicalGroups():
            members, _ = gmsh.model.mesh.getNodesForPhysicalGroup(dimension, tag)
            groups[gmsh.model.getPhysicalName(dimension, tag)] = set((members - 1).tolist())
    finally:
        gmsh.logger.stop()
        gmsh.finalize()
    order = np.argsort(tags)
    assert (tags[order] - 1).tolist() == list(range(len(expected.nodes)))
    np.testing.assert_allclose(points.reshape(-1, 3)[order, :2], expected.nodes, rtol=5e-12 if name == "a.bdf" else 0)
    assert (nodes.reshape(len(elements), -1) - 1).tolist() == expected.elements.tolist()
    if name == "a.msh":
        assert groups.pop("domain") == set(expected.elements.ravel().tolist())
        assert groups == {side.name: set(side.nodes.tolist()) for side in expected.sides}


@pytest.mark.parametrize("version", ["4.1", "2.2"])
@pytest.mark.parametrize("mesh", [holed(), cracked(), named()], ids=["holes", "crack", "names"])
def test_meshio_finds_every_part_of_a_gmsh_file_and_each_element_in_one(tmp_path: Path, version: str, mesh: Mesh):
    write(mesh, tmp_path / "mesh.msh", version=version)
    found, expected = read(tmp_path / "mesh.msh"), plane_elements(mesh)
    wanted = {region.name: expected.elements[region.elements] for region in expected.regions}
    wanted |= {part.name: part.facets for part in expected.facets} | {p.name: p.cells for p in expected.points}
    dimensions = dict.fromkeys((r.name for r in expected.regions), 2) | {part.name: 1 for part in expected.facets}
    dimensions |= dict.fromkeys((point.name for point in expected.points), 0)
    assert {name: dimension for name, (_, dimension) in found.field_data.items()} == dimensions
    blocks = list(zip(found.cells, found.cell_data["gmsh:physical"], strict=True))
    for name, (tag, _) in found.field_data.items():
        rows = np.concatenate([block.data[tags == tag] for block, tags in blocks if (tags == tag).any()])
        assert rows.tolist() == wanted[name].tolist()
    assert sum(len(block.data) for block, _ in blocks) == sum(map(len, wanted.values()))


@pytest.mark.parametrize("quadratic", [False, True])
def test_a_boundary_line_has_the_quality_of_the_element_behind_it(tmp_path: Path, quadratic: bool):
    mesh = holed()
    write(mesh, tmp_path / "mesh.msh", quadratic=quadratic)
    found = read(tmp_path / "mesh.msh")
    eta = element_quality(mesh.vertices, mesh.quads)
    behind = {tuple(side): eta[i] for i, of_quad in enumerate(sides(mesh.quads).tolist()) for side in of_quad}
    lines = list(zip(found.cells[1:], found.cell_data["eta"][1:], strict=True))
    assert sum(len(block.data) for block, _ in lines) == len(mesh.segments)
    for block, values in lines:
        assert values.ravel().tolist() == [behind[tuple(ends)] for ends in block.data[:, :2].tolist()]


@pytest.mark.parametrize("version", ["4.1", "2.2"])
def test_a_gmsh_file_without_holes_has_the_groups_domain_and_boundary(tmp_path: Path, version: str):
    write(grid(), tmp_path / "mesh.msh", version=version)
    assert set(read(tmp_path / "mesh.msh").field_data) == {"domain", "boundary"}
    assert (tmp_path / "mesh.msh").read_text().split()[:4] == ["$MeshFormat", version, "0", "8"]


# ---- Abaqus and Nastran ----------------------------------------------------------------------------------------------


def test_nastran_lines_are_no_longer_than_its_columns(tmp_path: Path):
    write(holed(), tmp_path / "mesh.bdf", quadratic=True)
    assert max(map(len, (tmp_path / "mesh.bdf").read_text().splitlines())) <= 72


def test_abaqus_numbers_survive_a_reader_of_twenty_characters(tmp_path: Path):
    mesh = grid(scale=1e-5)
    write(mesh, tmp_path / "mesh.inp")
    rows = [line.split(", ") for line in cards((tmp_path / "mesh.inp").read_text())["*NODE, NSET=ALL"]]
    cut = np.array([[float(number[:20]) for number in row[1:]] for row in rows])
    np.testing.assert_allclose(cut, mesh.vertices, rtol=0, atol=1e-17)


@pytest.mark.parametrize("suffix", [".inp", ".bdf", ".obj"])
@pytest.mark.parametrize("name", ["Zürich\n*NODE", "* $", "x" * 500, ""])
def test_any_name_makes_a_deck(tmp_path: Path, suffix: str, name: str):
    write(replace(grid(), name=name), tmp_path / f"mesh{suffix}")
    assert len(read(tmp_path / f"mesh{suffix}").cells[0].data) == 6
    lines = (tmp_path / f"mesh{suffix}").read_bytes().decode("ascii").splitlines()
    assert sum("6 quadrilaterals of " in line for line in lines) == 1
    assert max(map(len, lines)) <= 80


# ---- what cannot be written ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("mesh.stl", {}, f"unknown format .stl: use one of {', '.join(SUFFIXES)}"),
        ("mesh", {}, f"unknown format (none): use one of {', '.join(SUFFIXES)}"),
        ("mesh.msh", {"version": "4.0"}, "unknown Gmsh version 4.0: use one of 4.1, 2.2"),
        ("mesh.obj", {"quadratic": True}, ".obj holds elements of order 1, not of order 2: write .vtu, .msh,"),
        ("file/mesh.vtu", {}, "nothing can be written to"),
        ("folder.vtu", {}, "is a folder: name a file in it"),
    ],
)
def test_what_cannot_be_written_is_said_in_one_line_and_leaves_nothing(
    tmp_path: Path, name: str, options: dict, message: str
):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.vtu").mkdir()
    with pytest.raises(OutputError) as raised:
        write(grid(), tmp_path / name, **options)
    assert str(raised.value).startswith(f"{tmp_path / name}: {message}")
    assert "\n" not in str(raised.value)
    assert {path.name for path in tmp_path.rglob("*")} == {"file", "folder.vtu"}


def test_an_empty_mesh_is_refused(tmp_path: Path):
    with pytest.raises(OutputError, match="grid has no elements"):
        write(Mesh("grid", np.zeros((4, 2)), np.empty((0, 4), np.int64), np.array([[0, 1]]), False), tmp_path / "a.vtu")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_failure_halfway_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str):
    path = tmp_path / f"mesh{suffix}"
    write(grid(), path)
    before = {item: item.read_bytes() for item in tmp_path.rglob("*") if item.is_file()}

    def fail(target: Path, *_: object) -> None:
        target.write_text("half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", fail)
    with pytest.raises(OutputError, match="No space left on device"):
        write(grid(4, 4), path)
    assert {item: item.read_bytes() for item in tmp_path.rglob("*") if item.is_file()} == before
