"""Every way in that ends in a refusal: one line that names the place, and what to do or which option helps."""

from __future__ import annotations

import ast
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import envs
from envs.domains.load import from_object, load
from envs.polygons.validation import from_polygon
from envs.types import DomainError

FOLDER = Path(envs.__file__).parent
SQUARE = [[0, 0], [4, 0], [4, 4], [0, 4]]
HOLE = [[1, 1], [2, 1], [2, 2], [1, 2]]
SEAMED = [[0, 0], [1, 1], [1, 2], [2, 2], [2, 1], [1, 1], [0, 0], [4, 0], [4, 4], [0, 4]]
TURN = 2 * np.pi * np.arange(400) / 400
LOBES = (1 + 0.3 * np.cos(3 * TURN))[:, None] * np.stack([np.cos(TURN), np.sin(TURN)], axis=1)
EDGE, PARITY = "--edge-length (edge_length= in Python)", "--fix-parity (fix_parity=True in Python)"

#: What is given to ``from_object``, with which options; what the line says of the place, and of the way out.
OBJECTS: dict[str, tuple[Any, dict[str, Any], str, str]] = {
    "triangle": (SQUARE[:3], {}, "outer ring: 3 vertices", f"use {EDGE}"),
    "two vertices": (SQUARE[:2], {"edge_length": 1.0}, "outer ring: 2 vertices", "add vertices"),
    "hole of two": ([SQUARE, HOLE[:2]], {}, "hole 0: 2 vertices", "add vertices or remove the hole"),
    "odd": ([*SQUARE, [-1, 2]], {}, "5 boundary vertices", f"use {PARITY}"),
    "odd with a seam": ([*SEAMED, [-1, 2]], {}, "11 boundary vertices", f"use {PARITY}"),
    "too coarse": ([LOBES, 0.97 * np.roll(LOBES, 30, axis=0)], {"edge_length": 1.0, "curvature": 4},
                   "with edge length 1", f"use a smaller {EDGE}"),
    "too fine": (SQUARE, {"edge_length": 1e-6}, "about 16,000,008,000,000 elements", f"use a larger {EDGE}"),
    "no length": (SQUARE, {"edge_length": 0.0}, "edge length 0.0",
                  "give --edge-length (edge_length= in Python) a positive number"),
    "grading": (SQUARE, {"edge_length": 1.0, "grading": 0.5}, "grading 0.5",
                "give --grading (grading= in Python) a ratio"),
    "grading alone": (SQUARE, {"grading": 2.0}, "grading 2", f"give {EDGE} too"),
    "shared by two": ([[[[0, 0], [1, 0], [0, 1]]]] * 3, {"fix_parity": True}, "overlaps polygon 0",
                      "cut it off one of the two"),
    "words": ([[0, 0], ["a", 0], [1, 1], [0, 1]], {}, "vertex 1 ['a', 0]", "give every vertex as [x, y]"),
    "ragged": ([[0, 0], [1, 0, 3], [1, 1]], {}, "vertex 1 of 3 numbers", "give every vertex as [x, y]"),
    "no vertices": ([SQUARE, []], {}, "hole 0", "give at least 4"),
    "three columns": (np.zeros((4, 3)), {}, "shape (4, 3)", "give every vertex"),
    "nan": ([*SQUARE, [float("nan"), 2]], {}, "vertex 4 at (nan, 2.0)", "correct or remove it"),
    "repeated": ([SQUARE[0], *SQUARE], {}, "vertex 1 at (0.0, 0.0)", "remove one of the two"),
    "tiny": ((np.array(SQUARE) * 1e-110).tolist(), {}, "extent", "scale it up"),
    "line": ([[0, 0], [1, 0], [2, 0], [3, 0]], {}, "from (0.0, 0.0)", "give a polygon with area"),
    "rings touch": ([SQUARE, (np.array(HOLE) - 1).tolist()], {}, "hole 0, vertex 0", "move one of them"),
    "crossing": ([[0, 0], [4, 4], [4, 0], [0, 4]], {}, "segments 0 and 2 meet at (2.0, 2.0)", "move a vertex"),
    "hole crosses": ([SQUARE, (np.array(HOLE) + 2.5).tolist()], {}, "hole 0", "move the hole clear"),
    "spike": ([[0, 0], [4, 0], [2, 4], [2, 6], [2, 5], [0, 4]], {}, "a spike at (2.0, 6.0)", "remove the vertex"),
    "hole outside": ([SQUARE, (np.array(HOLE) + 9).tolist()], {}, "hole 0, vertex 0", "move the hole inside"),
    "hole in hole": ([SQUARE, HOLE, (0.5 * np.array(HOLE) + 0.75).tolist()], {}, "hole 1, vertex 0", "remove one"),
    "slit": ([[0, 0], [1, 1], [0, 0], *SQUARE[1:]], {}, "vertex 1 at (1.0, 1.0)", "remove the vertex"),
    "pinch": ([[0, 0], [2, 2], [4, 0], [4, 4], [2, 2], [0, 4]], {}, "vertex 4 at (2.0, 2.0)", "move one of the two"),
    "rounded seam": ([*SEAMED[:5], [1, 1 + 1e-12], *SEAMED[6:]], {}, "vertex 5", "make the two sides of a seam equal"),
    "wrong way": ([*SEAMED[:2], *SEAMED[4:1:-1], *SEAMED[5:]], {}, "vertex 1", "walk holes against the outer ring"),
    "no polygon": ([], {}, "polygon", "give"),
    "no polygons": ({"type": "MultiPolygon", "coordinates": []}, {}, "no polygon", "give at least one"),
    "a number": (3, {}, "a int", "give an (n, 2) array"),
    "a point": (shapely.Point(0, 0), {}, "a POINT", "give a POLYGON"),
    "empty": (shapely.Polygon(), {}, "an empty POLYGON", "give at least 4"),
}  # fmt: skip

POINTS = "Point(1)={0,0,0};Point(2)={1,0,0};Point(3)={1,1,0};Point(4)={0,1,0};\n"
LINES = "Line(1)={1,2};Line(2)={2,3};Line(3)={3,4};Line(4)={4,1};\n"
ARC = "Point(1)={0,0,0};Point(2)={2,0,0};Point(3)={0,3,0};Circle(1)={2,1,3};"
ELLIPSE = "Point(1)={0,0,0};Point(2)={2,0,0};Point(3)={1,1,0};Point(4)={2,1.5,0};Ellipse(1)={3,1,2,4};"
WINDING = POINTS + "Spline(1)={" + "1,2,3," * 300 + "4};Line(2)={4,1};"
HEAD = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"
NODES = "$Nodes\n3\n1 0 0 0\n2 1 0 0\n3 1 1 0\n$EndNodes\n"
LOOP = "$Elements\n3\n1 1 2 0 1 1 2\n2 1 2 0 1 2 3\n3 1 2 0 1 3 1\n$EndElements\n"


def nest(rings: int) -> str:
    """Squares in squares, as a table."""
    return "\n".join(f"{-r} {-r}\n{r} {-r}\n{r} {r}\n{-r} {r}\n" for r in range(1, rings))


#: What the file holds, by its name; the same of the place and the way out.
FILES: dict[str, tuple[str, str, str]] = {
    "a.stl": ("", "'.stl'", "use one of .geojson"),
    "empty.json": ("", "empty", "write a polygon"),
    "brackets.json": ("[[0, 0],\n[1,}", "line 2, column 4", "correct it there"),
    "deep.json": ("[" * 100_000, "nested too deeply", "give GeoJSON"),
    "digits.json": ("1" * 5000, "not valid JSON", "correct it"),
    "number.json": ("3", "neither GeoJSON", "give one of the two"),
    "none.json": ('{"type": "FeatureCollection", "features": []}', "no polygon", "give at least one"),
    "two.json": ('{"type": "MultiPolygon", "coordinates": [[[[0,0],[1,0],[1,1],[0,1]]],[[[2,0],[3,0],[3,1],[2,1]]]]}',
                 "2 polygons", "keep one in each file"),
    "rings.json": ('{"rings": []}', "'rings'", "give the outer ring"),
    "line.geojson": ('{"type": "LineString"}', "'coordinates' of a LineString", "give a LineString"),
    "features.geojson": ('{"type": "FeatureCollection", "features": 3}', "'features'", "give one with a Polygon"),
    "coordinates.geojson": ('{"type": "Polygon", "coordinates": 3}', "'coordinates'", "give the outer ring"),
    "features.json": ('{"type": "Feature", "geometry": ' * 30 + "0" + "}" * 30, "nested more than", "give a Polygon"),
    "many.json": (json.dumps({"rings": [[[0, 0], [1, 0], [0, 1]]] * 10_001}), "10,001 rings", "split the file"),
    "line.wkt": ("LINESTRING (0 0, 1 1)", "a LINESTRING", "give a POLYGON"),
    "word.wkt": ("zebra", "'zebra'", "give POLYGON (("),
    "open.wkt": ("POLYGON ((0 0, 4 0, 4 4, 0 4))", "not valid WKT", "give POLYGON (("),
    "word.csv": ("0,0\n1,a\n", "line 2: '1 a'", "correct the row"),
    "comments.csv": ("# nothing", "no rows", "give one 'x, y' row"),
    "header.csv": ("x,y\n", "no rows", "give one 'x, y' row"),
    "rows.csv": ("0 0\n" * 1_200_000, "1,100,000 vertices", "split or simplify"),
    "nest.csv": (nest(1100), "rings inside each other", "remove copies"),
    "nothing.geo": ("// nothing", "no curves", "give Point"),
    "far.geo": (POINTS.replace("{1,1,0}", "{1e200,1,0}") + LINES, "point 3 at (1e+200, 1.0)", "correct or remove it"),
    "statement.geo": ("\n3;", "line 2: '3'", "correct the statement"),
    "point.geo": ("Point(1)={0};", "line 1: a point", "correct the statement"),
    "bezier.geo": (POINTS + f"Bezier(1)={{{'1,2,' * 50}3}};", "line 2: a Bezier of 101 points", "split the curve"),
    "few.geo": (POINTS + "Circle(1)={1,2};", "line 2: a Circle of 2 points", "correct the statement"),
    "for.geo": ("For i In {1:3}\nEndFor", "no curves", "give Point"),
    "undefined.geo": ("Line(1)={1,2};", "line 1: point 1", "define it or correct the tag"),
    "list.geo": (POINTS + "Line(1)={};", "line 2: an empty list", "correct the statement"),
    "text.geo": ('a = "b";', "no curves", "give Point"),
    "unset.geo": ("a += 1;", "no curves", "give Point"),
    "divided.geo": ("a = 1; a /= 0;", "line 1: a division by zero", "correct the expression"),
    "constant.geo": ("DefineConstant a;", "line 1: DefineConstant", "correct the statement"),
    "count.geo": (POINTS + LINES + "Transfinite Curve {1} = 1;", "line 3: a transfinite", "correct the statement"),
    "bump.geo": (POINTS + LINES + "Transfinite Curve {1} = 9 Using Bump 2;", "Bump 2", f"use Progression or {EDGE}"),
    "arc.geo": (ARC, "line 1: an arc", "correct a point"),
    "whole.geo": (ARC.replace("{2,1,3}", "{2,1,2}"), "line 1: an arc that ends where", "split the circle"),
    "axis.geo": (ELLIPSE.replace("{2,0,0}", "{0,0,0}"), "line 1: no ellipse", "correct a point"),
    "line.geo": (ELLIPSE.replace("{2,1.5,0}", "{2,2,0}"), "line 1: no ellipse", "correct a point"),
    "branch.geo": (ELLIPSE, "line 1: no ellipse", "correct a point"),
    "open.geo": (POINTS + LINES + "Curve Loop(1)={1:3};", "loop 1 ends at point 4", "add the curve between"),
    "letter.geo": ("a = \x01;", "line 1: '\\x01'", "correct it there"),
    "comment.geo": ("\n/* ", "line 2: a comment", "close it with */"),
    "expected.geo": ("Point(1 = {0,0,0};", "line 1: '=' where ')'", "correct the statement"),
    "tag.geo": ("Point(1.5)={0,0,0};", "line 1: 1.5", "correct the statement"),
    "tags.geo": (POINTS + "Line(1)={1.5,2};", "line 2: a list of tags", "correct the statement"),
    "range.geo": ("Line Loop(1)={1:1e9};", "line 1: a range from 1", "use shorter ones"),
    "brackets.geo": ("a = " + "(" * 3000, "line 1: more than", "simplify the expression"),
    "zero.geo": ("a = 1 / 0;", "line 1: a division by zero", "correct the expression"),
    "tower.geo": ("a = 2" + "^2" * 3000 + ";", "line 1: a tower of powers", "simplify the expression"),
    "value.geo": ("a = ;", "line 1: ';'", "correct the expression"),
    "name.geo": ("a = b;", "line 1: 'b'", "set it before"),
    "root.geo": ("a = Sqrt(-1);", "line 1: cannot be worked out", "correct the expression"),
    "chords.geo": (WINDING, "curves of more than 1,000,000 chords", EDGE),
    "loose.geo": (POINTS + LINES.replace("Line(4)={4,1};", ""), "ends at (0.0, 0.0)", "close the gap"),
    "tail.geo": (POINTS + LINES + "Point(5)={9,9,0};Line(5)={3,5};", "ends at (9.0, 9.0)", "close the outline"),
    "bridge.geo": (POINTS + LINES + "Point(5)={5,0,0};Point(6)={6,0,0};Point(7)={6,1,0};Line(5)={2,5};Line(6)={5,6};"
                   "Line(7)={6,7};Line(8)={7,5};", "from (1.0, 0.0) to (5.0, 0.0)", "remove it, or split"),
    "nothing.msh": ("nothing", "no $MeshFormat", "save it again, version 4.1"),
    "empty.msh": (HEAD + NODES + "$Elements\n0\n$EndElements", "no line and no surface", "save the boundary"),
    "nan.msh": (HEAD + NODES.replace("3 1 1 0", "3 nan 1 0") + LOOP, "a node at (nan, 1.0)", "correct or remove it"),
    "tilted.msh": (HEAD + NODES.replace("3 1 1 0", "3 1 1 5") + LOOP, "heights from 0 to 5", "give a mesh in the x, y"),
    "nothing.dxf": ("nothing", "not a valid DXF", "save it again as DXF R2000"),
}  # fmt: skip

#: Names, and the same of them.
SPECS = {
    "T4": ("'T4'", "did you mean"),
    "random:x": ("seed = 'x'", "write random"),
    "random:-1": ("seed = -1", "choose it from 0"),
    "random:7?size=1": ("'size'", "use vertices"),
    "random:7?vertices=31": ("vertices = 31", "choose an even number"),
    "part:x": ("seed = 'x'", "write part"),
    "part:-1": ("seed = -1", "choose it from 0"),
    "nowhere.json": ("no such file", "check the path"),
    "a\0b.json": ("cannot be read", "check the path"),
    "/": ("unknown extension", "use one of"),
}

#: What a way out begins with.
VERBS = frozenset((
    "add", "check", "choose", "close", "correct", "cut", "define", "did", "draw", "end", "give", "install", "keep",
    "make", "move", "name", "open", "pip", "put", "remove", "save", "scale", "set", "shorten", "simplify", "split",
    "ungroup", "use", "walk", "write",
))  # fmt: skip


def check(line: str, source: str, place: str, fix: str) -> None:
    """Assert that a refusal names its source, its place and the way out, in one line."""
    assert line.startswith(source)
    assert line.isprintable()
    assert place in line.removeprefix(source)
    _, _, way_out = line.removeprefix(source).partition("; ")
    assert fix in way_out
    assert way_out.split()[0] in VERBS


@pytest.mark.parametrize("name", OBJECTS)
def test_objects(name: str) -> None:
    polygon, options, place, fix = OBJECTS[name]
    with pytest.raises(DomainError) as caught:
        from_object(polygon, "plate", **options)
    check(str(caught.value), "plate: ", place, fix)


@pytest.mark.parametrize("name", FILES)
def test_files(tmp_path: Path, name: str) -> None:
    content, place, fix = FILES[name]
    if name.endswith(".dxf"):
        pytest.importorskip("ezdxf")
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(DomainError) as caught:
        load(path, edge_length=2e-5 if name == "chords.geo" else None)
    check(str(caught.value), f"{path}: ", place, fix)


@pytest.mark.parametrize("spec", SPECS)
def test_names(spec: str) -> None:
    with pytest.raises(DomainError) as caught:
        load(spec)
    check(str(caught.value), "", *SPECS[spec])


@pytest.mark.parametrize("polygon", [shapely.Point(0, 0), shapely.Polygon()])
def test_geometries(polygon: shapely.Geometry) -> None:
    with pytest.raises(DomainError) as caught:
        from_polygon(polygon, "plate")
    check(str(caught.value), "plate: ", "a", "give")


def messages() -> Iterator[tuple[str, str]]:
    """Where in the code a refusal is put together, and its text with ``{}`` for what is filled in."""
    for path in sorted(FOLDER.glob("*/*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call) or not node.args:
                continue
            called = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
            if called in ("DomainError", "fault"):
                pieces = node.args[0].values if isinstance(node.args[0], ast.JoinedStr) else [node.args[0]]
                text = "".join(str(piece.value) if isinstance(piece, ast.Constant) else "{}" for piece in pieces)
                yield f"{path.relative_to(FOLDER)}:{node.lineno}", text


@pytest.mark.parametrize(("where", "text"), list(messages()), ids=lambda value: value.partition(":")[0][:40])
def test_every_refusal_in_the_code_has_a_way_out(where: str, text: str) -> None:
    way_out = text.rpartition("; ")[2] if "; " in text else ""
    assert text.endswith("{}") or way_out.split()[0] in VERBS, f"{where}: {text}"
