"""Physical groups of Gmsh's meshes are names, lines and points inside come in, in both versions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

from envs.domains.load import load_all
from envs.polygons.drawing import Drawing, Reading
from envs.readers import geo_gmsh
from envs.readers.msh import chained, drawing_of_file

needs_gmsh = pytest.mark.skipif(not geo_gmsh.installed(), reason="Gmsh is not installed")

NODES = "$Nodes\n6\n1 0 0 0\n2 1 0 0\n3 2 0 0\n4 2 1 0\n5 1 1 0\n6 0 1 0\n$EndNodes\n"
HEAD = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"
NAMES = '$PhysicalNames\n4\n0 9 "corner"\n1 1 "low side"\n1 2 "middle"\n2 3 "left"\n$EndPhysicalNames\n'
ELEMENTS = [
    "15 2 9 1 3", "1 2 1 1 1 2", "1 2 1 2 2 3", "1 2 2 3 2 5", "3 2 3 1 1 2 5 6", "3 2 7 2 2 3 4 5",
]  # fmt: skip


def read(path: Path, elements: list[str], names: str = NAMES) -> Drawing:
    """A mesh of version 2.2."""
    rows = "".join(f"{i} {row}\n" for i, row in enumerate(elements, 1))
    path.write_text(HEAD + names + NODES + f"$Elements\n{len(elements)}\n{rows}$EndElements\n")
    return drawing_of_file(path, Reading())


def lengths(drawing: Drawing) -> dict[str, float]:
    """The length of the lines of each name."""
    found: dict[str, float] = {}
    for line in drawing.lines:
        found[line.name] = found.get(line.name, 0.0) + shapely.LineString(line.points).length
    return found


def test_groups_are_names(tmp_path: Path) -> None:
    drawing = read(tmp_path / "part.msh", ELEMENTS)
    assert list(drawing.regions) == ["left", "surface_7"]
    assert lengths(drawing) == {"low side": 2.0, "middle": 1.0}
    assert [len(line.points) for line in drawing.lines] == [3, 2]
    assert [(place.x, place.y, place.name) for place in drawing.places] == [(2.0, 0.0, "corner")]
    assert not drawing.notes


def test_groups_without_names_are_called_by_their_numbers(tmp_path: Path) -> None:
    drawing = read(tmp_path / "part.msh", ELEMENTS, names="")
    assert list(drawing.regions) == ["surface_3", "surface_7"]
    assert set(lengths(drawing)) == {"curve_1", "curve_2"}
    assert drawing.places[0].name == "point_9"


def test_without_groups_there_are_no_names(tmp_path: Path) -> None:
    drawing = read(tmp_path / "part.msh", ["3 2 0 1 1 2 5 6", "3 2 0 1 2 3 4 5", "1 2 0 1 1 2"])
    assert (drawing.regions, drawing.lines, drawing.places) == ((), [], [])
    assert len(drawing.polygons) == 1


def test_lines_between_elements_of_one_surface_are_inside(tmp_path: Path) -> None:
    drawing = read(tmp_path / "part.msh", ["3 2 0 1 1 2 5 6", "3 2 0 1 2 3 4 5", "1 2 0 1 2 5", "1 2 0 1 1 2"])
    (line,) = drawing.lines
    assert line.name == ""
    assert sorted(line.points.tolist()) == [[1, 0], [1, 1]]


def test_of_elements_in_several_groups_the_first_names(tmp_path: Path) -> None:
    drawing = read(tmp_path / "part.msh", [*ELEMENTS, "1 2 2 1 1 2", "3 2 7 1 1 2 5 6"])
    assert list(drawing.regions) == ["left", "surface_7"]
    assert lengths(drawing) == {"low side": 2.0, "middle": 1.0}
    assert drawing.notes == [
        "1 elements of curves are in several physical groups; the first names them",
        "1 elements of surfaces are in several physical groups; the first names them",
    ]


def test_lines_alone_are_an_outline_with_names(tmp_path: Path) -> None:
    ring = ["1 2 1 1 1 2", "1 2 1 1 2 3", "1 2 2 2 3 4", "1 2 2 2 4 5", "1 2 2 2 5 6", "1 2 0 3 6 1"]
    drawing = read(tmp_path / "part.msh", ring)
    assert len(drawing.polygons) == 1
    assert lengths(drawing) == {"low side": 2.0, "middle": 3.0}


def test_paths_end_where_others_meet() -> None:
    edges = np.array([[0, 1], [2, 1], [1, 3], [3, 4], [7, 8], [8, 9], [9, 7]])
    paths = chained(edges)
    assert sorted(map(len, paths)) == [2, 2, 3, 4]
    walked = [frozenset(pair) for path in paths for pair in zip(path, path[1:], strict=False)]
    assert sorted(map(sorted, walked)) == sorted(sorted(edge) for edge in edges.tolist())


@needs_gmsh
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("binary", [0, 1])
@pytest.mark.parametrize("version", [2.2, 4.1])
def test_what_gmsh_names_is_named(tmp_path: Path, version: float, binary: int, order: int) -> None:
    import gmsh

    path = tmp_path / "part.msh"
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        occ = gmsh.model.occ
        for x in (0, 2):
            occ.addRectangle(x, 0, 0, 2, 2)
        occ.fragment([(2, 1)], [(2, 2)])
        line = occ.addLine(occ.addPoint(0.5, 0.5, 0), occ.addPoint(1.5, 1.5, 0))
        gauge = occ.addPoint(3, 1, 0)
        occ.synchronize()
        gmsh.model.mesh.embed(1, [line], 2, 1)
        gmsh.model.mesh.embed(0, [gauge], 2, 2)
        between = gmsh.model.getEntitiesInBoundingBox(1.9, -1, -1, 2.1, 3, 1, 1)[0][1]
        right = gmsh.model.getEntitiesInBoundingBox(3.9, -1, -1, 4.1, 3, 1, 1)[0][1]
        for dimension, tags, name in (
            (2, [1], "left"), (2, [2], ""), (1, [between], "between"), (1, [right, between], "walls"),
            (1, [line], "fibre"), (0, [gauge], "gauge"),
        ):  # fmt: skip
            gmsh.model.addPhysicalGroup(dimension, tags, name=name)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(order)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    drawing = drawing_of_file(path, Reading())
    assert sorted(drawing.regions) == ["left", "surface_2"]
    found = lengths(drawing)
    assert found == {"between": pytest.approx(2), "walls": pytest.approx(2), "fibre": pytest.approx(2**0.5)}
    assert [(place.x, place.y, place.name) for place in drawing.places] == [(3, 1, "gauge")]
    assert len(drawing.notes) == 1
    assert [domain.area for domain in load_all(path, fix_parity=True)] == [pytest.approx(4)] * 2
