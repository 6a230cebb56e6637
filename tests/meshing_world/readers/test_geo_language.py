"""The language of Gmsh's scripts: loops, tests, macros, lists, texts, included files, what moves and copies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.domains.load import load, load_all
from envs.polygons.drawing import Reading
from envs.readers import geo, geo_gmsh, geo_model, geo_words
from envs.readers.geo_script import Script
from envs.types import DomainError

SQUARE = " Point(1)={0,0,0};Point(2)={1,0,0};Point(3)={1,1,0};Point(4)={0,1,0};" + "".join(
    f"Line({i})={{{i},{i % 4 + 1}}};" for i in range(1, 5)
)


@pytest.fixture(autouse=True)
def _without_gmsh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything here is read without Gmsh."""
    monkeypatch.setattr(geo_gmsh, "installed", lambda: False)


def written(folder: Path, text: str, name: str = "part.geo") -> Path:
    """A script as a file."""
    path = folder / name
    path.write_text(text)
    return path


#: Scripts of the same unit square, each by another way of saying it.
SQUARES = {
    "curves in any order": SQUARE + "Curve Loop(1) = {3, 1, 4, 2}; Plane Surface(1) = {1};",
    "curves against their direction": SQUARE + "Curve Loop(1) = {1, -4, -3, -2}; Plane Surface(1) = {1};",
    "a loop": "p[] = {};\nFor i In {0:3}\n  p[] += newp;\n  Point(newp) = {i == 1 || i == 2, i > 1, 0};\nEndFor\n"
    "For i In {0:3} Line(i+1) = {p[i], p[(i + 1) % 4]}; EndFor\nCurve Loop(9) = {1:4}; Plane Surface(9) = {9};",
    "a loop without a name": "n = 0; For (1:4) n += 1; EndFor" + SQUARE + "Curve Loop(n) = {1 ... n};"
    "Plane Surface(1) = {4};",
    "a loop by steps down": SQUARE + "l() = {}; For i In {4:1:-1} l() += -i; EndFor Curve Loop(1) = l();"
    "Plane Surface(1) = {1};",
    "a loop that does not run": SQUARE + "For i In {1:0} For j In {1:2} SystemCall 'ls'; EndFor EndFor "
    "Curve Loop(1) = {1:4}; Plane Surface(1) = {1};",
    "tests": "If (1 > 2) x = 7; If (1) x = 8; EndIf ElseIf (2 >= 2 && !(1 == 0)) x = 1; Else x = 9; EndIf"
    + SQUARE.replace("{1,", "{x,") + "Curve Loop(1) = {1:4}; Plane Surface(1) = {1};",
    "the other way": "If (0) x = 7; Else x = 1; EndIf If (1) y = x; Else If (0) y = 3; EndIf y = 5; EndIf"
    + SQUARE.replace("{1,", "{y,") + "Curve Loop(1) = {1:4}; Plane Surface(1) = {1};",
    "a macro": "Macro Side\n  Line(k) = {k, k % 4 + 1};\nReturn\nk = 0;" + SQUARE[: SQUARE.index("Line")]
    + "For k In {1:4} Call Side; EndFor Curve Loop(1) = {1:4}; Plane Surface(1) = {1};",
    "a function by a text": 'Function "All"\n' + SQUARE + 'Return\nCall "All"; Line Loop(1) = {1:4};'
    "Plane Surface(1) = {1};",
    "names with numbers": "For i In {0:1} x~{i} = i; EndFor" + SQUARE.replace("{1,", "{x_1,")
    + "Curve Loop(1) = {1:4}; Plane Surface(x~{1}) = {1};",
    "lists": "a[] = {1, 2}; a[] += {3, 4, 5}; a[] -= {5}; b[3] = 0; n = #a[];" + SQUARE
    + "Curve Loop(1) = a[{0:n-1}]; Plane Surface(#b()-3) = {1};",
    "lists times numbers": SQUARE + "a() = -{4, 3}; b() = 2 * {-1, -.5}; Curve Loop(1) = {a(), b()};"
    "Plane Surface(1) = {1};",
    "constants": 'DefineConstant[ w = {1, Min 0, Max 2, Step .1, Name "Width", Choices{1="one", 2="two"}}\n h = 1 ];'
    + SQUARE.replace("{1,0", "{w,0").replace(",1,0}", ",h,0}") + "Curve Loop(1) = {1:4}; Plane Surface(1) = {1};",
    "texts over lines": 'a = "one\ntwo"; Printf("%g\n", 3); b = StrCat(a, Sprintf("%02g", 7));' + SQUARE
    + "Curve Loop(1) = {1:4}; Plane Surface(1) = {1}; Physical Surface(Str(b)) = {1};",
    "new tags": "a = newp; Point(a) = {0,0,0}; Point(newp) = {1,0,0}; Point(newp) = {1,1,0}; Point(newp) = {0,1,0};"
    "c = newc; Line(c) = {1,2}; Line(newc) = {2,3}; Line(newl) = {3,4}; Line(newreg) = {4,1};"
    "s = newcl; Curve Loop(s) = {1:4}; Plane Surface(news) = {s};",
    "moved": SQUARE.replace("Point(1)={0", "Point(1)={5") + "Translate {-5, 0, 0} { Point{1}; }"
    "Curve Loop(1) = {1:4}; Plane Surface(1) = {1};",
    "turned": SQUARE + "Curve Loop(1) = {1:4}; Plane Surface(1) = {1};"
    "Rotate {{0, 0, 1}, {.5, .5, 0}, Pi/2} { Surface{1}; }",
    "turned upright": "Point(1)={0,0,0};Point(2)={1,0,0};Point(3)={1,0,1};Point(4)={0,0,1};"
    + SQUARE[SQUARE.index("Line") :] + "Rotate {{1,0,0},{0,0,0},-Pi/2} { Line{1:4}; }"
    "Curve Loop(1) = {1:4}; Plane Surface(1) = {1};",
    "mirrored and scaled": SQUARE + "Symmetry {1, 0, 0, -.5} { Curve{1:4}; } Dilate {{0,0,0}, 2} { Curve{:}; }"
    "Dilate {{0,0,0}, .5} { Curve{:}; } Curve Loop(1) = {1:4}; Plane Surface(1) = {1};",
    "copied": "Point(1)={0,0,0};Point(2)={1,0,0};Line(1)={1,2};"
    "l() = Translate {0, 1, 0} { Duplicata { Curve{1}; } }; Line(3) = {1, 3}; Line(4) = {2, 4};"
    "Curve Loop(9) = {1, 4, -l(0), -3}; Plane Surface(9) = {9};",
    "made coherent": "Point(1)={0,0,0};Point(2)={1,0,0};Point(3)={1,1,0};Point(4)={0,1,0};Point(5)={0,0,0};"
    "Line(1)={1,2};Line(2)={2,3};Line(3)={3,4};Line(4)={4,5};Line(5)={4,1}; Coherence;"
    "Curve Loop(1) = {1:4}; Plane Surface(1) = {1};",
    "deleted": SQUARE + "Point(9)={5,5,0}; Line(9)={9,1}; Curve Loop(1) = {1:4}; Plane Surface(1) = {1};"
    "Plane Surface(2) = {1}; Delete { Surface{2}; Curve{1}; } Recursive Delete { Curve{9}; }",
    "its boundary": SQUARE + "Curve Loop(1) = {1:4}; Plane Surface(1) = {1}; b() = Boundary{ Surface{1}; };"
    "Curve Loop(2) = b(); Plane Surface(1) = {2}; MeshSize{ PointsOf{ Surface{1}; } } = .3;",
    "another surface": SQUARE + "Curve Loop(1) = {1:4}; Surface(1) = {1};",
    "left behind": SQUARE + "Curve Loop(1) = {1:4}; Plane Surface(1) = {1}; Exit; this is not read {",
    "where a point is": SQUARE + "c[] = Point{3}; Point(5) = {c[0], c[1] - 1, c[2]}; Delete { Line{1, 2}; }"
    "Line(1) = {1, 5}; Line(2) = {5, 3}; Curve Loop(1) = {1:4}; Plane Surface(1) = {1};",
}  # fmt: skip


@pytest.mark.parametrize("text", SQUARES.values(), ids=SQUARES.keys())
def test_a_square_is_said_in_many_ways(tmp_path: Path, text: str) -> None:
    domain = load(written(tmp_path, text))
    assert domain.area == pytest.approx(1.0, abs=1e-12)
    assert {tuple(p) for p in np.round(domain.points, 12).tolist()} == {(0, 0), (1, 0), (1, 1), (0, 1)}


def test_holes_may_come_first_and_be_parts_of_one_loop(tmp_path: Path) -> None:
    inner = SQUARE.replace("(1)", "(11)").replace("(2)", "(12)").replace("(3)", "(13)").replace("(4)", "(14)")
    inner = inner.replace("{0,0,0}", "{.2,.2,0}").replace("{1,0,0}", "{.4,.2,0}").replace("{1,1,0}", "{.4,.4,0}")
    inner = inner.replace("{0,1,0}", "{.2,.4,0}")
    for i in (1, 2, 3, 4):
        inner = inner.replace(f"{{{i},", f"{{1{i},").replace(f",{i}}}", f",1{i}}}")
    first = "Curve Loop(1) = {11:14}; Curve Loop(2) = {1:4}; Plane Surface(1) = {1, 2};"
    joint = "Curve Loop(1) = {12, 1, 13, 2, 11, 4, 14, 3}; Plane Surface(1) = {1};"
    for loops in (first, joint):
        domain = load(written(tmp_path, SQUARE + inner + loops))
        assert domain.area == pytest.approx(0.96)
        assert len(domain.segments) == 8


def test_copies_share_what_they_lie_on(tmp_path: Path) -> None:
    text = SQUARE + "Curve Loop(1) = {1:4}; Plane Surface(1) = {1}; Translate {1, 0, 0} { Duplicata { Surface{1}; } }"
    left, right = load_all(written(tmp_path, text), edge_length=0.25)
    shared = {tuple(p) for p in left.points.tolist()} & {tuple(p) for p in right.points.tolist()}
    assert shared == {(1.0, y / 4) for y in range(5)}


def test_included_files_lie_below_the_script(tmp_path: Path) -> None:
    (tmp_path / "below" / "deep").mkdir(parents=True)
    written(tmp_path / "below", 'Include "deep/corners.geo";\n', "all.geo")
    written(tmp_path / "below" / "deep", SQUARE, "corners.geo")
    text = 'Include "below/all.geo";\nCurve Loop(1) = {1:4};\nPlane Surface(1) = {1};'
    path = written(tmp_path, text)
    assert load(path).area == 1.0
    (tmp_path / "below" / "deep" / "corners.geo").write_text("\nPoint(1) = {a, 0, 0};")
    with pytest.raises(DomainError, match=r"part.geo: below/deep/corners.geo, line 2: 'a' is no number known here"):
        load(path)


@pytest.mark.parametrize("name", ["../outside.geo", "/etc/passwd", "link.geo", "a\0b"])
def test_no_other_file_is_included(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "inside"
    folder.mkdir()
    outside = written(tmp_path, SQUARE, "outside.geo")
    (folder / "link.geo").symlink_to(outside)
    path = written(folder, f'Include "{name}";')
    with pytest.raises(DomainError, match=r"line 1: .* lies outside the script's folder; put it there"):
        load(path)


BAD = {
    "no end of a loop": ("For i In {1:2} a = 1;", "line 1: no 'EndFor' to the end of the file; add it"),
    "no end of a test": ("If (0) a = 1;", "no 'EndIf' to the end of the file"),
    "no end of a macro": ("Macro A a = 1;", "no 'Return' to the end of the file"),
    "no beginning": ("a = 1;\nEndFor", "line 2: the end of a loop, a test or a macro that does not begin"),
    "an endless loop": ("For i In {1:2}\n i = 0;\nEndFor", "loops that read more than 10,000 words"),
    "a long loop": ("For i In {1:1e9} EndFor", "loops that read more than 10,000 words"),
    "no step": ("For i In {1:2:0} EndFor", "a loop by steps of 0"),
    "a macro in itself": ("Macro A Call A; Return Call A;", "more than 50 loops, tests and macros in each other"),
    "no macro": ("Call A;", "no macro 'A' before"),
    "a file in itself": ('Include "part.geo";', "files that include themselves"),
    "no file": ('Include "other.geo";', "line 1: Include: .*other.geo: no such file"),
    "a growing list": ("a[] = {1}; For i In {1:99} a[] += a[]; EndFor", "more than 3,000,000 numbers in all lists"),
    "a growing text": ('a = "ab"; For i In {1:99} a = StrCat(a, a); EndFor', "a text of 1024 letters, at most 1000"),
    "a distant place": ("a[1e9] = 1;", "1,000,000,000 vertices, at most"),
    "a negative place": ("a[-1] = 1;", "is no place in a list"),
    "beyond a list": ("a[] = {1}; b = a[1];", r"a\[1\] of a list of 1; correct the index"),
    "a list and a number": ("a[] = {1, 2}; b = 1 + a[];", r"a list before or after '\+'"),
    "a closing brace": ("DefineConstant[ a = {1, Name", "a brace that does not close"),
    "not an axis": (SQUARE + "Rotate {{0,0,0},{0,0,0},1} { Line{1}; }", "an axis of no length"),
    "not a plane": (SQUARE + "Symmetry {0,0,0,1} { Line{1}; }", "a symmetry needs a plane"),
    "an option decides": ("If (Mesh.Algorithm == 5) a = 1; EndIf", "not understood here; pip install"),
    "a shape": ('SetFactory("OpenCASCADE"); Rectangle(1) = {0,0,0,1,1};', "'Rectangle' is not understood here; pip in"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD.keys())
def test_bad_scripts_are_told_in_one_line(
    tmp_path: Path, text: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(geo_words, "MOST_REPEATED", 10_000)
    path = written(tmp_path, text)
    with pytest.raises(DomainError, match=message) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_copies_and_moves_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(geo_model, "MOST_LOOKED_AT", 1000)
    text = SQUARE + "For i In {1:999} Translate {1, 0, 0} { Point{1}; } EndFor"
    with pytest.raises(DomainError, match="line 1: too many copies, transformations or deletions of too many points"):
        load(written(tmp_path, text))


NUMBERS = st.integers(0, 20).map(float)
SIGNS = st.sampled_from(["+", "-", "*", "<", "<=", ">", ">=", "==", "!=", "&&", "||"])


@st.composite
def expressions(draw: st.DrawFn, depth: int = 3) -> tuple[str, str]:
    """An expression as a script has it, and as Python does."""
    if depth == 0 or draw(st.booleans()):
        number = draw(NUMBERS)
        return f"{number:g}", f"{number:g}"
    left, right = draw(expressions(depth - 1)), draw(expressions(depth - 1))
    sign = draw(SIGNS)
    in_python = {"&&": "and", "||": "or"}.get(sign, sign)
    if draw(st.integers(0, 4)) == 0:
        other = draw(expressions(depth - 1))
        return f"({left[0]} ? {right[0]} : {other[0]})", f"({right[1]} if {left[1]} else {other[1]})"
    result = f"(({left[1]}) {in_python} ({right[1]}))"
    if in_python in ("and", "or"):
        result = f"bool{result}"
    return f"({left[0]}) {sign} ({right[0]})", f"float({result})"


@settings(max_examples=200, deadline=None)
@given(expressions())
def test_expressions_are_those_of_python(pair: tuple[str, str]) -> None:
    in_script, in_python = pair
    assert Script(in_script, "part.geo").number() == float(eval(in_python))


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(SIGNS, NUMBERS), min_size=1, max_size=6), NUMBERS)
def test_operators_bind_as_in_c(rest: list[tuple[str, float]], first: float) -> None:
    """Numpy's comparisons chain as C's do when each is put in parentheses by its tightness; so do ours."""
    tightness = {"||": 0, "&&": 1, "==": 2, "!=": 2, "+": 4, "-": 4, "*": 5}
    values, signs = [first], []

    def work() -> None:
        b, a, sign = values.pop(), values.pop(), signs.pop()
        values.append({
            "||": lambda: float(bool(a) or bool(b)), "&&": lambda: float(bool(a) and bool(b)),
            "==": lambda: float(a == b), "!=": lambda: float(a != b), "<": lambda: float(a < b),
            "<=": lambda: float(a <= b), ">": lambda: float(a > b), ">=": lambda: float(a >= b),
            "+": lambda: a + b, "-": lambda: a - b, "*": lambda: a * b,
        }[sign]())  # fmt: skip

    for sign, value in rest:
        while signs and tightness.get(signs[-1], 3) >= tightness.get(sign, 3):
            work()
        signs.append(sign)
        values.append(value)
    while signs:
        work()
    text = f"{first:g}" + "".join(f" {sign} {value:g}" for sign, value in rest)
    assert Script(text, "part.geo").number() == values[0]


def test_sizes_of_other_files_are_noted(tmp_path: Path) -> None:
    path = written(tmp_path, 'Merge "sizes.pos";' + SQUARE + "Curve Loop(1) = {1:4}; Plane Surface(1) = {1};")
    assert geo.drawing_of_file(path, Reading()).notes == [
        f"{path}: line 1: the sizes of sizes.pos are not read; use --size sizes.pos"
    ]
