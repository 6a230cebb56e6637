"""Small files made to take a reader's time, memory or stack: each is refused or read, in a process of little memory."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from confined import confined_pool, each

from envs.domains.load import load_all
from envs.types import DomainError

pytestmark = pytest.mark.slow

CORNERS = "Point(1)={0,0,0};Point(2)={1,0,0};Point(3)={1,1,0};Point(4)={0,1,0};"
SIDES = "Line(2)={2,3};Line(3)={3,4};Line(4)={4,1};"


def pairs(*codes: tuple[int, object]) -> str:
    """Group codes and values as DXF has them."""
    return "".join(f"{code}\n{value}\n" for code, value in codes)


def dxf(entities: str, blocks: str = "") -> str:
    """A drawing."""
    header = pairs((0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, "AC1015"), (0, "ENDSEC"))
    inner = pairs((0, "SECTION"), (2, "BLOCKS")) + blocks + pairs((0, "ENDSEC")) if blocks else ""
    return header + inner + pairs((0, "SECTION"), (2, "ENTITIES")) + entities + pairs((0, "ENDSEC"), (0, "EOF"))


def block(name: str, inside: str) -> str:
    """A block of entities."""
    start = pairs((0, "BLOCK"), (8, "0"), (2, name), (70, 0), (10, 0), (20, 0), (3, name))
    return start + inside + pairs((0, "ENDBLK"), (8, "0"))


def insert(name: str, columns: int = 1) -> str:
    """A block put in, many times side by side."""
    return pairs((0, "INSERT"), (8, "0"), (2, name), (10, 0), (20, 0), (70, columns), (71, columns), (44, 1), (45, 1))


def line(x: float, y: float, u: float, v: float) -> str:
    """A line."""
    return pairs((0, "LINE"), (8, "0"), (10, x), (20, y), (11, u), (21, v))


def frame(size: float) -> str:
    """A square of lines."""
    corners = [(0, 0), (size, 0), (size, size), (0, size)]
    return "".join(line(*a, *b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True))


def spline(degree: int) -> str:
    """A spline of a high degree."""
    points = degree + 1
    start = [(0, "SPLINE"), (100, "AcDbEntity"), (8, "0"), (100, "AcDbSpline"), (70, 8), (71, degree), (72, 2 * points)]
    knots = [(40, i // points) for i in range(2 * points)]
    return pairs(*start, (73, points), *knots, *((10 + 10 * (i % 2), i % 7) for i in range(2 * points)))


def scribble(count: int, far: float) -> str:
    """A ring of so many points that cross each other, or that are one place seen from the far one."""
    places = np.random.default_rng(0).random((count, 2)).tolist()
    return f"{far} {far}\n" + "".join(f"{x + (i % 2) * far / 2} {y}\n" for i, (x, y) in enumerate(places))


def mesh(nodes: int, elements: str) -> str:
    """A Gmsh mesh of places on a line."""
    listed = "".join(f"{i + 1} {i / 2} {i % 3} 0\n" for i in range(nodes))
    count = elements.count("\n")
    return (
        f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{nodes}\n{listed}$EndNodes\n"
        f"$Elements\n{count}\n{elements}$EndElements\n"
    )


def holes(count: int) -> str:
    """A plate with triangular holes."""
    side = int(count**0.5)
    inner = [f"({x}.2 {y}.2, {x}.5 {y}.2, {x}.2 {y}.5, {x}.2 {y}.2)" for x in range(side) for y in range(count // side)]
    return f"POLYGON ((0 0, {side} 0, {side} {side}, 0 {side}, 0 0), {', '.join(inner)})"


#: What the file is, its content, and what the refusal says; None: it is a polygon.
HOSTILE: dict[str, tuple[str, Callable[[], str], str | None]] = {
    "collections in collections": (".wkt", lambda: "GEOMETRYCOLLECTION (" * 100_000, "nested more than 20 deep"),
    "curves in curves": (".wkt", lambda: "CURVEPOLYGON (" + "COMPOUNDCURVE (" * 100_000, "a CURVEPOLYGON where"),
    "commands to the terminal": (".wkt", lambda: "POLYGON ((0 0, \x1b]0;owned\x07 1))", r"\\x1b\]0;owned"),
    "a long word": (".wkt", lambda: "POLYGON" + "x" * 100_000, "not valid WKT"),
    "many holes": (".wkt", lambda: holes(900), None),
    "long texts for numbers": (
        ".json", lambda: json.dumps([["a" * 100_000, "b"], *[["x", "y"]] * 50_000]), "not a list of"),
    "lists in lists": (".json", lambda: "[" * 1_000_000, "nested too deeply"),
    "a type of terminal commands": (".json", lambda: '{"type": "\\u001b[31m' + "x" * 9999 + '"}', "type '.x1b"),
    "too many rings": (
        ".json", lambda: json.dumps({"rings": [[[0, 0], [1, 0], [0, 1]]] * 10_001}), "10,001 rings, at most 10,000"),
    "a scribble": (".csv", lambda: scribble(20_000, 1.0), "crosses itself"),
    "a far point": (".csv", lambda: scribble(10_000, 1e12), "repeats"),
    "rings in rings": (
        ".csv", lambda: "\n".join(f"{-r} {-r}\n{r} {-r}\n{r} {r}\n{-r} {r}\n" for r in range(1, 1100)),
        "too many rings inside each other"),
    "more rows than vertices": (".csv", lambda: "0 0\n" * 1_200_000, "at most 1,000,000"),
    "ranges": (".geo", lambda: CORNERS + "Line(1)={" + "1:1000000," * 300 + "1};", "a range from 1 to 1e"),
    "loops of the same curves": (
        ".geo", lambda: CORNERS + "Line(1)={1,2};" + SIDES + "Transfinite Curve {1} = 900000;"
        + "".join(f"Curve Loop({i})={{1:4}};" for i in range(1, 300)), "1,800,004 vertices, at most"),
    "a Bezier curve of a high degree": (
        ".geo", lambda: CORNERS + "Bezier(1)={" + "1,2,3," * 3000 + "4};", "a Bezier of 9001 points, at most 50"),
    "a point with a sign": (".geo", lambda: CORNERS + "Line(1)={-1,2};", "point -1 is not defined"),
    "newest tags": (".geo", lambda: "Point(newp)={0,0,0};" * 20_000, "no curves"),
    "a comment without an end": (".geo", lambda: CORNERS + "/* /" * 50_000, "line 1: a comment that does not end"),
    "an array of an empty block": (".dxf", lambda: dxf(insert("B", 30_000), block("B", "")), "10,000 inserted blocks"),
    "a block in itself": (
        ".dxf", lambda: dxf(insert("B"), block("B", line(0, 0, 1, 1) + insert("B"))), "10,000 inserted blocks"),
    "a far line": (
        ".dxf", lambda: dxf(line(0, 0, 1e9, 0) + "".join(line(i / 9, 0, i / 7 + 99, 1) for i in range(3000))),
        "too many curves end within 1e.03 of each other"),
    "dividing lines that cross": (
        ".dxf", lambda: dxf(frame(500) + "".join(line(i + 0.5, 0, i + 0.5, 500) + line(0, i + 0.5, 500, i + 0.5)
                                                 for i in range(400))), "lines cross at more than 100,000 places"),
    "a line of many dashes": (
        ".dxf", lambda: dxf(frame(9) + "".join(line(i / 9e4, 1, (i + 0.5) / 9e4, 1) for i in range(20_000))), None),
    "a scribble of open lines": (
        ".dxf", lambda: dxf(frame(1) + "".join(line(x, y, u, v) for x, y, u, v in
                                               np.random.default_rng(0).random((5000, 4)).tolist())),
        "join them with --join"),
    "elements in elements": (".svg", lambda: "<svg>" + "<g>" * 100_000, "200,000 elements, or 100 in each other"),
    "elements used by elements that are used": (
        ".svg", lambda: "<svg><path id='u0' d='M0 0H1V1z'/>" + "".join(
            f"<g id='u{i + 1}'>" + f"<use href='#u{i}'/>" * 20 + "</g>" for i in range(20)) + "</svg>",
        "200,000 elements, or 100 in each other"),
    "entities of entities": (
        ".svg", lambda: '<!DOCTYPE svg [<!ENTITY a "aaaaaaaaaa">' + "".join(
            f'<!ENTITY {chr(98 + i)} "{f"&{chr(97 + i)};" * 10}">' for i in range(12)) + "]><svg>&m;</svg>",
        "a DTD in the file, which is not read"),
    "a path of many curves": (
        ".svg", lambda: "<svg><path d='M0 0" + "c1 2 3 4 5 5" * 210_000 + "'/></svg>", "more than 200,000 curves"),
    "a path of many lines": (
        ".svg", lambda: "<svg><path d='M0 0" + "h1v1" * 510_000 + "'/></svg>", "at most 1,000,000 are possible"),
    "many words for numbers": (".svg", lambda: "<svg><polygon points='" + "x " * 500_000 + "'/></svg>", "no list of num"),  # noqa: E501
    "a spline of a high degree": (".dxf", lambda: dxf(spline(500)), "a spline of degree 500, at most 25"),
    "nodes that are not there": (
        ".msh", lambda: mesh(4, "1 1 2 0 1 1 2\n").replace("$Nodes\n4", "$Nodes\n1000000000"), "ends too early"),
    "every element a surface": (
        ".msh", lambda: mesh(6, "".join(f"{i} 2 2 0 {i} 1 2 3\n" for i in range(1, 10_002))),
        "outer ring: 3 vertices|10,001 rings"),
}  # fmt: skip


@pytest.fixture(scope="module")
def pool() -> Iterator[ProcessPoolExecutor]:
    """Processes of little memory."""
    with confined_pool() as children:
        yield children


def told(path: Path) -> list[str]:
    """What a file is refused with; run in a process of the pool."""
    found = []

    def check(path: Path, number: int) -> bool:
        try:
            load_all(path, edge_length=(None, 0.5)[number], fix_parity=True)
        except DomainError as error:
            found.append(str(error))
            return False
        return True

    each(iter([path.read_bytes()] * 2), path, check)
    return found


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files(tmp_path: Path, name: str, pool: ProcessPoolExecutor) -> None:
    extension, content, message = HOSTILE[name]
    if extension == ".dxf":
        pytest.importorskip("ezdxf")
    path = tmp_path / f"part{extension}"
    path.write_text(content())
    lines = pool.submit(told, path).result()
    assert bool(lines) == (message is not None)
    for line in lines[:1]:
        with pytest.raises(DomainError, match=message):
            raise DomainError(line)
        assert line.isprintable()
        assert len(line) < len(str(path)) + 300


def test_curves_of_too_many_chords_are_refused_before_they_are_made(tmp_path: Path) -> None:
    path = tmp_path / "part.geo"
    path.write_text(CORNERS + "Spline(1)={" + "1,2,3," * 300 + "4};" + SIDES)
    with pytest.raises(
        DomainError, match="curves of more than 1,000,000 chords; simplify them, or use a larger --edge-length"
    ):
        load_all(path, edge_length=2e-5)


@pytest.mark.parametrize("extension", [".wkt", ".msh"])
def test_pipes_are_not_waited_for(tmp_path: Path, extension: str) -> None:
    path = tmp_path / f"part{extension}"
    os.mkfifo(path)
    with pytest.raises(DomainError, match="not a regular file"):
        load_all(path)
