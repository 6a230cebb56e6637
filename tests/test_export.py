"""Exported files: read back by other readers they are the same mesh, bit for bit."""

from __future__ import annotations

import re
from pathlib import Path

import meshio
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from envs.mesh import Mesh
from envs.quality import element_quality
from freemesh_ray.atomic import OutputError
from freemesh_ray.export import write

FORMATS = [("mesh.vtu", "4.1"), ("mesh.msh", "4.1"), ("mesh.msh", "2.2"), ("mesh.inp", "4.1")]


def grid(columns: int = 3, rows: int = 2, scale: float = 1.0, shift: float = 0.0) -> Mesh:
    """A distorted grid whose coordinates have no short decimals."""
    x, y = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0))
    vertices = np.column_stack([x.ravel(), y.ravel()])
    vertices = (vertices + np.random.default_rng(3).uniform(-0.2, 0.2, vertices.shape)) * scale + shift
    i = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    quads = np.column_stack([i, i + 1, i + columns + 2, i + columns + 1])
    edges, counts = Mesh("", vertices, quads, np.empty((0, 2), np.int64), False).edges
    return Mesh("grid", vertices, quads, edges[counts == 1], True)


def read(path: Path) -> meshio.Mesh:
    if path.suffix != ".inp":
        return meshio.read(path, file_format={".msh": "gmsh", ".vtu": "vtu"}[path.suffix])
    _, nodes, elements, *_ = cards(path.read_text())
    rows = [line.split(", ")[1:] for line in nodes[1:]]
    points = np.array([[float(x), float(y), 0.0] for x, y in rows])
    quads = np.array([line.split(", ")[1:] for line in elements[1:]], dtype=np.int64) - 1
    return meshio.Mesh(points, [("quad", quads)])


def cards(deck: str) -> list[list[str]]:
    """The lines of every keyword of an Abaqus deck, the keyword first."""
    return [card.splitlines() for card in re.split(r"^(?=\*)", deck, flags=re.M)[1:]]


@pytest.mark.parametrize(("name", "version"), FORMATS)
@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(scale=st.floats(1e-6, 1e6), shift=st.floats(-1e3, 1e3))
def test_what_is_read_back_is_the_same_bit_for_bit(tmp_path: Path, name: str, version: str, scale: float, shift: float):
    mesh = grid(scale=scale, shift=shift)
    write(mesh, tmp_path / name, version=version)
    found = read(tmp_path / name)
    assert found.points[:, :2].tobytes() == mesh.vertices.tobytes()
    assert not found.points[:, 2:].any()
    assert [block.type for block in found.cells] == ["quad"]
    assert found.cells[0].data.tolist() == mesh.quads.tolist()
    if not name.endswith(".inp"):
        assert found.cell_data["eta"][0].tobytes() == element_quality(mesh.vertices, mesh.quads).tobytes()


@pytest.mark.parametrize(("name", "version"), FORMATS)
def test_the_same_mesh_gives_the_same_bytes(tmp_path: Path, name: str, version: str):
    for folder in ("a", "b"):
        write(grid(), tmp_path / folder / name, version=version)
    assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_vtk_reads_the_vtu(tmp_path: Path):
    vtk = pytest.importorskip("vtk")
    mesh = grid()
    write(mesh, tmp_path / "mesh.vtu")
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(tmp_path / "mesh.vtu"))
    reader.Update()
    data = reader.GetOutput()
    assert (data.GetNumberOfPoints(), data.GetNumberOfCells()) == (12, 6)
    assert data.GetCellType(0) == vtk.VTK_QUAD
    assert data.GetPoint(5) == (*mesh.vertices[5], 0.0)
    assert data.GetCellData().GetArray("eta").GetNumberOfTuples() == 6


@pytest.mark.parametrize("version", ["4.1", "2.2"])
def test_the_gmsh_version_is_the_one_asked_for(tmp_path: Path, version: str):
    write(grid(), tmp_path / "mesh.msh", version=version)
    assert (tmp_path / "mesh.msh").read_text().split()[:4] == ["$MeshFormat", version, "0", "8"]


def test_the_abaqus_deck_has_what_a_simulation_needs(tmp_path: Path):
    mesh = grid(9, 8)
    write(mesh, tmp_path / "mesh.inp")
    text = (tmp_path / "mesh.inp").read_text()
    _, _, _, nodes, faces = found = cards(text)
    assert [card[0] for card in found] == [
        "*HEADING", "*NODE, NSET=ALL", "*ELEMENT, TYPE=CPE4, ELSET=ALL", "*NSET, NSET=BOUNDARY",
        "*SURFACE, NAME=BOUNDARY, TYPE=ELEMENT",
    ]  # fmt: skip
    assert max(len(line.split(",")) for line in text.splitlines()) <= 16
    assert [int(number) for number in ", ".join(nodes[1:]).split(", ")] == [*np.flatnonzero(mesh.on_boundary) + 1]
    pairs = [line.split(", S") for line in faces[1:]]
    edges = {frozenset((mesh.quads[int(e) - 1, int(f) - 1], mesh.quads[int(e) - 1, int(f) % 4])) for e, f in pairs}
    assert edges == {frozenset(edge) for edge in mesh.segments.tolist()}


def test_abaqus_numbers_survive_a_reader_of_twenty_characters(tmp_path: Path):
    mesh = grid(scale=1e-5)
    write(mesh, tmp_path / "mesh.inp")
    rows = [line.split(", ") for line in (tmp_path / "mesh.inp").read_text().splitlines()[3:15]]
    cut = np.array([[float(number[:20]) for number in row[1:]] for row in rows])
    np.testing.assert_allclose(cut, mesh.vertices, rtol=0, atol=1e-17)


@pytest.mark.parametrize(
    ("name", "version", "message"),
    [
        ("mesh.stl", "4.1", "unknown format .stl: use one of .vtu, .msh, .inp"),
        ("mesh", "4.1", "unknown format (none): use one of .vtu, .msh, .inp"),
        ("mesh.msh", "4.0", "unknown Gmsh version 4.0: use one of 4.1, 2.2"),
        ("file/mesh.vtu", "4.1", "cannot be written"),
        ("folder.vtu", "4.1", "cannot be written"),
    ],
)
def test_what_cannot_be_written_is_said_in_one_line_and_leaves_nothing(
    tmp_path: Path, name: str, version: str, message: str
):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.vtu").mkdir()
    with pytest.raises(OutputError) as raised:
        write(grid(), tmp_path / name, version=version)
    assert str(raised.value).startswith(f"{tmp_path / name}: {message}")
    assert "\n" not in str(raised.value)
    assert {path.name for path in tmp_path.rglob("*")} == {"file", "folder.vtu"}


def test_an_empty_mesh_is_refused(tmp_path: Path):
    with pytest.raises(OutputError, match="grid has no elements"):
        write(Mesh("grid", np.zeros((4, 2)), np.empty((0, 4), np.int64), np.array([[0, 1]]), False), tmp_path / "a.vtu")


def test_a_failure_halfway_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "mesh.vtu"
    write(grid(), path)
    before = path.read_bytes()

    def fail(self: meshio.Mesh, target: Path, **_: object) -> None:
        Path(target).write_text("half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(meshio.Mesh, "write", fail)
    with pytest.raises(OutputError, match="No space left on device"):
        write(grid(4, 4), path)
    assert path.read_bytes() == before
    assert [item.name for item in tmp_path.iterdir()] == ["mesh.vtu"]


def test_an_incomplete_mesh_keeps_all_its_vertices(tmp_path: Path):
    whole = grid(4, 4)
    part = Mesh("part", whole.vertices, whole.quads[:5], whole.segments, False)
    for name, version in FORMATS:
        write(part, tmp_path / name, version=version)
        assert read(tmp_path / name).points[:, :2].tobytes() == whole.vertices.tobytes()


def test_any_name_makes_a_deck(tmp_path: Path):
    mesh = grid()
    write(Mesh("Zürich\n*NODE", mesh.vertices, mesh.quads, mesh.segments, True), tmp_path / "mesh.inp")
    assert (tmp_path / "mesh.inp").read_text().splitlines()[1] == "Z?rich?*NODE: 6 quadrilaterals"
