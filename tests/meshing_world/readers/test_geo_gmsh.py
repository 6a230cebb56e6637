"""Scripts that Gmsh reads for us: what it is given, what it may do, and that it says what we read ourselves."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import shapely

from envs.domains.load import load, load_all
from envs.polygons.drawing import Drawing, Reading
from envs.polygons.exact_curves import CircleArc, EllipseArc, ParametricCurve
from envs.readers import geo, geo_gmsh, gmsh_program
from envs.readers.geo_gmsh import safe_script
from envs.readers.geo_statements import model_of
from envs.types import DomainError

needs_gmsh = pytest.mark.skipif(not geo_gmsh.installed(), reason="Gmsh is not installed")

OCC = 'SetFactory("OpenCASCADE");\n'

#: Scripts that both read; the language and what is drawn.
BOTH = {
    "lines": "lc = .3;\nFor i In {0:3}\n Point(i+1) = {(i % 3) > 0, i > 1, 0, lc};\nEndFor\n"
    "For i In {1:4}\n Line(i) = {i, i % 4 + 1};\nEndFor\nCurve Loop(1) = {4, 2, 1, 3}; Plane Surface(1) = {1};\n"
    'Physical Curve("low", 4) = {1, 2}; Physical Curve(9) = {3}; Physical Surface("all") = {Surface{:}};\n'
    'Point(9) = {.2, .3, 0}; Point(10) = {.7, .3, 0}; Line(9) = {9, 10}; Line{9} In Surface{1}; Point{9} In Surface{1};'
    'Physical Point("gauge") = {9};',
    "arcs": "Point(1)={0,0,0}; Point(2)={2,0,0}; Point(3)={0,2,0}; Point(4)={-2,0,0}; Point(5)={0,-1,0};\n"
    "Circle(1)={2,1,3}; Circle(2)={3,1,4}; Ellipse(3)={4,1,2,5}; Ellipse(4)={5,1,4,2}; Curve Loop(1)={1:4};\n"
    'Plane Surface(1)={1}; Physical Curve("round")={1,2}; Physical Curve("flat")={3,4};',
    "splines": "Point(1)={0,0,0}; Point(2)={2,-.5,0}; Point(3)={4,1,0}; Point(4)={3,2,0}; Point(5)={0,3,0};\n"
    "Spline(1)={1,2,3}; BSpline(2)={3,4,5}; Bezier(3)={5,4,2,1}; Curve Loop(1)={1:3}; Plane Surface(1)={1};",
    "copies": "Point(1)={0,0,0}; Point(2)={1,0,0}; Point(3)={1,1,0}; Line(1)={1,2}; Line(2)={2,3}; Line(3)={3,1};\n"
    "Curve Loop(1)={1:3}; Plane Surface(7)={1}; s() = Symmetry {1,0,0,-1} { Duplicata { Surface{7}; } };\n"
    "t() = Rotate {{0,0,1},{0,0,0},Pi/2} { Duplicata { Surface{7, s()}; } }; Translate {0,5,0} { Surface{t()}; }\n"
    'Physical Surface("first") = {7}; Physical Surface("second") = {s()}; Physical Surface("others") = {t()};\n'
    'Physical Curve("rest") = {Boundary{ Surface{t(0)}; }}; n = newreg; Point(newp) = {0,1,0}; Line(n) = {1,newp-1};',
    "macros": "Macro Bore\n c = newp; Point(c)={x,1,0}; Point(c+1)={x+r,1,0}; Point(c+2)={x,1+r,0};\n"
    "Point(c+3)={x-r,1,0};\n"
    "l = newl; Circle(l)={c+1,c,c+2}; Circle(l+1)={c+2,c,c+3}; Circle(l+2)={c+3,c,c+1};\n"
    "loops[] += newll; Curve Loop(newll)={l:l+2}; Physical Curve(Sprintf(\"hole %g\", x))={l:l+2};\nReturn\n"
    "Point(1)={0,0,0}; Point(2)={5,0,0}; Point(3)={5,2,0}; Point(4)={0,2,0};\n"
    "Line(1)={1,2}; Line(2)={2,3}; Line(3)={3,4}; Line(4)={4,1}; loops[]={newll}; Curve Loop(newll)={1:4}; r=.3;\n"
    "For x In {1:4:1.5}\n If (x != 4)\n Call Bore;\n EndIf\nEndFor\nPlane Surface(news)={loops[]};",
}  # fmt: skip


def drawn(path: Path, reader: Callable[[Path], object], monkeypatch: pytest.MonkeyPatch) -> Drawing:
    """A drawing whose model comes from a reader."""
    monkeypatch.setattr(geo, "read", reader)
    return geo.drawing_of_file(path, Reading(0.05))


def summary(drawing: Drawing) -> object:
    """What is to be the same, but for how finely curves are flattened."""
    lengths: dict[str, float] = {}
    for line in drawing.lines:
        lengths[line.name] = lengths.get(line.name, 0.0) + shapely.LineString(line.points).length
    places = sorted((round(place.x, 9), round(place.y, 9), place.name) for place in drawing.places)
    areas = [shapely.Polygon(rings[0], rings[1:]).area for rings in drawing.polygons]
    return (
        [pytest.approx(area, rel=1e-4) for area in areas], drawing.regions, places,
        {name: pytest.approx(length, rel=1e-4) for name, length in lengths.items()},
        sorted(type(line.curve).__name__ for line in drawing.lines),
    )  # fmt: skip


@needs_gmsh
@pytest.mark.parametrize("text", BOTH.values(), ids=BOTH.keys())
def test_gmsh_reads_what_we_read(tmp_path: Path, text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "part.geo"
    path.write_text(text)
    ours, theirs = (drawn(path, reader, monkeypatch) for reader in (model_of, geo_gmsh.model_of))
    kinds = [line.curve for line in theirs.lines if isinstance(line.curve, ParametricCurve)]
    assert summary(ours) == summary(theirs)
    for curve, line in zip(
        kinds, [line for line in ours.lines if isinstance(line.curve, ParametricCurve)], strict=True
    ):
        on = curve.at(curve.nearest(line.points))
        np.testing.assert_allclose(on, line.points, atol=1e-8)


#: Scripts that Gmsh alone reads, and their area.
THEIRS = {
    "a rectangle": (OCC + "Rectangle(1) = {0,0,0,2,1};", 2.0),
    "a round one": (OCC + "Rectangle(1) = {0,0,0,2,1, .25};", 2 - (4 - np.pi) / 16),
    "a disc": (OCC + "Disk(1) = {1,1,0,2};", 4 * np.pi),
    "an ellipse": (OCC + "Disk(1) = {1,1,0,2,1}; Rotate {{0,0,1},{1,1,0},.3} { Surface{1}; }", 2 * np.pi),
    "a difference": (
        OCC + "Rectangle(1) = {0,0,0,4,4}; Disk(2) = {2,2,0,1}; BooleanDifference{ Surface{1}; Delete; }"
        "{ Surface{2}; Delete; }", 16 - np.pi),
    "a union": (
        OCC + "Rectangle(1) = {0,0,0,2,1}; Rectangle(2) = {1,0,0,2,1}; BooleanUnion{ Surface{1}; Delete; }"
        "{ Surface{2}; Delete; }", 3.0),
    "an extrusion": ("Point(1) = {0,0,0}; Point(2) = {1,0,0}; Line(1) = {1,2}; Extrude {0,3,0} { Curve{1}; }", 3.0),
    "a whole circle": (OCC + "Circle(1) = {0,0,0,1}; Curve Loop(1) = {1}; Plane Surface(1) = {1};", np.pi),
    "a part of one": (
        OCC + "Circle(1) = {0,0,0,1, 0, 3*Pi/2}; Point(9) = {0,0,0}; Line(2) = {1,9}; Line(3) = {9,2};"
        "Curve Loop(1) = {1,3,2}; Plane Surface(1) = {1};", 0.75 * np.pi),
}  # fmt: skip


@needs_gmsh
@pytest.mark.parametrize(("text", "area"), THEIRS.values(), ids=THEIRS.keys())
def test_shapes_of_gmsh(tmp_path: Path, text: str, area: float) -> None:
    path = tmp_path / "part.geo"
    path.write_text(text)
    assert load(path, edge_length=0.02).area == pytest.approx(area, rel=1e-3)


@needs_gmsh
def test_parts_and_names_of_gmsh(tmp_path: Path) -> None:
    path = tmp_path / "part.geo"
    path.write_text(
        OCC + "Rectangle(1) = {0,0,0,2,2}; Disk(2) = {2,1,0,.5}; BooleanFragments{ Surface{1}; Delete; }"
        "{ Surface{2}; Delete; }\n"
        'left() = Curve In BoundingBox {-.1,-.1,-.1,.1,2.1,.1}; Physical Curve("left") = left();\n'
        "MeshSize{ PointsOf{ Surface{:}; } } = .2;\n"
        'Physical Surface("plate", 5) = {Surface In BoundingBox {-.1,-.1,-.1,2.1,2.1,.1}}; Physical Surface(6) = {3};'
    )
    drawing = geo.drawing_of_file(path, Reading(0.1))
    assert len(drawing.polygons) == 3
    assert set(drawing.regions) >= {"plate"}
    (left,) = [line for line in drawing.lines if line.name == "left"]
    assert sorted(left.points.tolist()) == [[0, 0], [0, 2]]
    assert any(isinstance(line.curve, CircleArc) for line in drawing.lines)
    sizes = geo.sizes_of_file(path)
    assert sizes is not None
    assert set(sizes[:, 2]) == {0.2}
    one, *others = load_all(path, edge_length=0.1)
    assert all({tuple(p) for p in one.points.tolist()} & {tuple(p) for p in d.points.tolist()} for d in others[:1])


@needs_gmsh
def test_circles_and_ellipses_of_gmsh_are_exact(tmp_path: Path) -> None:
    path = tmp_path / "part.geo"
    path.write_text(OCC + "Disk(1) = {0,0,0,1}; Disk(2) = {5,1,0,2,1}; Rotate {{0,0,1},{5,1,0},1} { Surface{2}; }")
    circle, ellipse = (line.curve for line in geo.drawing_of_file(path, Reading(0.1)).lines)
    assert isinstance(circle, CircleArc)
    assert isinstance(ellipse, EllipseArc)
    np.testing.assert_allclose(circle.centre, [0, 0], atol=1e-14)
    assert circle.radius == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_allclose(sorted([np.hypot(*ellipse.major), np.hypot(*ellipse.minor)]), [1, 2], rtol=1e-12)


BAD = {
    "a solid": (OCC + "Box(1) = {0,0,0,1,1,1};", "a solid; give plane surfaces alone"),
    "no surface": (OCC + "Circle(1) = {0,0,0,1};", "no surface; give one in the x, y plane"),
    "upright": (OCC + "Disk(1) = {0,0,0,1}; Rotate {{1,0,0},{0,0,0},1} { Surface{1}; }", "leaves the x, y plane"),
    "wrong": (OCC + "Disk(1) = {0,0,0,1};\nDisk(1) = {0,0,0,2};", "Gmsh says: .*; correct the script"),
    "syntax": (OCC + "Disk(1) = {0,0,0,1};\nDisk(2) = = {0};", "Gmsh says: line 3: syntax error"),
}  # fmt: skip


@needs_gmsh
@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD.keys())
def test_what_gmsh_finds_wrong_is_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "part.geo"
    path.write_text(text)
    with pytest.raises(DomainError, match=message) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    assert "freemesh-geo" not in str(caught.value)


REFUSED = {
    "a program": 'SystemCall "touch {0}";', "one in the background": 'NonBlockingSystemCall "touch {0}";',
    "another": 'System StrCat("touch ", "{0}");',
    "a file": 'Merge "part.step";', "a shape file": 'ShapeFromFile("{0}");',
    "numbers of a file": "a() = ListFromFile['{0}'];", "the environment": 'a = GetEnv("HOME");',
    "a name from a text": 'StringToName["SystemCall"] "touch {0}";', "a client": 'OnelabRun("x", "touch {0}");',
    "an unknown command": 'Whatever "{0}";', "a command by a number": "Whatever 3;",
    "a command that is set before": 'Whatever = 1; Whatever "{0}";', "a file outside": 'Include "../{0}";',
    "a refused word that is set": "SystemCall = 1;", "what hides in a text": '"' + "a" * 1100 + '";',
    "a zero": 'a = "\0";', "a command in a loop": 'For i In {{1:2}} SystemCall "touch {0}"; EndFor',
    "a command after a macro": 'Macro A SystemCall "touch {0}"; Return Call A;',
}  # fmt: skip


@pytest.mark.parametrize("text", REFUSED.values(), ids=REFUSED.keys())
def test_what_is_not_geometry_is_not_given_to_gmsh(tmp_path: Path, text: str) -> None:
    path = tmp_path / "part.geo"
    path.write_text(OCC + "Rectangle(1) = {0,0,0,2,1};\n" + text.format("made.txt"))
    with pytest.raises(DomainError, match=r"part\.geo: line 3: "):
        safe_script(path)


LEFT_OUT = [
    'Save "made.msh";', 'Print "made.png";', 'Printf("x") > "made.txt";', 'Printf("x") >> "made.txt";', "Mesh 2;",
    "Mesh.Algorithm = 6;", 'General.LogFile = "made.txt";', "Field[1] = Distance; Background Field = 1;",
    "Plugin(Crack).Run;", 'Merge "sizes.pos";', 'View "x" { SP(0,0,0){1}; };', "Geometry.LineWidth = 3;",
    'CreateDir "made";', "Transfinite Curve {:} = 5;", "// a comment", "/* another\n */", "Error('x');",
]  # fmt: skip


@pytest.mark.parametrize("text", LEFT_OUT)
def test_what_leaves_the_geometry_as_it_is_is_left_out(tmp_path: Path, text: str) -> None:
    path = tmp_path / "part.geo"
    path.write_text(OCC + f"{text}\n Disk(1) = {{0,0,0,1}};\n{text}\n")
    kept = " ".join(safe_script(path).split())
    assert kept == 'SetFactory ( "OpenCASCADE" ) ; Disk ( 1 ) = { 0 , 0 , 0 , 1 } ;'


def test_included_files_are_written_in(tmp_path: Path) -> None:
    (tmp_path / "more.geo").write_text('a = 3;\nSave "x.msh";\n')
    path = tmp_path / "part.geo"
    path.write_text('b = 1;\nInclude "more.geo";\nc = 2;')
    assert safe_script(path) == " b = 1 ;\n a = 3 ;\n c = 2 ;\n"
    (tmp_path / "more.geo").write_text('\nSystemCall "ls";')
    with pytest.raises(DomainError, match=r"more\.geo, line 2: 'SystemCall' is not given to Gmsh"):
        safe_script(path)


@needs_gmsh
@pytest.mark.parametrize("text", [
    'Printf("x") > "{0}";', 'SystemCall "touch {0}";', 'SystemCall "/bin/touch {0}";', 'Save "{0}";',
    'NonBlockingSystemCall "touch {0}";', "a() = ListFromFile['/etc/hostname'];", 'Merge "/etc/hostname";',
    'Include "/etc/hostname";', 'Print "{0}";',
])  # fmt: skip
def test_gmsh_can_do_nothing_to_files(tmp_path: Path, text: str) -> None:
    """The second wall: even a script as it is."""
    made = tmp_path / "made.txt"
    script = tmp_path / "raw.geo"
    script.write_text(OCC + "Rectangle(1) = {0,0,0,2,1};\n" + text.format(made))
    spec = find_spec("gmsh")
    assert spec is not None
    assert spec.origin is not None
    done = subprocess.run(
        [sys.executable, "-I", "-S", gmsh_program.__file__, spec.origin, str(script)], capture_output=True, check=False,
        env={"OMP_NUM_THREADS": "1", "LD_LIBRARY_PATH": os.environ.get("LD_LIBRARY_PATH", "")}, cwd=tmp_path,
    )  # fmt: skip
    if done.stdout:
        found = json.loads(done.stdout)
        assert "error" in found or "SystemCall" in text
    assert [path.name for path in tmp_path.iterdir()] == ["raw.geo"]


@needs_gmsh
def test_gmsh_has_little_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(geo_gmsh, "DEADLINE", 3.0)
    path = tmp_path / "part.geo"
    path.write_text(OCC + "Disk(1) = {0,0,0,1}; \nFor i In {0:1e9}\n a = i;\nEndFor")
    with pytest.raises(DomainError, match="Gmsh took more than 3 s; simplify the script"):
        load(path)


def test_without_gmsh_the_message_says_what_installs_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(geo_gmsh, "installed", lambda: False)
    path = tmp_path / "part.geo"
    path.write_text(OCC + "Rectangle(1) = {0,0,0,2,1};")
    with pytest.raises(DomainError, match=r"line 2: 'Rectangle' is not understood here; pip install 'freemesh-ray\[gm"):
        load(path)


def test_splines_of_opencascade_are_noted_without_gmsh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(geo_gmsh, "installed", lambda: False)
    path = tmp_path / "part.geo"
    path.write_text(OCC + BOTH["splines"])
    assert "line 3: splines of OpenCASCADE's are read as Gmsh's own" in geo.drawing_of_file(path, Reading()).notes[0]
