"""Gmsh meshes: the boundary that Gmsh and meshio wrote comes back, in every version, and nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from envs.domains.load import load, load_all
from envs.types import DomainError

SQUARE = [[0.0, 0.0], [4.1, 0.0], [4.1, 4.3], [0.0, 4.3]]
HOLE = [[1.0, 1.0], [1.0, 2.0], [2.0, 2.0], [2.0, 1.0]]
POINTS = np.array([*SQUARE, *HOLE, [9.0, 9.0]]) * np.pi / 3
LINES = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4]])
QUADS = np.array([[0, 1, 7, 4], [1, 2, 6, 7], [2, 3, 5, 6], [3, 0, 4, 5]])


def written(folder: Path, cells: list[tuple[str, Any]], version: str, binary: bool) -> Path:
    """A mesh as meshio writes it."""
    path = folder / "part.msh"
    points = np.column_stack([POINTS, np.zeros(len(POINTS))])
    mesh = meshio.Mesh(points, cells)
    mesh.cell_data = {
        name: [np.ones(len(block), dtype=np.int32) for _, block in cells]
        for name in ("gmsh:physical", "gmsh:geometrical")
    }
    mesh.point_data = {"gmsh:dim_tags": np.tile([2, 1], (len(points), 1))}
    meshio.gmsh.write(path, mesh, fmt_version=version, binary=binary)
    return path


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("version", ["2.2", "4.1"])
@pytest.mark.parametrize("cells", [[("line", LINES)], [("quad", QUADS)], [("line", LINES), ("quad", QUADS)]])
def test_the_boundary_comes_back(tmp_path: Path, cells: list[tuple[str, Any]], version: str, binary: bool) -> None:
    domain = load(written(tmp_path, cells, version, binary))
    expected = {tuple(p) for p in POINTS[:8].tolist()}
    assert {tuple(p) for p in domain.points[:8].tolist()} == expected
    assert domain.area == pytest.approx((4.1 * 4.3 - 1.0) * (np.pi / 3) ** 2)
    assert len(domain.segments) == 8


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("binary", [0, 1])
@pytest.mark.parametrize("version", [2.2, 4.1])
def test_meshes_of_gmsh(tmp_path: Path, version: float, binary: int, order: int) -> None:
    gmsh = pytest.importorskip("gmsh")
    path = tmp_path / "plate.msh"
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        left = gmsh.model.occ.addRectangle(0, 0, 0, 2, 2)
        hole = gmsh.model.occ.addDisk(1, 1, 0, 0.5, 0.5)
        gmsh.model.occ.cut([(2, left)], [(2, hole)])
        gmsh.model.occ.addRectangle(2, 0, 0, 1, 2)
        gmsh.model.occ.fragment(gmsh.model.occ.getEntities(2), [])
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.3)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(order)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    plate, strip = sorted(load_all(path, fix_parity=True), key=lambda d: -d.area)
    assert plate.area == pytest.approx(4 - np.pi / 4, rel=0.02)
    assert strip.area == pytest.approx(2)
    walls = [{p for p in map(tuple, d.points.tolist()) if p[0] == 2.0 and 0 <= p[1] <= 2} for d in (plate, strip)]
    assert walls[0] == walls[1]
    assert len(walls[0]) >= 7


def test_curved_lines_go_through_their_middle_nodes(tmp_path: Path) -> None:
    points = np.array([[0, 0, 0], [2, 0, 0], [1, 2, 0], [1, -0.2, 0], [1.8, 1.2, 0], [0.2, 1.2, 0]], dtype=float)
    path = tmp_path / "part.msh"
    cells = [("line3", np.array([[0, 1, 3], [1, 2, 4], [2, 0, 5]]))]
    meshio.gmsh.write(path, meshio.Mesh(points, cells), fmt_version="2.2", binary=False)
    np.testing.assert_array_equal(load(path).points, points[[0, 3, 1, 4, 2, 5], :2])


NODES = "$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n$EndNodes\n"
HEAD = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"
RING = "$Elements\n4\n1 1 2 0 1 1 2\n2 1 2 0 1 2 3\n3 1 2 0 1 3 4\n4 1 2 0 1 4 1\n$EndElements\n"


def test_tags_need_not_be_in_order_nor_small(tmp_path: Path) -> None:
    path = tmp_path / "part.msh"
    text = (HEAD + NODES + RING).replace("\n3 1 1 0", "\n2147483646 1 1 0")
    path.write_text(text.replace(" 2 3\n", " 2 2147483646\n").replace(" 3 4\n", " 2147483646 4\n"))
    assert load(path).area == 1.0


BAD = {
    "nothing": ("nothing", "no .MeshFormat"),
    "version": ("$MeshFormat\n1 0 8\n$EndMeshFormat\n" + NODES + RING, "version 1; 2.2 and 4.1 are read"),
    "no nodes": (HEAD + RING, "no .Nodes section"),
    "cut": ((HEAD + NODES + RING)[:-20], "no .Elements section"),
    "count": (HEAD + NODES.replace("4\n1 ", "400\n1 ") + RING, "ends too early"),
    "negative": (HEAD + NODES.replace("4\n1 ", "-4\n1 ") + RING, "negative count"),
    "node": (HEAD + NODES + RING.replace(" 3 4\n", " 3 9\n"), "an element of a node that does not exist"),
    "type": (HEAD + NODES + RING.replace("4 1 2 0", "4 4 2 0"), "elements of type 4; lines, triangles"),
    "open": (HEAD + NODES + RING.replace("4\n1 1", "3\n1 1"), r"a curve ends at \(0.0, 0.0\) and no other begins"),
    "tilted": (HEAD + NODES.replace("1 1 0\n", "1 1 5\n") + RING, "heights from 0 to 5; give a mesh in the x, y"),
    "nan": (HEAD + NODES.replace("1 1 0\n", "nan 1 0\n") + RING, "not finite"),
    "empty": (HEAD + NODES + "$Elements\n0\n$EndElements", "no line and no surface elements"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD.keys())
def test_bad_meshes(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "part.msh"
    path.write_text(text)
    with pytest.raises(DomainError, match=message) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
