"""Gmsh scripts read by Gmsh itself, an extra: OpenCASCADE's shapes, Boolean operations of the plane and all the rest.

A script may do anything: run programs, read and write files. So Gmsh is never given the script, but one written anew
from its words, in which only words of `ALLOWED` and names that the script sets itself are left, options, fields,
meshing, views and what writes are left out, included files are written in, and all else is refused. It is read in a
process without environment that can open no file but that one, in an empty folder, within limits of memory and time
(`gmsh_program`).
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from envs.drawing import Curve as ExactCurve
from envs.polygons.exact_curves import CircleArc, EllipseArc, ParametricCurve
from envs.readers.geo_model import CURVE, POINT, Curve, Model
from envs.readers.geo_script import FUNCTIONS, OPTIONS
from envs.readers.geo_statements import ASSIGNING, MOST_INCLUDED, PASSED_OVER, REFUSED, included_file
from envs.readers.geo_words import Mark, Token, Words
from envs.readers.source import check_file, excerpt, text_of
from envs.types import DomainError, Floats

#: Seconds that Gmsh may take.
DEADLINE = 120.0

#: Bytes of a text at most: Gmsh reads the rest of a longer one as words.
MOST_TEXT = 1000

#: Included files in each other at most.
DEPTH = 50

#: Words of Gmsh's that say what a geometry is, or in which order it is made.
ALLOWED = frozenset((*FUNCTIONS, *"""
    Affine ArcCos ArcSin ArcTan ArcTan2 BSpline Bezier BooleanCoherence BooleanCommon BooleanCut BooleanDifference
    BooleanFragments BooleanFuse BooleanIntersection BooleanSection BooleanUnion Boundary BoundingBox Box Block Call
    CatmullRom CenterOfMass Chamfer Circle Closest Coherence CombinedBoundary Cone Coordinates Curve Cylinder
    DefineConstant DefineNumber DefineString Delete Dilate Disk Duplicata Ellipse Ellipsis Ellipsoid Else ElseIf EndFor
    EndIf Exists Exit Extrude Fillet For Function Geometry HealShapes Hole If In Intersect Knots Layers Length LinSpace
    Line List LogSpace Loop Macro Mass Nurbs OrientedBoundary OrientedCombinedBoundary Order Parent Parametric Physical
    Physicals Pi Plane Point PointsOf Rand Rectangle Recursive Return Rotate Ruled SetFactory SetMaxTag SetTag Sewing
    Sphere Spline Split Sprintf Str StrCat StrChoice StrCmp StrFind StrLen StrPrefix StrRelative StrReplace StrSub
    Surface Symmetry ThickSolid ThruSections Torus Translate Unique UpperCase LowerCase Using Volume Wedge Wire
    Chamfer CopyMeshingMethod OldNewReg Tolerance OCCTargetUnit AutoCoherence GetNumber GetString GetValue
    newp newl newc newll newcl news newsl newv newreg newf
""".split()))  # fmt: skip

#: What a value that a user may change says of itself, in braces.
ATTRIBUTES = frozenset(
    """
    Name Min Max Step Range Choices Highlight Visible ReadOnly ReadOnlyRange Units Label Help Closed AutoCheck Kind
    Macro GmshOption ServerAction NeverChanged ChangedValue Loop Graph ShortHelp Value Autocheck MultipleSelection Kind
""".split()
)

#: Options of Gmsh that change geometry; all others are left out.
KEPT_OPTIONS = frozenset(("CopyMeshingMethod", "OldNewReg", "Tolerance", "AutoCoherence"))

#: Kinds of curves that Gmsh knows exactly.
CIRCLE, ELLIPSE = "Circle", "Ellipse"

#: What a circle or an ellipse may be off its samples by, as a share of its size.
EXACT = 1e-7


def installed() -> bool:
    """Whether Gmsh's Python module is there; it is not imported."""
    return find_spec("gmsh") is not None


def model_of(path: Path) -> Model:
    """What a script defines, as Gmsh has it.

    Raises:
        DomainError: a script that may not be given to Gmsh, or that it does not read.
    """
    source = str(path)
    return model_from(answer_of(safe_script(path), source), source)


def safe_script(path: Path) -> str:
    """A script of the same words and lines that defines the same geometry and does nothing else.

    Raises:
        DomainError: a word that is not known to be harmless.
    """
    text = text_of(path, errors="replace")
    kept = list(Safe(path).kept(Words(text, str(path)), 0))
    lines: list[str] = []
    for token in kept:
        lines += [""] * (token.line - len(lines))
        lines[-1] += f" {token.text}"
    return "\n".join(lines) + "\n"


class Safe:
    """What of a script is given to Gmsh.

    Attributes:
        folder: of the script: files that it includes lie below.
        included: bytes of included files so far.
        line: the last line that was written.
        names: what the script sets itself.
    """

    def __init__(self, path: Path) -> None:
        self.folder = path.parent
        self.included = 0
        self.line = 1
        self.names: set[str] = set()

    def kept(self, words: Words, depth: int) -> Iterator[Token]:
        """The words of a file that are kept, and of those that it includes, on ascending lines."""
        begins = True
        before = ""
        while words.next.kind != "end":
            token = words.take()
            if "\0" in token.text or len(token.text.encode()) > MOST_TEXT:
                raise words.fault(f"a word or a text of more than {MOST_TEXT} bytes; shorten it", token.line)
            if begins and token.kind == "name" and self.left_out(words, token):
                continue
            if begins and token.text == "Include" and token.kind == "name":
                yield from self.of_included(words, depth, token.line)
                continue
            if token.kind == "name":
                self.check_name(words, token, before)
            self.line = max(self.line, token.line) if not words.file else self.line
            yield token._replace(line=self.line, text=" ".join(token.text.split("\n")))
            ended = token.kind == "name" and token.text in ("EndFor", "EndIf", "Else", "Return")
            begins = token.text in (";", "}", ")") or ended or before in ("Macro", "Function")
            before = token.text if token.kind == "name" else ""

    def left_out(self, words: Words, token: Token) -> bool:
        """Whether a statement has nothing to do with geometry; then it was passed."""
        second = words.next.text
        if token.text in OPTIONS and second in (".", "["):
            mark = words.mark()
            words.take()
            if token.text == "Geometry" and words.next.text in KEPT_OPTIONS:
                words.jump(mark)
                return False
            words.skip_statement()
            return True
        if token.text == "Merge" and words.next.kind == "text" and words.next.text[1:-1].lower().endswith(".pos"):
            words.skip_statement()
            return True
        if token.text in PASSED_OVER - ALLOWED and second not in ASSIGNING:
            words.skip_statement()
            return True
        return False

    def of_included(self, words: Words, depth: int, line: int) -> Iterator[Token]:
        """The words of an included file."""
        token = words.take()
        path = included_file(self.folder, words.file, token.text[1:-1]) if token.kind == "text" else None
        if path is None:
            raise words.fault(f"{token.text[:60]!r} lies outside the script's folder; put it there", line)
        words.taken(";")
        try:
            check_file(path, MOST_INCLUDED)
            text = text_of(path, errors="replace")
        except DomainError as error:
            raise words.fault(f"Include: {error}", line) from None
        self.included += len(text)
        if self.included > MOST_INCLUDED or depth >= DEPTH:
            raise words.fault("too many included files, or files that include themselves; put them into one", line)
        inner = Words(text, words.source)
        inner.jump(Mark(text, str(path.relative_to(self.folder.resolve())), 0, 1))
        yield from self.kept(inner, depth + 1)

    def check_name(self, words: Words, token: Token, before: str) -> None:
        """Refuse a name that is neither known to be harmless nor set by the script."""
        name, second = token.text, words.next
        if name not in REFUSED:
            if second.text in (*ASSIGNING, "[", "(", "~") or before in ("For", "Macro", "Function", "Call"):
                self.names.add(name)
            if name in ALLOWED or name in ATTRIBUTES or name in self.names:
                if second.kind != "text" or name in ("Macro", "Function", "Call", *ATTRIBUTES):
                    return
            elif second.kind == "sign" and second.text in (",", "]", "}", ")", ";", "="):
                return  # at most a name that Gmsh does not know either
        raise words.fault(f"{name[:40]!r} is not given to Gmsh; save the mesh from Gmsh as .msh", token.line)


def answer_of(script: str, source: str) -> dict[str, Any]:
    """What Gmsh says of a script, read in a process of its own."""
    spec = find_spec("gmsh")
    assert spec is not None
    assert spec.origin is not None
    program = Path(__file__).with_name("gmsh_program.py")
    kept = {name: os.environ[name] for name in ("LD_LIBRARY_PATH",) if name in os.environ}
    with TemporaryDirectory(prefix="freemesh-geo-") as folder:
        file = Path(folder, "script.geo")
        file.write_text(script, encoding="utf-8")
        try:
            done = subprocess.run(
                [sys.executable, "-I", "-S", str(program), spec.origin, str(file)],
                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, timeout=DEADLINE,
                cwd=folder, env={"OMP_NUM_THREADS": "1", **kept}, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise DomainError(f"{source}: Gmsh took more than {DEADLINE:.0f} s; simplify the script") from None
    try:
        found: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        raise DomainError(f"{source}: Gmsh took too much memory or time, or crashed; simplify the script") from None
    if "unavailable" in found:
        raise DomainError(
            f"{source}: Gmsh cannot be loaded ({excerpt(found['unavailable'], 120)}); install what it needs"
        )
    if "error" in found:
        said = found["error"].removeprefix("Error").lstrip(" :").replace(f"'{file}', ", "")
        raise DomainError(f"{source}: Gmsh says: {excerpt(said, 160)}; correct the script")
    return found


def model_from(found: dict[str, Any], source: str) -> Model:
    """The model of what Gmsh said."""
    model = Model()
    if found["volumes"]:
        raise DomainError(f"{source}: a solid; give plane surfaces alone")
    if not found["surfaces"]:
        raise DomainError(f"{source}: no surface; give one in the x, y plane")
    for tag, place in found["points"].items():
        model.points[int(tag)] = (place[0], place[1], place[2])
    for tag, size in found["sizes"].items():
        model.state_size([int(tag)], size)
    for tag, curve in found["curves"].items():
        model.curves[int(tag)] = curve_of(model, curve, f"{source}: curve {tag}")
    for tag, edges in found["surfaces"].items():
        model.surfaces[int(tag)] = [int(edge) for edge in edges]
    for dimension, tag in found["embedded"]:
        chosen = {POINT: model.embedded_points, CURVE: model.embedded_curves}.get(dimension)
        if chosen is not None and tag not in chosen[-1:]:
            chosen.append(tag)
    for dimension, tag, name, members in found["groups"]:
        model.group(dimension, name, tag).members += members
    return model


def curve_of(model: Model, found: dict[str, Any], where: str) -> Curve:
    """A curve, exact where it is not straight; a closed one without a point gets one."""
    ends = [int(end) for end in found["ends"]]
    if "at" not in found:
        return Curve("Line", tuple(ends), 0)
    places = np.array(found["places"]).reshape(-1, 3)
    if not ends:
        model.points[model.points.highest + 1] = tuple(places[0].tolist())
        ends = [model.points.highest] * 2
    if len(ends) == 1:
        ends *= 2
    if np.ptp(places[:, 2]) > EXACT * max(float(np.ptp(places, axis=0).max()), 1e-300):
        raise DomainError(f"{where} leaves the x, y plane; give surfaces in it")
    return Curve("Exact", (ends[0], ends[-1]), 0, exact_of(found["kind"], found["at"], places, found["slopes"]))


def exact_of(kind: str, at: list[float], places: Floats, slopes: list[float]) -> ExactCurve:
    """The circle or ellipse that a curve is, or cubics between its samples."""
    t, points = np.array(at), places[:, :2]
    derivatives = np.array(slopes).reshape(-1, 3)[:, :2]
    if kind in (CIRCLE, ELLIPSE):
        arc = conic(t, points, derivatives)
        if arc is not None:
            return arc
    from scipy.interpolate import CubicHermiteSpline  # half a second that other files need not wait

    return ParametricCurve(CubicHermiteSpline(t, points, derivatives), t[:: max(1, (len(t) - 1) // 16)])


def conic(t: Floats, points: Floats, derivatives: Floats) -> CircleArc | EllipseArc | None:
    """The arc centre + u cos(t) + v sin(t) through (n, 2) places at parameters t; None: there is none.

    With the parameter an angle, places and derivatives at two of them give centre, u and v by linear equations.
    """
    rows = np.stack([np.ones_like(t), np.cos(t), np.sin(t)], axis=1)
    slopes = np.stack([np.zeros_like(t), -np.sin(t), np.cos(t)], axis=1)
    solved, *_ = np.linalg.lstsq(np.concatenate([rows, slopes]), np.concatenate([points, derivatives]), rcond=None)
    centre, u, v = solved
    size = max(float(np.hypot(*u)), float(np.hypot(*v)))
    if not np.abs(rows @ solved - points).max() <= EXACT * size:
        return None
    start, sweep = float(t[0]), float(t[-1] - t[0])
    if abs(u @ v) <= EXACT * size**2 and abs(np.hypot(*u) - np.hypot(*v)) <= EXACT * size:
        turn = 1.0 if u[0] * v[1] - u[1] * v[0] > 0.0 else -1.0
        return CircleArc(centre, size, float(np.arctan2(u[1], u[0])) + turn * start, turn * sweep)
    return EllipseArc(centre, u, v, start, sweep)
