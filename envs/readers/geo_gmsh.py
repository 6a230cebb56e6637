"""Gmsh scripts read by Gmsh itself, an extra: OpenCASCADE's shapes, Boolean operations of the plane and all the rest.

A script may do anything: run programs, read and write files. So Gmsh is never given the script, but one written anew
from its words, in which only words of `ALLOWED` and names that the script sets itself are left, options, fields,
meshing, views and what writes are left out, included files are written in, and all else is refused. It is read in a
process without environment that can open no file but that one, in an empty folder, within limits of memory and time
(`gmsh_program`).
"""

from __future__ import annotations

import itertools
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

from envs.polygons.exact_curves import CircleArc, EllipseArc, ParametricCurve
from envs.readers.file_check import excerpt, text_of
from envs.readers.geo_included import DEPTH, included
from envs.readers.geo_model import CURVE, POINT, Curve, Model
from envs.readers.geo_passed_over import ASSIGNING, OPTIONS, PASSED_OVER, REFUSED
from envs.readers.geo_script import FUNCTIONS
from envs.readers.geo_words import Token, Words
from envs.types import Curve as ExactCurve
from envs.types import DomainError, Floats

#: Seconds that Gmsh may take.
DEADLINE = 120.0

#: Letters of a script with all that it includes at most.
MOST_LETTERS = 2_000_000

#: Bytes of a text at most: Gmsh reads the rest of a longer one as words.
MOST_TEXT = 1000

#: What no script is.
BINARY = (".msh", ".step", ".stp", ".iges", ".igs", ".brep", ".stl", ".png")

#: Statements that are not given to Gmsh.
LEFT_OUT = (PASSED_OVER | {"Transfinite", "NewModel"}) - {"MeshSize", "Characteristic", "Compound"}

#: Words that a text may follow.
BEFORE_TEXT = ("Macro", "Function", "Call")

END = Token("end", "", 0, 0)

#: Words of Gmsh's that say what a geometry is, or in which order it is made.
ALLOWED = frozenset((
    *FUNCTIONS,
    "Affine", "BSpline", "Bezier", "BooleanCoherence", "BooleanCommon",
    "BooleanCut", "BooleanDifference", "BooleanFragments", "BooleanFuse", "BooleanIntersection", "BooleanSection",
    "BooleanUnion", "Boundary", "BoundingBox", "Box", "Block", "Call", "CatmullRom", "CenterOfMass", "Chamfer",
    "Circle", "Closest", "Coherence", "CombinedBoundary", "Cone", "Coordinates", "Curve", "Cylinder",
    "DefineConstant", "DefineNumber", "DefineString", "Delete", "Dilate", "Disk", "Duplicata", "Ellipse",
    "Ellipsis", "Ellipsoid", "Else", "ElseIf", "EndFor", "EndIf", "Exists", "Exit", "Extrude", "Fillet", "For",
    "Function", "Geometry", "HealShapes", "Hole", "If", "In", "Intersect", "Knots", "Layers", "Length", "LinSpace",
    "Line", "List", "LogSpace", "Loop", "Macro", "Mass", "Nurbs", "OrientedBoundary", "OrientedCombinedBoundary",
    "Order", "Parent", "Parametric", "Physical", "Physicals", "Pi", "Plane", "Point", "PointsOf", "Rand",
    "Rectangle", "Recursive", "Return", "Rotate", "Ruled", "SetFactory", "SetMaxTag", "SetTag", "Sewing", "Sphere",
    "Spline", "Split", "Sprintf", "Str", "StrCat", "StrChoice", "StrCmp", "StrFind", "StrLen", "StrPrefix",
    "StrRelative", "StrReplace", "StrSub", "Surface", "Symmetry", "ThickSolid", "ThruSections", "Torus",
    "Translate", "Unique", "UpperCase", "LowerCase", "Using", "Volume", "Wedge", "Wire", "CopyMeshingMethod",
    "OldNewReg", "Tolerance", "OCCTargetUnit", "AutoCoherence", "GetNumber", "GetString", "GetValue", "MeshSize",
    "Characteristic", "Compound", "newp", "newl", "newc", "newll", "newcl", "news", "newsl", "newv", "newreg",
    "newf",
))  # fmt: skip

#: What a value that a user may change says of itself, in braces.
ATTRIBUTES = frozenset((
    "Name", "Min", "Max", "Step", "Range", "Choices", "Highlight", "Visible", "ReadOnly", "ReadOnlyRange", "Units",
    "Label", "Help", "Closed", "AutoCheck", "Kind", "Macro", "GmshOption", "ServerAction", "NeverChanged",
    "ChangedValue", "Loop", "Graph", "ShortHelp", "Value", "Autocheck", "MultipleSelection",
))  # fmt: skip

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
    kept = list(Kept(path))
    set_here = names_set(kept)
    lines: list[str] = []
    for (token, where), (second, _) in zip(kept, [*kept[1:], (END, "")], strict=True):
        if token.kind == "name" and not harmless(token.text, second, set_here):
            raise DomainError(f"{where}: {token.text[:40]!r} is not given to Gmsh; save the mesh from Gmsh as .msh")
        # Words of included files stand on the line that includes them, what follows on its own.
        lines += [""] * (token.line - len(lines))
        lines[-1] += f" {' '.join(token.text.splitlines())}"
    return "\n".join(lines) + "\n"


#: A word of a script, and how messages name its place.
Word = tuple[Token, str]


class Kept:
    """The words of a script that are given to Gmsh, and those of the files that it includes.

    Attributes:
        path: the script: files that it includes lie below its folder.
        read: letters read so far.
        line: the line of the script that was reached.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.read = 0
        self.line = 1

    def __iter__(self) -> Iterator[Word]:
        text = text_of(self.path, errors="replace")
        words = Words(text, str(self.path))
        self.count(text, words)
        yield from self.kept(words, 0)

    def count(self, text: str, words: Words) -> None:
        """Count the letters of a file."""
        self.read += len(text)
        if self.read > MOST_LETTERS:
            raise words.fault(f"more than {MOST_LETTERS:,} letters for Gmsh; save the mesh from Gmsh as .msh")

    def kept(self, words: Words, depth: int) -> Iterator[Word]:
        """The words of a file that are kept, and of those that it includes, on ascending lines."""
        begins, before = True, ""
        while words.next.kind != "end":
            where = words.where()
            token = words.take()
            if "\0" in token.text or len(token.text.encode()) > MOST_TEXT:
                raise words.fault(f"a word or a text of more than {MOST_TEXT} bytes; shorten it", token.line)
            if not words.file:
                self.line = token.line
            if begins and token.kind == "name" and left_out(words, token):
                while words.taken(";"):  # Gmsh knows no empty statement
                    pass
                continue
            if begins and token.kind == "name" and token.text in ("Include", "Merge"):
                yield from self.of_included(words, depth, token.line)
                continue
            yield token._replace(line=self.line), where
            ended = token.kind == "name" and token.text in ("EndFor", "EndIf", "Else", "Return")
            begins = token.text in (";", "}", ")") or ended or before in ("Macro", "Function")
            before = token.text if token.kind == "name" else ""

    def of_included(self, words: Words, depth: int, line: int) -> Iterator[Word]:
        """The words of an included file."""
        token = words.take()
        if token.kind != "text" or token.text[1:-1].lower().endswith(BINARY):
            raise words.fault(f"{token.text[:60]!r} is not read; save the mesh from Gmsh as .msh", line)
        words.taken(";")
        if depth >= DEPTH:
            raise words.fault(f"more than {DEPTH} files that include each other; put them into one", line)
        inside = included(self.path.parent, words, token.text[1:-1], line)
        self.count(inside.text, words)
        inner = Words(inside.text, words.source)
        inner.jump(inside)
        yield from self.kept(inner, depth + 1)


def left_out(words: Words, token: Token) -> bool:
    """Whether a statement, whose first word was taken, has nothing to do with geometry; then it was passed."""
    second = words.next
    if token.text in OPTIONS and second.text in (".", "["):
        mark = words.mark()
        words.take()
        if token.text == "Geometry" and words.next.text in KEPT_OPTIONS:
            words.jump(mark)
            return False
    elif token.text == "Merge":
        if second.kind != "text" or not second.text[1:-1].lower().endswith(".pos"):
            return False
    elif token.text not in LEFT_OUT or second.text in ASSIGNING:
        return False
    words.skip_statement()
    return True


def names_set(words: list[Word]) -> set[str]:
    """The names that a script sets: variables, lists, macros."""
    found = set()
    for (token, _), (second, _) in itertools.pairwise(words):
        if token.kind == "name" and second.kind == "sign" and second.text in (*ASSIGNING, "[", "(", "~"):
            found.add(token.text)
        elif token.text in ("For", "Macro", "Function", "Call") and second.kind == "name":
            found.add(second.text)
    return found - REFUSED


def harmless(name: str, second: Token, set_here: set[str]) -> bool:
    """Whether a name is one of a geometry's, or of the script itself.

    A name and a text behind it is a command. A name that the script does not set is at most unknown to Gmsh, too,
    where no command can be: before a comma or the end of something.
    """
    if name in REFUSED or (second.kind == "text" and name not in (*BEFORE_TEXT, *ATTRIBUTES)):
        return False
    ends = second.kind == "sign" and second.text in (",", "]", "}", ")")
    return name in ALLOWED or name in ATTRIBUTES or name in set_here or ends


def answer_of(content: str | bytes, source: str, name: str = "script.geo") -> dict[str, Any]:
    """What Gmsh says of a file, read in a process of its own.

    Args:
        content: of the file.
        source: the name that messages begin with.
        name: of the file: its extension tells Gmsh the format.
    """
    spec = find_spec("gmsh")
    assert spec is not None
    assert spec.origin is not None
    program = Path(__file__).with_name("gmsh_program.py")
    kept = {name: os.environ[name] for name in ("LD_LIBRARY_PATH",) if name in os.environ}
    with TemporaryDirectory(prefix="freemesh-geo-") as folder:
        file = Path(folder, name)
        file.write_bytes(content.encode() if isinstance(content, str) else content)
        try:
            done = subprocess.run(
                [sys.executable, "-I", "-S", str(program), spec.origin, str(file)],
                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, timeout=DEADLINE,
                cwd=folder, env={"OMP_NUM_THREADS": "1", **kept}, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise DomainError(f"{source}: Gmsh took more than {DEADLINE:.0f} s; simplify the file") from None
    try:
        found: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        raise DomainError(f"{source}: Gmsh took too much memory or time, or crashed; simplify the file") from None
    if "unavailable" in found:
        raise DomainError(
            f"{source}: Gmsh cannot be loaded ({excerpt(found['unavailable'], 120)}); install what it needs"
        )
    if "error" in found:
        said = found["error"].replace(f"'{file}', ", "").replace(str(file), name) or "nothing, and failed"
        raise DomainError(f"{source}: Gmsh says: {excerpt(said, 160)}; correct the file")
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
        arc = conic(t, points)
        if arc is not None:
            return arc
    from scipy.interpolate import CubicHermiteSpline  # half a second that other files need not wait

    return ParametricCurve(CubicHermiteSpline(t, points, derivatives), t[:: max(1, (len(t) - 1) // 16)])


def conic(u: Floats, points: Floats) -> CircleArc | EllipseArc | None:
    """The arc centre + a cos(t) + b sin(t), t = rate u, through (4 m + 1, 2) places at even parameters u; or None.

    With h half of the parameter's range, what the ends' mean is off the middle is 2 (1 + cos(rate h / 2)) times what
    the quarters' mean is, which gives the rate; centre, a and b then solve linear equations.
    """
    first, quarter, middle, other, last = points[:: (len(points) - 1) // 4]
    far, near = (float(np.hypot(*(0.5 * (p + q) - middle))) for p, q in ((first, last), (quarter, other)))
    if not near > 0.0:
        return None
    t = 2.0 * float(np.arccos(np.clip(far / (2.0 * near) - 1.0, -1.0, 1.0))) / (0.5 * (u[-1] - u[0])) * u
    rows = np.stack([np.ones_like(t), np.cos(t), np.sin(t)], axis=1)
    solved, *_ = np.linalg.lstsq(rows, points, rcond=None)
    centre, a, b = solved
    size = max(float(np.hypot(*a)), float(np.hypot(*b)))
    if not np.abs(rows @ solved - points).max() <= EXACT * size:
        return None
    start, sweep = float(t[0]), float(t[-1] - t[0])
    if abs(a @ b) <= EXACT * size**2 and abs(np.hypot(*a) - np.hypot(*b)) <= EXACT * size:
        turn = 1.0 if a[0] * b[1] - a[1] * b[0] > 0.0 else -1.0
        return CircleArc(centre, size, float(np.arctan2(a[1], a[0])) + turn * start, turn * sweep)
    return EllipseArc(centre, a, b, start, sweep)
