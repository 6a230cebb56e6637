"""STEP files as Gmsh writes them: faces in any plane, with their holes, shared sides and exact curves."""

from __future__ import annotations

import math
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import shapely

from envs.polygons.drawing import Drawing, Reading
from envs.polygons.exact_curves import CircleArc, EllipseArc, ParametricCurve
from envs.readers import geo_gmsh, step
from envs.types import DomainError

pytestmark = pytest.mark.skipif(find_spec("gmsh") is None, reason="Gmsh is not installed")

#: Makes a STEP file in a process of its own: Gmsh keeps a state, and prints.
MAKER = """
import sys, gmsh
gmsh.initialize(readConfigFiles=False, interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
exec(sys.argv[2])
occ.synchronize()
gmsh.write(sys.argv[1])
"""

PLATE = """
plate, disk, ellipse = occ.addRectangle(0, 0, 0, 10, 5), occ.addDisk(8, 2.5, 0, 1, 1), occ.addDisk(2, 2.5, 0, 1, .5)
p = [occ.addPoint(5 + x, 2.5 + y, 0) for x, y in ((1, 0), (0, 1), (-1, 0), (0, -1))]
spline = occ.addPlaneSurface([occ.addCurveLoop([occ.addBSpline([*p, p[0]])])])
occ.cut([(2, plate)], [(2, disk), (2, ellipse), (2, spline)])
"""

TWO = """
left, right, disk = occ.addRectangle(0, 0, 0, 2, 1), occ.addRectangle(2, 0, 0, 2, 1), occ.addDisk(2, .5, 0, .25, .25)
occ.fragment([(2, left), (2, right)], [(2, disk)])
"""


def made(path: Path, code: str) -> Path:
    """A STEP file."""
    subprocess.run([sys.executable, "-c", MAKER, str(path), code], check=True, stdout=subprocess.DEVNULL)
    return path


def read(path: Path, edge_length: float | None = None) -> Drawing:
    """What it states."""
    return step.drawing_of_file(path, Reading(edge_length=edge_length))


def areas(found: Drawing) -> list[float]:
    """Areas of its polygons, in ascending order."""
    return sorted(shapely.Polygon(rings[0], rings[1:]).area for rings in found.polygons)


def test_a_face_keeps_its_curves(tmp_path: Path) -> None:
    found = read(made(tmp_path / "part.step", PLATE), edge_length=0.1)
    (rings,) = found.polygons
    assert len(rings) == 4
    assert {tuple(corner) for corner in np.asarray(rings[0]).tolist()} == {(0, 0), (10, 0), (10, 5), (0, 5)}
    curves = {type(line.curve): line for line in found.lines}
    assert set(curves) == {CircleArc, EllipseArc, ParametricCurve}
    circle = curves[CircleArc].curve
    assert isinstance(circle, CircleArc)
    assert circle.radius == pytest.approx(1, rel=1e-12)
    for line in found.lines:
        assert line.curve is not None
        np.testing.assert_allclose(line.curve.at(line.curve.nearest(line.points)), line.points, atol=1e-8)
    spline = shapely.Polygon(curves[ParametricCurve].points).area
    assert areas(found) == pytest.approx([50 - math.pi * 1.5 - spline], rel=1e-3)
    assert found.notes == ["lengths are millimetres, as they are read from STEP"]


@pytest.mark.parametrize(
    ("turn", "note"),
    [
        ("occ.rotate(occ.getEntities(2), 0, 0, 0, 1, 0, 0, 1.5707963267948966)", "faces in the x, z plane are read"),
        ("occ.rotate(occ.getEntities(2), 0, 0, 0, 1, 2, 3, 1)", "faces in a slanted plane are read in coordinates"),
        ("occ.translate(occ.getEntities(2), 0, 0, 7)", "lengths are millimetres"),
    ],
)
def test_faces_share_their_sides_in_any_plane(tmp_path: Path, turn: str, note: str) -> None:
    found = read(made(tmp_path / "part.stp", TWO + turn), edge_length=0.05)
    half = math.pi / 32
    assert areas(found) == pytest.approx([half, half, 2 - half, 2 - half], rel=5e-3)
    assert found.notes[0].startswith(note)
    rings = [np.asarray(rings[0]) for rings in found.polygons]
    owners: dict[bytes, int] = {}
    for ring in rings:
        for point in ring:
            owners[point.tobytes()] = owners.get(point.tobytes(), 0) + 1
    shared = [n for n in owners.values() if n > 1]
    assert len(shared) > 2 * 15, "the arcs' vertices are those of two faces, number for number"


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("occ.addBox(0, 0, 0, 1, 2, 3)", "a solid; save the one face of it"),
        ("occ.addRectangle(0, 0, 0, 1, 1); occ.addRectangle(0, 0, 1, 1, 1)", "faces in several planes"),
        ("occ.addLine(occ.addPoint(0, 0, 0), occ.addPoint(1, 0, 0))", "no face in it"),
        ("d = occ.extrude([(1, occ.addCircle(0, 0, 0, 1))], 0, 0, 1)", "is no plane; save plane faces alone"),
    ],
)
def test_what_is_no_plane_face_is_one_line(tmp_path: Path, code: str, message: str) -> None:
    with pytest.raises(DomainError, match=message):
        read(made(tmp_path / "part.step", code))


def test_broken_files_are_one_line(tmp_path: Path) -> None:
    path = made(tmp_path / "part.step", PLATE)
    content = path.read_bytes()
    for broken, message in (
        (b"", "the file is empty"),
        (b"plate", "not a STEP file"),
        (content[:3000], "Gmsh says: "),
        (content[: len(content) // 2], "Gmsh says: |no face in it"),
    ):
        path.write_bytes(broken)
        with pytest.raises(DomainError, match=message) as caught:
            read(path)
        assert str(caught.value).startswith(f"{path}: ")
        assert "\n" not in str(caught.value)
        assert "/tmp/freemesh" not in str(caught.value)


def test_without_gmsh_the_line_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(geo_gmsh, "find_spec", lambda name: None)
    with pytest.raises(DomainError, match="STEP is read by Gmsh; pip install gmsh"):
        read(tmp_path / "part.step")


def test_names_that_programs_give_are_none() -> None:
    assert step.name_of("Shapes/Open CASCADE STEP translator 7.8 1/1/Open CASCADE STEP translator 7.8 1.1") == ""
    assert step.name_of("Shapes/Plate") == "Plate"
    assert step.name_of("") == ""
    assert step.name_of("Shapes/Part/1.2") == ""
