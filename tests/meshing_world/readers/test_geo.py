"""Gmsh scripts: the outlines are Gmsh's own, where Gmsh is installed to say what they are."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from envs.domains.load import load, load_all
from envs.types import DomainError, Floats

PLATE = """
// a plate with a hole
SetFactory("Built-in");
lc = 0.5; w = 4*lc + 2; h = Sqrt(9) ^ 1;   /* numbers */
Point(1) = {0, 0, 0, lc};
Point(2) = {w, 0, 0, lc};
Point(3) = {w, h, 0, lc};
Point(4) = {0, h, 0, lc};
For_you = 1;
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
p0 = newp; Point(newp) = {1, 1, 0}; Point(newp) = {1, 2, 0}; Point(newp) = {2, 2, 0}; Point(newp) = {2, 1, 0};
Line(11) = {p0, p0+1}; Line(12) = {p0+1, p0+2}; Line(13) = {p0+2, p0+3}; Line(14) = {p0+3, p0};
Curve Loop(1) = {1:4};
Line Loop(2) = {-14, -13, -12, -11};
Plane Surface(1) = {1, 2};
Physical Surface("plate", 7) = {1};
Transfinite Surface {1} = {1, 2, 3, 4} Right;
Mesh.Algorithm = 8;
Recombine Surface {1};
"""

DISC = """
r = 2;
Point(1) = {0, 0, 0}; Point(2) = {r, 0, 0}; Point(3) = {0, r, 0}; Point(4) = {-r, 0, 0}; Point(5) = {0, -r, 0};
Circle(1) = {2, 1, 3}; Circle(2) = {3, 1, 4}; Circle(3) = {4, 1, 5}; Circle(4) = {5, 1, 2};
Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1};
"""


def written(folder: Path, text: str) -> Path:
    """A script as a file."""
    path = folder / "part.geo"
    path.write_text(text)
    return path


def test_a_plate_with_a_hole(tmp_path: Path) -> None:
    domain = load(written(tmp_path, PLATE))
    assert domain.name == "part"
    np.testing.assert_array_equal(domain.points[:4], [[0, 0], [4, 0], [4, 3], [0, 3]])
    assert domain.area == 11.0
    assert load(written(tmp_path, PLATE), edge_length=0.5).segments.shape == (28 + 8, 2)


@pytest.mark.parametrize("cut", ["Plane Surface", "Curve Loop"])
def test_without_surfaces_or_loops_what_lies_inside_is_a_hole(tmp_path: Path, cut: str) -> None:
    text = PLATE[: PLATE.index(cut)]
    assert load(written(tmp_path, text)).area == 11.0


def test_arcs_are_round(tmp_path: Path) -> None:
    domain = load(written(tmp_path, DISC), edge_length=0.1)
    assert len(domain.ring) == 126
    np.testing.assert_allclose(np.linalg.norm(domain.points, axis=1), 2.0, rtol=2e-4)
    coarse = load(written(tmp_path, DISC))
    np.testing.assert_allclose(np.linalg.norm(coarse.points, axis=1), 2.0, rtol=1e-14)
    assert coarse.area == pytest.approx(4 * math.pi, rel=0.01)


def test_transfinite_counts_are_kept_unless_a_length_is_given(tmp_path: Path) -> None:
    text = PLATE + "Transfinite Curve {1, -3} = 5 Using Progression 2;\nTransfinite Line {11:14} = 3;"
    domain = load(written(tmp_path, text))
    assert len(domain.segments) == 4 + 1 + 4 + 1 + 8
    bottom = np.sort(domain.points[domain.points[:, 1] == 0.0, 0])
    np.testing.assert_allclose(np.diff(bottom), 4 * np.array([1, 2, 4, 8]) / 15)
    top = np.sort(domain.points[domain.points[:, 1] == 3.0, 0])
    np.testing.assert_allclose(top, bottom, err_msg="the curve and the progression are both turned round")
    assert len(load(written(tmp_path, text), edge_length=1.0).segments) == 14 + 4


def test_two_surfaces_share_their_curve(tmp_path: Path) -> None:
    text = DISC.replace("Curve Loop(1) = {1, 2, 3, 4};", "Spline(9) = {3, 1, 5}; Curve Loop(1) = {1, 9, 4};")
    text += "Curve Loop(2) = {2, 3, -9}; Plane Surface(2) = {2};"
    right, left = load_all(written(tmp_path, text), edge_length=0.15)
    shared = {tuple(p) for p in right.points.tolist()} & {tuple(p) for p in left.points.tolist()}
    assert len(shared) == round(4 / 0.15) + 2, "the odd segment breaks no symmetry on what both share"
    assert all(x == 0.0 for x, _ in shared)


SPLINES = {
    "spline": "Spline(1) = {1, 2, 3, 4, 5};",
    "b-spline": "BSpline(1) = {1, 2, 3, 4, 5};",
    "bezier": "Bezier(1) = {1, 2, 3, 4};Line(3) = {4, 5};",
    "ellipse": "Point(9) = {4, 0, 0}; Point(8) = {1, 0, 0}; Ellipse(1) = {1, 9, 8, 5};",
    "b-spline of three": "BSpline(1) = {1, 3, 5};",
    "closed b-spline": "BSpline(1) = {1, 2, 3, 4, 5, 6, 1};",
    "closed spline": "Spline(1) = {1, 2, 3, 4, 5, 6, 1};",
}


@pytest.mark.parametrize("curve", SPLINES.values(), ids=SPLINES.keys())
def test_curves_are_those_of_gmsh(tmp_path: Path, curve: str) -> None:
    gmsh = pytest.importorskip("gmsh")
    points = [(0, 0), (1, -1), (2, 0.5), (4, -1), (4, 2), (1, 3)]
    text = "".join(f"Point({i}) = {{{x}, {y}, 0}};\n" for i, (x, y) in enumerate(points, 1)) + curve
    closing = "" if "6, 1" in curve else "Line(2) = {5, 1};"
    tags = "1, 3, 2" if "Line(3)" in curve else "1, 2" if closing else "1"
    path = written(tmp_path, f"{text} {closing} Curve Loop(1) = {{{tags}}}; Plane Surface(1) = {{1}};\n")
    domain = load(path, edge_length=0.01)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(path))
        low, high = gmsh.model.getParametrizationBounds(1, 1)
        there = np.array(gmsh.model.getValue(1, 1, np.linspace(low[0], high[0], 4001))).reshape(-1, 3)[:, :2]
    finally:
        gmsh.finalize()
    ring = shapely.LinearRing(domain.points)
    assert shapely.distance(ring, shapely.points(there)).max() < 2e-4
    assert shapely.distance(shapely.LineString(there), shapely.points(on_the_curve(domain.points, points))).max() < 2e-4


def on_the_curve(ring: Floats, points: list[tuple[float, float]]) -> Floats:
    """The vertices of a ring that are not on the straight lines that close it."""
    lines = shapely.MultiLineString([[points[4], points[0]], [points[3], points[4]]])
    return ring[shapely.distance(lines, shapely.points(ring)) > 1e-9]


@pytest.mark.parametrize(("expression", "value"), [
    ("-2^2", -4.0), ("2^-1", 0.5), ("2^3^2", 512.0), ("1 - 2 - 3", -4.0), ("2 * (3 + 4) / 7", 2.0), ("7 % 4", 3.0),
    ("Cos[Pi]", -1.0), ("Hypot(3, 4)", 5.0), (".5e1", 5.0), ("+-+3.", -3.0), ("Atan2(0, 1)", 0.0),
])  # fmt: skip
def test_expressions(tmp_path: Path, expression: str, value: float) -> None:
    text = f"v = {expression}; Point(1)={{v,0,0}}; Point(2)={{v+9,0,0}}; Point(3)={{v+9,5,0}}; Point(4)={{v,5,0}};"
    text += "Line(1)={1,2};Line(2)={2,3};Line(3)={3,4};Line(4)={4,1};"
    assert load(written(tmp_path, text)).points[0, 0] == pytest.approx(value, abs=1e-12)


SQUARE_LINES = "Point(1)={0,0,0};Point(2)={9,0,0};Point(3)={9,5,0};Point(4)={0,5,0};" + "".join(
    f"Line({i})={{{i},{i % 4 + 1}}};" for i in range(1, 5)
)


@pytest.mark.parametrize("listed", ["1:4", "1 ... 4", "1...4", "1, 2 ... 3, 4", "1:4:1", "1., 2 ... 4."])
def test_ranges_are_written_out(tmp_path: Path, listed: str) -> None:
    domain = load(written(tmp_path, f"{SQUARE_LINES}Curve Loop(1)={{{listed}}};Plane Surface(1)={{1}};"))
    assert domain.area == 45.0
    assert len(domain.segments) == 4


def test_comments_may_be_in_any_encoding(tmp_path: Path) -> None:
    path = tmp_path / "latin.geo"
    path.write_bytes("// Définition\n".encode("latin-1") + SQUARE_LINES.encode())
    assert load(path).area == 45.0
    path.write_bytes(SQUARE_LINES.encode() + b"\n\xe9 = 3;")
    with pytest.raises(DomainError, match=r"line 2: .* is not understood"):
        load(path)


BAD = {
    "nothing": ("// nothing", "no curves; give Point"),
    "unknown variable": ("Point(1) = {a, 0, 0};", "line 1: 'a' is no number known here"),
    "unknown point": ("\nLine(1) = {1, 2};", "line 2: point 1 is not defined before"),
    "a program": ('SystemCall "ls";', "line 1: 'SystemCall' is not followed: it runs a program"),
    "a file": ('Merge "part.step";', "line 1: 'part.step' is not read; give that file itself"),
    "division": ("a = 1 / 0;", "line 1: a division by zero"),
    "overflow": ("a = 10 ^ 400;", "line 1: cannot be worked out"),
    "root": ("a = Sqrt(-1);", "line 1: cannot be worked out"),
    "strange": ("a = \x01;", "is not understood"),
    "unfinished": ("Point(1) = {0, 0", "line 1: '' where"),
    "deep": ("a = " + "(" * 3000, "parentheses in each other"),
    "tower": ("a = 2" + "^2" * 3000 + ";", "a tower of powers"),
    "range": ("Line Loop(1) = {1:1000000000};", "a range from 1 to 1e"),
    "open loop": (PLATE.replace("{1:4}", "{1:3}"), "surface 1: a loop ends at point 4 and not at point 1"),
    "a solid": (PLATE + "Surface Loop(1) = {1}; Volume(1) = {1};", "line 20: a volume; give plane surfaces alone"),
    "tilted": (PLATE.replace("{w, h, 0, lc}", "{w, h, 1, lc}"), "surface 1 reaches from z = 0 to 1; give surfaces"),
    "no circle": (DISC.replace("{0, r, 0}", "{0, 3, 0}"), "line 4: an arc whose ends are 2 and 3 from its centre"),
    "many": (PLATE + "Transfinite Curve {1} = 100000000;", "100,000,000 vertices, at most"),
    "bump": (PLATE + "Transfinite Curve {1} = 9 Using Bump 2;", "points by Bump 2 are not understood"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD.keys())
def test_bad_scripts(tmp_path: Path, text: str, message: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(DomainError, match=message) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
