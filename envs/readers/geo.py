"""Gmsh geometry scripts: plane surfaces of lines, circle and ellipse arcs and splines become polygons.

Understood are Point, Line, Circle, Ellipse, Spline, BSpline, Bezier, Line/Curve Loop, Plane Surface, Transfinite
Line/Curve (even or by progression), variables and expressions. Curves with a transfinite count keep it unless an edge
length is asked for. What does not change the outline (Physical, Mesh, Recombine, ...) is passed over; what would
(For, Extrude, Boolean operations, ...) is refused. Without a plane surface the loops are taken, without loops all
curves; loops inside loops are then holes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from envs.polygons import curves
from envs.polygons.curves import Flattening
from envs.polygons.rings import EDGE_LENGTH, check_coordinates, check_count, extent
from envs.polygons.turning import signed_angles
from envs.readers.geo_script import Script, tokens
from envs.readers.loops import faces
from envs.readers.nesting import nested
from envs.readers.source import text_of
from envs.types import DomainError, Floats

#: Statements that leave the outline as it is.
PASSED_OVER = frozenset((
    "Physical", "Mesh", "General", "Geometry", "Solver", "PostProcessing", "View", "Print", "Printf", "Color",
    "Recombine", "SetFactory", "Coherence", "Characteristic", "MeshSize", "Field", "Background", "Reverse", "Show",
    "Hide", "Smoother", "Periodic", "Compound", "Save", "Exit", "Draw", "UnitVector", "SyncModel", "Error", "Warning",
))  # fmt: skip

#: What curves are called, and the fewest points of each.
LEAST_POINTS = {"Line": 2, "Circle": 3, "Ellipse": 3, "Spline": 2, "BSpline": 2, "Bezier": 4}

#: Control points of a Bezier curve at most: its degree is one less, and its points take time with the square of that.
MOST_BEZIER = 50

Defined = TypeVar("Defined")

#: A size at a point from which on it is none: Gmsh's own default is 1e22.
MOST_SIZE = 1e21

#: Places along a curve at most whose sizes are told.
MOST_PLACES = 10_000

#: Two directions whose cross product is below this share of their lengths are one.
PARALLEL = 1e-12


@dataclass(frozen=True)
class Curve:
    """A curve as the script states it: its name, its points' tags, its line in the file."""

    name: str
    points: list[int]
    line: int


class Table(dict[int, Defined]):
    """What is defined, by tag."""

    highest = 0

    def __setitem__(self, tag: int, defined: Defined) -> None:
        super().__setitem__(tag, defined)
        self.highest = max(self.highest, tag)


@dataclass
class Model:
    """What a script defines, by tag.

    Attributes:
        points: coordinates in the plane.
        sizes: edge lengths at points, where the script states any.
        curves: the curves.
        loops: signed curve tags, negative against the curve's direction.
        surfaces: loop tags, the outer one first.
        counts: segments and progression ratio of transfinite curves.
    """

    points: Table[tuple[float, float]] = field(default_factory=Table)
    sizes: dict[int, float] = field(default_factory=dict)
    curves: Table[Curve] = field(default_factory=Table)
    loops: Table[list[int]] = field(default_factory=Table)
    surfaces: Table[list[int]] = field(default_factory=Table)
    counts: dict[int, tuple[int, float]] = field(default_factory=dict)


def polygons_of_file(path: Path, edge_length: float | None = None) -> list[list[Any]]:
    """The rings of every plane surface in a Gmsh script."""
    source = str(path)
    model = model_of(text_of(path, errors="replace"), source)
    if not model.curves:
        raise DomainError(f"{source}: no curves; give Point, Line and Plane Surface statements")
    tags = list(dict.fromkeys(tag for curve in model.curves.values() for tag in curve.points))
    used = np.array([model.points[tag] for tag in tags])
    check_coordinates(used, source, lambda i: f"point {tags[i]}")
    fineness = curves.flattening(extent(used), edge_length)
    flat: dict[int, Floats] = {}
    total = 0
    for tag, curve in model.curves.items():
        as_counted = edge_length is None and tag in model.counts
        flat[tag] = counted(model, tag, source) if as_counted else flattened(model, curve, fineness, source)
        total += len(flat[tag])
        check_count(total, source)
    rings, total = {}, 0
    for tag in model.loops:
        rings[tag] = ring_of(model, flat, tag, source)
        total += len(rings[tag])
        check_count(total, source)
    if model.surfaces:
        return [[rings[loop] for loop in loops] for loops in model.surfaces.values()]
    if rings:
        return nested([[[ring]] for ring in rings.values()], source)
    node = {tag: i for i, tag in enumerate(model.points)}
    ends = np.array([(node[c.points[0]], node[c.points[-1]]) for c in model.curves.values()], dtype=np.int64)
    return nested(faces(list(flat.values()), ends, source), source)


def sizes_of_file(path: Path) -> Floats | None:
    """The sizes that a script states at its points, along its curves: as in Gmsh, linear from one end to the other.

    Returns:
        (m, 3) float64 rows x, y and a size; None where no end of a curve has one, or where curves are transfinite,
        which have their segments already.

    Raises:
        DomainError: as `polygons_of_file`.
    """
    source = str(path)
    model = model_of(text_of(path), source)
    if model.counts:
        return None
    rows = [np.zeros((0, 3))]
    for curve in model.curves.values():
        ends = [model.sizes.get(curve.points[end], np.nan) for end in (0, -1)]
        points = flattened(model, curve, curves.flattening(1.0, np.inf), source)
        if np.isnan(ends).any():
            stated = [[*points[-end], ends[end]] for end in (0, 1) if ends[end] > 0.0]
            rows.append(np.array(stated).reshape(-1, 3))
            continue
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        # Sizes grow from each place on: between two of them they must not, by more than the line says.
        places = int(min(2.0 * np.ceil(2.0 * along[-1] / min(ends)) + 1.0, MOST_PLACES)) if ends[0] != ends[1] else 2
        at = np.linspace(0.0, along[-1], places)
        xy = [np.interp(at, along, points[:, axis]) for axis in (0, 1)]
        rows.append(np.column_stack([*xy, np.linspace(ends[0], ends[1], places)]))
    found = np.concatenate(rows)
    return found if len(found) else None


def model_of(text: str, source: str) -> Model:
    """What a script defines; every tag that it uses is defined."""
    model = Model()
    script = Script(source, tokens(text, source))
    newest: dict[str, Table[Any]] = {"p": model.points, "c": model.curves, "l": model.curves,
                                         "cl": model.loops, "ll": model.loops, "s": model.surfaces}  # fmt: skip
    for name, table in newest.items():
        script.counters[f"new{name}"] = lambda table=table: table.highest + 1  # type: ignore[misc]
    everything = (model.points, model.curves, model.loops, model.surfaces)
    script.counters["newreg"] = lambda: max(table.highest for table in everything) + 1
    while script.next.kind != "end":
        statement(script, model)
    return model


def statement(script: Script, model: Model) -> None:
    """Take one statement into the model."""
    script.depth = 0
    if script.taken(";"):
        return
    line = script.next.line
    token = script.take()
    word, second = token.text, script.next.text
    if token.kind != "name":
        raise script.fault(f"{word[:40]!r} where a statement is needed; correct the statement", line)
    if (word, second) in (("Line", "Loop"), ("Curve", "Loop")):
        script.take()
        tag = tag_of(script)
        model.loops[tag] = known(script, script.tags(), model.curves, "curve")
    elif (word, second) == ("Plane", "Surface"):
        script.take()
        tag = tag_of(script)
        model.surfaces[tag] = [abs(t) for t in known(script, script.tags(), model.loops, "loop")]
    elif word == "Transfinite":
        transfinite(script, model)
        return
    elif word == "Point" and second == "(":
        tag = tag_of(script)
        coordinates = script.numbers()
        if len(coordinates) < 2:
            raise script.fault("a point needs x, y and z; correct the statement")
        model.points[tag] = (coordinates[0] + 0.0, coordinates[1] + 0.0)
        state_size(model, [tag], coordinates[3] if len(coordinates) > 3 else np.inf)
    elif word in LEAST_POINTS and second == "(":
        tag = tag_of(script)
        points = known(script, script.tags(), model.points, "point", signed=False)
        least = LEAST_POINTS[word]
        if word == "Bezier" and len(points) > MOST_BEZIER:
            raise script.fault(f"a Bezier of {len(points)} points, at most {MOST_BEZIER} are possible; split the curve")
        if len(points) < least or (word == "Circle" and len(points) != 3):
            raise script.fault(f"a {word} of {len(points)} points, {least} are needed; correct the statement")
        model.curves[tag] = Curve(word, points, line)
        if script.next.text == "Plane":
            script.skip_statement()
            return
    elif (word, second) == ("MeshSize", "{") or (word, second) == ("Characteristic", "Length"):
        if second == "Length":
            script.take()
        if not point_sizes(script, model):
            return
    elif word == "DefineConstant":
        constants(script)
    elif script.next.text in ("=", "+=", "-=", "*=", "/="):
        assignment(script, word)
    elif word in PASSED_OVER:
        script.skip_statement()
        return
    else:
        fix = "open the file in Gmsh and save the mesh as .msh"
        raise script.fault(f"{word[:40]!r} is not understood here; {fix}", line)
    script.expect(";")


def state_size(model: Model, tags: list[int], size: float) -> None:
    """Note the size at points; as in Gmsh 0, or a huge one, is none."""
    for tag in tags:
        model.sizes.pop(tag, None)
        if 0.0 < size < MOST_SIZE:
            model.sizes[tag] = size


def point_sizes(script: Script, model: Model) -> bool:
    """``MeshSize {tags} = size``; False where it asks for the points of something else, and was passed over."""
    everything = script.taken("{") and script.taken(":")
    named = script.next.kind == "name" and script.next.text not in script.variables
    if named or (everything and script.next.text != "}"):
        while script.next.text != "=" and script.next.kind != "end":
            script.take()
        script.skip_statement()
        return False
    if everything:
        script.expect("}")
        tags = list(model.points)
    else:
        tags = known(script, script.tags(opened=True), model.points, "point", signed=False)
    script.expect("=")
    state_size(model, tags, script.number())
    return True


def tag_of(script: Script) -> int:
    """The tag in parentheses, and the equals sign."""
    script.expect("(")
    tag = script.whole()
    script.expect(")")
    script.expect("=")
    return tag


def known(script: Script, tags: list[int], table: dict[int, Any], what: str, signed: bool = True) -> list[int]:
    """The tags, all of them defined; those of curves and loops may have a sign."""
    for tag in tags:
        if (abs(tag) if signed else tag) not in table:
            raise script.fault(f"{what} {tag} is not defined before; define it or correct the tag")
    if not tags:
        raise script.fault(f"an empty list where a {what} is needed; correct the statement")
    return tags


def assignment(script: Script, name: str) -> None:
    """``name = value``, or ``+=`` and the like."""
    operator = script.take().text
    if script.next.text == "{" or script.next.kind == "text":
        raise script.fault("a list or a text as a variable is not understood; open the file in Gmsh, save a .msh")
    value = script.number()
    if operator != "=":
        if name not in script.variables:
            raise script.fault(f"{name[:40]!r} is not set before; give it a value first")
        before = script.variables[name]
        if operator == "/=" and value == 0.0:
            raise script.fault("a division by zero; correct the expression")
        value = {"+=": before + value, "-=": before - value, "*=": before * value}.get(operator) or before / (
            value or 1
        )
    script.variables[name] = value


def constants(script: Script) -> None:
    """``DefineConstant[ name = value, name = {value, Name "..."} ]``: the values, unless they are set already."""
    closing = {"[": "]", "{": "}", "(": ")"}.get(script.take().text)
    if closing is None:
        raise script.fault("DefineConstant needs brackets; correct the statement")
    while not script.taken(closing):
        name = script.take().text
        script.expect("=")
        braced = script.taken("{")
        value = script.number()
        if braced:
            depth = 1
            while depth and script.next.kind != "end":
                text = script.take().text
                depth += (text == "{") - (text == "}")
        script.variables.setdefault(name, value)
        if script.next.text != closing:
            script.expect(",")


def transfinite(script: Script, model: Model) -> None:
    """``Transfinite Curve {tags} = points [Using Progression ratio]``; of surfaces it says nothing about outlines."""
    if script.next.text not in ("Line", "Curve"):
        script.skip_statement()
        return
    script.take()
    line = script.next
    tags = known(script, script.tags(), model.curves, "curve")
    script.expect("=")
    points = script.whole()
    if not points >= 2:
        raise script.fault(f"a transfinite curve of {points} points, at least 2 are needed; correct the statement")
    check_count(points, f"{script.source}: line {line.line}")
    ratio = 1.0
    if script.taken("Using"):
        law = script.take().text
        ratio = script.number()
        if law != "Progression" or not 1e-3 <= ratio <= 1e3:
            raise script.fault(f"points by {law[:20]} {ratio:g} are not understood; use Progression or {EDGE_LENGTH}")
    script.expect(";")
    for tag in tags:
        # Against a curve's direction the sizes shrink by what they grow by along it.
        model.counts[abs(tag)] = (points - 1, ratio if tag > 0 else 1.0 / ratio)


def flattened(model: Model, curve: Curve, fineness: Flattening, source: str) -> Floats:
    """A curve as a (k, 2) polyline that starts and ends exactly at its end points."""
    given = np.array([model.points[tag] for tag in curve.points])
    if curve.name == "Line" or len(given) == 2:
        return given
    if curve.name == "Circle":
        return circle_arc(given, fineness, f"{source}: line {curve.line}")
    if curve.name == "Ellipse":
        return ellipse_arc(given, fineness, f"{source}: line {curve.line}")
    return SPLINES[curve.name](given, fineness)


def circle_arc(given: Floats, fineness: Flattening, where: str) -> Floats:
    """The arc from a start to an end around a centre (rows 0, 2, 1), the one of less than half a turn."""
    start, centre, end = given
    u, v = start - centre, end - centre
    radius, other = np.linalg.norm(u), np.linalg.norm(v)
    if radius == 0.0 or abs(radius - other) > 1e-3 * radius:
        raise DomainError(f"{where}: an arc whose ends are {radius:g} and {other:g} from its centre; correct a point")
    sweep = float(signed_angles(u, v))
    if abs(np.sin(sweep / 2.0)) < PARALLEL:
        raise DomainError(f"{where}: an arc that ends where it starts; split the circle into three or more")
    return curves.arc_between(start, end, sweep, fineness)


def ellipse_arc(given: Floats, fineness: Flattening, where: str) -> Floats:
    """The arc from a start to an end of the ellipse around a centre, with a point on its major axis.

    In coordinates (x, y) along and across the major axis both ends satisfy x^2 / a^2 + y^2 / b^2 = 1, two linear
    equations for 1 / a^2 and 1 / b^2. Three points are start, centre and end; the start then lies on the major axis.
    """
    start, centre, end = given[0], given[1], given[-1]
    axis = (given[2] if len(given) > 3 else start) - centre
    length = float(np.linalg.norm(axis))
    along = axis / (length or 1.0)
    across = np.array([-along[1], along[0]])
    local = np.array([[(p - centre) @ along, (p - centre) @ across] for p in (start, end)])
    scale = float(np.abs(local).max())
    fault = DomainError(f"{where}: no ellipse around this centre and axis goes through both ends; correct a point")
    if length == 0.0 or scale == 0.0:
        raise fault
    squares = (local / scale) ** 2
    if abs(np.linalg.det(squares)) < PARALLEL:
        raise fault
    inverse = np.linalg.solve(squares, np.ones(2))
    if not (inverse > 0.0).all():
        raise fault
    a, b = scale / np.sqrt(inverse)
    first, last = np.arctan2(local[:, 1] / b, local[:, 0] / a)
    sweep = float((last - first + np.pi) % (2 * np.pi) - np.pi)
    points = curves.ellipse(centre, a * along, b * across, float(first), sweep, fineness)
    return curves.pinned(points, start, end)


def spline(given: Floats, fineness: Flattening) -> Floats:
    """A uniform Catmull-Rom spline; a closed one is smooth where it closes, an open one ends by mirrored points."""
    closed = bool((given[0] == given[-1]).all())
    before = given[-2] if closed else 2 * given[0] - given[1]
    after = given[1] if closed else 2 * given[-1] - given[-2]
    padded = np.concatenate([before[None], given, after[None]])
    return curves.pinned(curves.cubics(quadruples(padded), curves.CATMULL_ROM, fineness), given[0], given[-1])


def b_spline(given: Floats, fineness: Flattening) -> Floats:
    """A cubic B-spline over uniform knots, clamped at its ends; a closed one is smooth where it closes.

    A closed one does not go through its points, not even through the first; of few points the degree is lower.
    """
    from scipy.interpolate import BSpline  # half a second that other files need not wait

    if (given[0] == given[-1]).all() and len(given) > 3:
        around = np.concatenate([given[-2:-1], given, given[1:2]])
        return curves.cubics(quadruples(around), curves.B_SPLINE, fineness)
    degree = min(3, len(given) - 1)
    knots = np.arange(len(given) - degree + 1, dtype=np.float64)
    clamped = np.concatenate([np.full(degree, knots[0]), knots, np.full(degree, knots[-1])])
    points = curves.sampled(BSpline(clamped, given, degree), knots, fineness)
    return curves.pinned(points, given[0], given[-1])


def bezier(given: Floats, fineness: Flattening) -> Floats:
    """A Bezier curve of the degree that its points ask for."""
    degree = len(given) - 1

    def at(t: Floats) -> Floats:
        points = np.repeat(given[None], len(t), axis=0)
        for _ in range(degree):
            points = points[:, :-1] + t[:, None, None] * (points[:, 1:] - points[:, :-1])
        return points[:, 0]

    return curves.pinned(curves.sampled(at, np.array([0.0, 1.0]), fineness), given[0], given[-1])


def quadruples(points: Floats) -> Floats:
    """(n - 3, 4, 2): every four consecutive of n points."""
    return np.stack([points[i : len(points) - 3 + i] for i in range(4)], axis=1)


SPLINES: dict[str, Callable[[Floats, Flattening], Floats]] = {"Spline": spline, "BSpline": b_spline, "Bezier": bezier}


def counted(model: Model, tag: int, source: str) -> Floats:
    """A transfinite curve: its stated number of segments, each ``ratio`` times as long as the one before."""
    segments, ratio = model.counts[tag]
    steps = ratio ** np.arange(segments, dtype=np.float64) if abs(np.log(ratio)) * segments < 600 else np.ones(segments)
    share = np.concatenate([[0.0], np.cumsum(steps) / steps.sum()])
    curve = model.curves[tag]
    fine = flattened(model, curve, Flattening(np.inf, np.inf, np.radians(0.2)), source)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    points = np.stack([np.interp(share * along[-1], along, fine[:, axis]) for axis in (0, 1)], axis=1)
    return curves.pinned(points, fine[0], fine[-1])


def ring_of(model: Model, flat: dict[int, Floats], loop: int, source: str) -> Floats:
    """The ring of a loop's curves, end to end; a sign that does not fit is put right, as Gmsh does."""
    tags = [abs(tag) for tag in model.loops[loop]]
    ends = [(model.curves[tag].points[0], model.curves[tag].points[-1]) for tag in tags]
    forward = model.loops[loop][0] > 0
    if len(tags) > 1 and ends[0][1 if forward else 0] not in ends[1]:
        forward = not forward
    start, node = ends[0] if forward else ends[0][::-1]
    pieces = [flat[tags[0]][:-1] if forward else flat[tags[0]][:0:-1]]
    for tag, (first, last) in zip(tags[1:], ends[1:], strict=True):
        if node not in (first, last):
            line = model.curves[tag].line
            raise DomainError(
                f"{source}: loop {loop}: curve {tag} of line {line} does not begin at point {node}, where the one "
                "before ends; put the curves in order"
            )
        pieces.append(flat[tag][:-1] if node == first else flat[tag][:0:-1])
        node = last if node == first else first
    if node != start:
        raise DomainError(
            f"{source}: loop {loop} ends at point {node} and not at point {start}, its start; add the curve between"
        )
    return np.concatenate(pieces)
