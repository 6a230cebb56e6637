"""The statements of a Gmsh script, one after another, into a model.

Understood are Point, Line, Circle, Ellipse, Spline, BSpline, Bezier, Line/Curve Loop, Plane Surface, Physical groups,
curves and points In Surface, Transfinite Line/Curve (even or by progression), point sizes, Translate, Rotate,
Symmetry, Dilate and Duplicata, Boundary, Delete, Coherence, Include, For, If, Macro and Call, variables, lists, texts
and expressions. What does not change the outline (Mesh, Recombine, fields, ...) is passed over, what runs programs or
reads other files is refused, and of what is left `NotReadError` says that it is not read here.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from envs.polygons.rings import check_count
from envs.readers.geo_curves import LEAST_POINTS, MOST_BEZIER
from envs.readers.geo_model import CURVE, POINT, SURFACE, Curve, Model
from envs.readers.geo_script import CLOSING, DEPTH, OPTIONS, Script
from envs.readers.geo_shapes import DIMENSIONS, OPERATIONS, all_tags, known, listed, operated, shapes_of
from envs.readers.geo_words import Mark
from envs.readers.source import check_file, text_of
from envs.types import DomainError

#: Statements that leave the outline as it is.
PASSED_OVER = frozenset((
    "Mesh", "General", "Solver", "PostProcessing", "View", "Print", "Printf", "Color", "Recombine", "Characteristic",
    "MeshSize", "Field", "Background", "BoundaryLayer", "Reverse", "ReverseMesh", "Show", "Hide", "Smoother",
    "Periodic", "Compound", "Save", "Draw", "UnitVector", "SyncModel", "Error", "Warning", "MeshAlgorithm",
    "MeshSizeFromBoundary", "RefineMesh", "RecombineMesh", "RelocateMesh", "OptimizeMesh", "PartitionMesh",
    "RenumberMeshNodes", "RenumberMeshElements", "ReorientMesh", "SetOrder", "SetPartition", "Plugin", "Combine",
    "Alias", "AliasWithOptions", "CopyOptions", "UndefineConstant", "SetNumber", "SetString", "SetName",
    "BoundingBox", "Slide", "Sleep", "SetChanged", "UnsplitWindow", "Homology", "Cohomology", "TransformMesh",
    "CreateTopology", "ClassifySurfaces", "CreateGeometry", "CreateDir", "SetCurrentWindow", "Adapt", "AdaptMesh",
))  # fmt: skip

#: Statements that run programs or read files of other kinds.
REFUSED = frozenset((
    "SystemCall", "NonBlockingSystemCall", "System", "OnelabRun", "OnelabAction", "Open", "Merge",
    "MergeWithBoundingBox", "ShapeFromFile", "ListFromFile", "GetEnv", "Parse", "StringToName", "S2N", "FileExists",
))  # fmt: skip

#: Bytes of included files at most, each counted as often as it is read.
MOST_INCLUDED = 20_000_000

#: Curves that Gmsh's own kernel and OpenCASCADE draw differently through the same points.
KERNELS_DIFFER = ("Spline", "BSpline", "Bezier")

ASSIGNING = ("=", "+=", "-=", "*=", "/=", "++", "--")


@dataclass
class Reader:
    """A script being read into a model.

    Attributes:
        script: it.
        model: what it defined so far.
        folder: of the script: files that it includes lie below.
        factory: the kernel that it asks for.
        included: bytes of included files so far.
        blocks: loops, tests, macros and included files in each other.
    """

    script: Script
    model: Model
    folder: Path
    factory: str = "Built-in"
    included: int = 0
    blocks: int = 0


def model_of(path: Path) -> Model:
    """What a script defines; every tag that it uses is defined.

    Raises:
        DomainError: a statement that is wrong; `NotReadError`: one that is not read here.
    """
    script = Script(text_of(path, errors="replace"), str(path))
    model = Model()
    reader = Reader(script, model, path.parent)
    tables = {
        "p": model.points, "c": model.curves, "l": model.curves, "cl": model.loops, "ll": model.loops,
        "s": model.surfaces, "sl": model.shells, "v": model.shells,
    }  # fmt: skip
    for name, table in tables.items():
        script.counters[f"new{name}"] = lambda table=table: model.new(table)  # type: ignore[misc]
    script.counters["newreg"] = model.new_region
    script.counters["newf"] = lambda: 1
    for name in (*DIMENSIONS, *OPERATIONS):
        script.queries[name] = lambda name=name: query(reader, name)  # type: ignore[misc]
    read_all(reader)
    return model


def query(reader: Reader, name: str) -> list[float]:
    """The list that ``Boundary{...}``, ``Translate ...``, ``Curve{:}`` or ``Point{tag}`` stand for."""
    script, model = reader.script, reader.model
    if name in OPERATIONS:
        return [float(tag) for _, tag in operated(script, model, name)]
    if script.next.text != "{":
        raise script.not_read(name)
    found = all_tags(script, model, DIMENSIONS[name])
    if found is not None:
        return [float(tag) for tag in found]
    if name != "Point":
        raise script.not_read(name)
    script.take()
    point = known(script, [script.whole()], model.points, "point", signed=False)[0]
    script.expect("}")
    return list(model.points[point])


def read_all(reader: Reader) -> None:
    """Take everything to the end of the file into the model."""
    while reader.script.next.kind != "end":
        statement(reader)


def read_block(reader: Reader, endings: tuple[str, ...]) -> str:
    """Take the statements up to one of the words that end a block; which word it was, passed; empty after an Exit."""
    script = reader.script
    reader.blocks += 1
    if reader.blocks > DEPTH:
        raise script.fault(f"more than {DEPTH} loops, tests and macros in each other; simplify the script")
    while script.next.kind != "name" or script.next.text not in endings:
        if script.next.kind == "end":
            if script.ended:
                return ""
            raise script.fault(f"no {endings[-1]!r} to the end of the file; add it")
        statement(reader)
    reader.blocks -= 1
    return script.take().text


def statement(reader: Reader) -> None:
    """Take one statement into the model."""
    script, model = reader.script, reader.model
    script.depth = 0
    if script.taken(";"):
        return
    token = script.take()
    word, second = token.text, script.next.text
    if token.kind != "name":
        raise script.fault(f"{word[:40]!r} where a statement is needed; correct the statement", token.line)
    if word in FLOW:
        FLOW[word](reader)
        return
    if word in DIMENSIONS and second == "{":
        embed(reader, DIMENSIONS[word])
    elif word in DEFINITIONS and (second == "(" or (word, second) in TWO_WORDS):
        DEFINITIONS[word](reader, word, token.line)
        return
    elif word in OPERATIONS:
        operated(script, model, word)
        script.taken(";")
        return
    elif (word, second) == ("MeshSize", "{") or (word, second) == ("Characteristic", "Length"):
        if second == "Length":
            script.take()
        if not point_sizes(reader):
            return
    elif word in STATEMENTS:
        STATEMENTS[word](reader)
        return
    elif word in OPTIONS and second in (".", "["):
        option(reader, word)
        return
    elif word in REFUSED:
        raise script.fault(f"{word!r} is not followed: it runs a program or reads another file; remove it", token.line)
    elif word in PASSED_OVER:
        script.skip_statement()
        return
    elif second in (*ASSIGNING, "[", "(", "~") and script.next.kind == "sign":
        assignment(reader, word, token.line)
    else:
        raise script.not_read(word, token.line)
    script.expect(";")


def tag_of(script: Script) -> int:
    """The tag in parentheses, and the equals sign."""
    script.expect("(")
    tag = script.whole()
    script.expect(")")
    script.expect("=")
    return tag


def point(reader: Reader, word: str, line: int) -> None:
    """``Point(tag) = {x, y, z, size};``."""
    script, model = reader.script, reader.model
    tag = tag_of(script)
    coordinates = script.numbers()
    if len(coordinates) < 2:
        raise script.fault("a point needs x, y and z; correct the statement")
    x, y, z = (*coordinates[:3], 0.0)[:3]
    model.points[tag] = (x + 0.0, y + 0.0, z + 0.0)
    model.state_size([tag], coordinates[3] if len(coordinates) > 3 else float("inf"))
    script.expect(";")


def curve(reader: Reader, word: str, line: int) -> None:
    """``Circle(tag) = {points};`` and the like, or a loop of curves."""
    script, model = reader.script, reader.model
    if script.taken("Loop"):
        tag = tag_of(script)
        model.loops[tag] = known(script, script.tags(), model.curves, "curve")
        script.expect(";")
        return
    name = {"Ellipsis": "Ellipse", "CatmullRom": "Spline", "Curve": "Line"}.get(word, word)
    tag = tag_of(script)
    values = script.numbers() if script.next.text == "{" else script.item()
    if reader.factory == "OpenCASCADE" and len(values) > {"Circle": 3, "Ellipse": 4}.get(name, len(values)):
        raise script.not_read(name, line)  # by a centre and radii
    points = known(script, script.as_tags(values), model.points, "point", signed=False)
    least = LEAST_POINTS[name]
    if name == "Bezier" and len(points) > MOST_BEZIER:
        raise script.fault(f"a Bezier of {len(points)} points, at most {MOST_BEZIER} are possible; split the curve")
    if name == "Ellipse" and points[1] == points[-2] and len(points) == 4:
        raise script.not_read("an Ellipse whose axis has no length", line)
    if len(points) < least or (name == "Circle" and len(points) != 3):
        raise script.fault(f"a {name} of {len(points)} points, {least} are needed; correct the statement")
    if reader.factory == "OpenCASCADE" and name in KERNELS_DIFFER and len(points) > 2:
        model.replaceable = model.replaceable or script.where(line)
    model.curves[tag] = Curve(name, tuple(points), line)
    if script.next.text == "Plane":
        script.skip_statement()
        return
    script.expect(";")


def surface(reader: Reader, word: str, line: int) -> None:
    """``Plane Surface(tag) = {loops};``; other surfaces, whose boundary must then be in the plane, too."""
    script, model = reader.script, reader.model
    script.taken("Surface")
    if script.taken("Loop"):
        model.shells[tag_of(script)] = None
        script.skip_statement()
        return
    tag = tag_of(script)
    loops = [abs(t) for t in known(script, script.tags(), model.loops, "loop")]
    model.surfaces[tag] = [edge for loop in loops for edge in model.loops[loop]]
    script.counted([0.0] * len(model.surfaces[tag]))
    if script.next.text in ("In", "Using"):
        script.skip_statement()
        return
    script.expect(";")


def physical(reader: Reader, word: str, line: int) -> None:
    """``Physical Curve("name", 7) = {tags};``, or ``+=`` and ``-=``."""
    script, model = reader.script, reader.model
    kind = script.take().text
    if kind not in DIMENSIONS:
        raise script.not_read(f"{word} {kind}", line)
    dimension = DIMENSIONS[kind]
    script.expect("(")
    name = script.text() if script.is_text() else ""
    number = script.whole() if not name or script.taken(",") else None
    script.expect(")")
    group = model.group(dimension, name, number)
    operator = script.take().text
    if operator not in ("=", "+=", "-="):
        raise script.fault(f"{operator[:40]!r} where '=' is needed; correct the statement")
    everything = all_tags(script, model, dimension)
    tags = script.tags() if everything is None else everything
    if operator == "-=":
        gone = {abs(tag) for tag in tags}
        group.members = [tag for tag in group.members if abs(tag) not in gone]
    else:
        group.members += tags
    script.expect(";")


#: What a number in parentheses follows, or a second word.
DEFINITIONS = {
    "Point": point, "Line": curve, "Curve": curve, "Circle": curve, "Ellipse": curve, "Ellipsis": curve,
    "Spline": curve, "CatmullRom": curve, "BSpline": curve, "Bezier": curve, "Plane": surface, "Ruled": surface,
    "Surface": surface, "Physical": physical,
}  # fmt: skip
TWO_WORDS = {
    ("Line", "Loop"), ("Curve", "Loop"), ("Plane", "Surface"), ("Ruled", "Surface"), ("Surface", "Loop"),
    *(("Physical", kind) for kind in DIMENSIONS),
}  # fmt: skip


def embed(reader: Reader, dimension: int) -> None:
    """``Curve{tags} In Surface{tag};``."""
    script, model = reader.script, reader.model
    tags = [abs(tag) for tag in listed(script, model, dimension)]
    script.expect("In")
    if script.taken("Volume"):
        script.tags()
        return
    script.expect("Surface")
    listed(script, model, SURFACE)
    if dimension == POINT:
        model.embedded_points += tags
    elif dimension == CURVE:
        model.embedded_curves += tags


def point_sizes(reader: Reader) -> bool:
    """``MeshSize {tags} = size``; False where it asks for the points of something else, and was passed over."""
    script, model = reader.script, reader.model
    everything = script.taken("{") and script.taken(":")
    following = script.next
    named = following.kind == "name" and following.text not in (*script.variables, *script.queries, *script.counters)
    if named or (everything and following.text != "}"):
        while script.next.text != "=" and script.next.kind != "end":
            script.take()
        script.skip_statement()
        return False
    if everything:
        script.expect("}")
        tags = list(model.points)
        script.counted([0.0] * len(tags))
    else:
        tags = [tag for tag in script.tags(opened=True) if tag in model.points]
    script.expect("=")
    model.state_size(tags, script.number())
    return True


def assignment(reader: Reader, name: str, line: int) -> None:
    """``name = value``, ``name[] = {list}``, ``name[i] = value``, ``+=`` and the like, ``++`` and ``--``."""
    script = reader.script
    name = script.variable_name(name)
    places: list[int] | None = None
    whole = False
    if script.next.text in ("[", "("):
        if name in OPERATIONS or (name not in script.variables and script.next.text == "(" and not is_list(script)):
            raise script.not_read(name, line)
        closing = CLOSING[script.take().text]
        whole = script.next.text == closing
        if not whole:
            places = script.tags()
        script.expect(closing)
    operator = script.take().text
    if operator not in ASSIGNING:
        raise script.not_read(name, line)
    if operator == "=" and script.is_text() and places is None:
        script.texts[name] = script.text()
        script.variables.pop(name, None)
        return
    values = [1.0] if operator in ("++", "--") else script.numbers() if script.next.text == "{" else script.item()
    operator = {"++": "+=", "--": "-="}.get(operator, operator)
    if places is not None:
        put(reader, name, places, operator, values)
    elif operator == "=":
        script.variables[name] = values
        script.texts.pop(name, None)
    elif whole or len(script.variables.get(name, [])) != 1 or len(values) != 1:
        changed_list(reader, name, operator, values)
    else:
        script.variables[name] = [changed(script, script.variables[name][0], operator, values[0])]


def is_list(script: Script) -> bool:
    """Whether empty parentheses and then an assignment come next."""
    mark = script.mark()
    script.take()
    found = script.taken(")") and script.next.text in ASSIGNING
    script.jump(mark)
    return found


def changed_list(reader: Reader, name: str, operator: str, values: list[float]) -> None:
    """``name[] += {list}`` or ``-=``."""
    script = reader.script
    if name not in script.variables and operator != "+=":
        raise script.fault(f"{name[:40]!r} is not set before; give it a value first")
    before = script.variables.setdefault(name, [])
    if operator == "+=":
        before += script.counted(values)
    elif operator == "-=":
        script.counted(before)
        gone = set(values)
        script.variables[name] = [value for value in before if value not in gone]
    else:
        raise script.fault(f"{operator!r} of a list; use += or -=")


def put(reader: Reader, name: str, places: list[int], operator: str, values: list[float]) -> None:
    """``name[i] = value``: the list becomes as long as it needs to."""
    script = reader.script
    if len(places) != len(values):
        raise script.fault(f"{len(values)} values for {len(places)} places; correct the statement")
    held = script.variables.setdefault(name, [])
    for place, value in zip(places, values, strict=True):
        if place < 0:
            raise script.fault(f"{name[:40]}[{place}] is no place in a list; correct the index")
        if place >= len(held):
            check_count(place, script.where())
            held += script.counted([0.0] * (place + 1 - len(held)))
        held[place] = changed(script, held[place], operator, value)


def changed(script: Script, before: float, operator: str, value: float) -> float:
    """A number after ``=``, ``+=`` and the like."""
    if operator == "=":
        return value
    if operator == "/=" and value == 0.0:
        raise script.fault("a division by zero; correct the expression")
    return {"+=": before + value, "-=": before - value, "*=": before * value}.get(operator) or (
        before / value if operator == "/=" else 0.0
    )


def option(reader: Reader, word: str) -> None:
    """``Mesh.Algorithm = 6;`` and the like: passed over, but for what changes the tags of what follows."""
    script, model = reader.script, reader.model
    script.take()
    name = script.next.text
    if word != "Geometry" or name not in ("OldNewReg", "AutoCoherence"):
        script.skip_statement()
        return
    script.take()
    script.expect("=")
    on = script.number() != 0.0
    script.expect(";")
    if name == "OldNewReg":
        model.old_numbers = on
    else:
        model.auto_coherence = on


def constants(reader: Reader) -> None:
    """``DefineConstant[ name = value, name = {value, Name "..."} ];``: the values, unless they are set already."""
    script = reader.script
    closing = CLOSING.get(script.take().text)
    if closing is None:
        raise script.fault("DefineConstant needs brackets; correct the statement")
    while not script.taken(closing):
        name = script.variable_name()
        whole = script.taken("(") or script.taken("[")
        if whole:
            script.take()
        if script.taken("="):
            braced = script.taken("{")
            if script.is_text():
                script.texts.setdefault(name, script.text())
            else:
                values = script.numbers() if script.next.text == "{" else script.item()
                script.variables.setdefault(name, values)
            if braced:
                skip_braces(script)
        else:
            script.variables.setdefault(name, [0.0])
        if script.next.text != closing:
            script.expect(",")
    script.expect(";")


def skip_braces(script: Script) -> None:
    """Pass everything to the brace that closes the one that was passed."""
    depth = 1
    while depth:
        token = script.take()
        if token.kind == "end":
            raise script.fault("a brace that does not close; add '}'")
        if token.kind == "sign":
            depth += (token.text == "{") - (token.text == "}")


def transfinite(reader: Reader) -> None:
    """``Transfinite Curve {tags} = points [Using Progression ratio]``; of surfaces it says nothing about outlines."""
    script, model = reader.script, reader.model
    if script.next.text not in ("Line", "Curve"):
        script.skip_statement()
        return
    script.take()
    line = script.next.line
    everything = all_tags(script, model, CURVE)
    tags = known(script, script.tags(), model.curves, "curve") if everything is None else everything
    script.expect("=")
    points = script.whole()
    if not points >= 2:
        raise script.fault(f"a transfinite curve of {points} points, at least 2 are needed; correct the statement")
    check_count(points, script.where(line))
    law, ratio = "Progression", 1.0
    if script.taken("Using"):
        law = script.take().text
        law = {"Power": "Progression"}.get(law, law)
        ratio = script.number()
    script.expect(";")
    for tag in tags:
        # Against a curve's direction the sizes shrink by what they grow by along it.
        model.counts[abs(tag)] = (points - 1, law, ratio if tag > 0 or not ratio else 1.0 / ratio)


def factory(reader: Reader) -> None:
    """``SetFactory("Built-in");``."""
    script = reader.script
    script.expect("(")
    reader.factory = script.text()
    script.expect(")")
    script.expect(";")


def deleted(reader: Reader, recursive: bool = False) -> None:
    """``Delete { Surface{1}; }``, or of physical groups or the mesh."""
    script, model = reader.script, reader.model
    if script.next.text == "{":
        try:
            model.delete(shapes_of(script, model), recursive)
        except ValueError as error:
            raise script.fault(f"{error}; simplify the script") from None
        script.taken(";")
        return
    what = script.take().text
    if what == "Physicals":
        model.groups.clear()
    elif what not in ("Mesh", "Meshes", "Options", "Field", "View", "EmptyViews"):
        raise script.not_read(f"Delete {what}")
    script.skip_statement()


def recursive(reader: Reader) -> None:
    """``Recursive Delete { ... }``."""
    if not reader.script.taken("Delete"):
        reader.script.skip_statement()  # colours and what is shown
        return
    deleted(reader, recursive=True)


def coherence(reader: Reader) -> None:
    """``Coherence;``: points at one place become one, then curves."""
    script = reader.script
    if script.taken("Mesh"):
        script.expect(";")
        return
    script.taken("Geometry")
    if script.next.text != ";" or reader.factory == "OpenCASCADE":
        raise script.not_read("Coherence")
    try:
        reader.model.make_coherent()
    except ValueError as error:
        raise script.fault(f"{error}; simplify the script") from None
    script.expect(";")


def new_model(reader: Reader) -> None:
    """``NewModel;``, where there is none yet."""
    if reader.model.points:
        raise reader.script.not_read("NewModel")
    reader.script.expect(";")


def merge(reader: Reader) -> None:
    """``Merge "script.geo";``, as Include; of ``"sizes.pos"`` a note says that it is not read; other files are refused."""
    script = reader.script
    line = script.next.line
    mark = script.mark()
    name = script.text()
    if name.lower().endswith(".geo"):
        script.jump(mark)
        include(reader)
        return
    if not name.lower().endswith(".pos"):
        raise script.fault(
            f"{name[:40]!r} is not read; give that file itself, or save the mesh from Gmsh as .msh", line
        )
    reader.model.notes.append(f"{script.where(line)}: the sizes of {name[:40]} are not read; use --size {name[:40]}")
    script.expect(";")


def volume(reader: Reader) -> None:
    """Refuse a solid."""
    raise reader.script.fault("a volume; give plane surfaces alone")


STATEMENTS = {
    "DefineConstant": constants, "Transfinite": transfinite, "SetFactory": factory, "Delete": deleted,
    "Recursive": recursive, "Coherence": coherence, "Merge": merge, "Volume": volume, "NewModel": new_model,
}  # fmt: skip


def repeat(reader: Reader) -> None:
    """``For i In {first:last:step} ... EndFor``: the variable may be changed inside, and is past the last one then."""
    script = reader.script
    name, closing = "", ")"
    if not script.taken("("):
        name, closing = script.take().text, "}"
        script.expect("In")
        script.expect("{")
    at = script.number()
    if not script.taken(":"):
        script.expect("...")
    last = script.number()
    step = script.number() if script.taken(":") or script.taken("...") else 1.0
    if step == 0.0 or at + last + step != at + last + step:
        raise script.fault("a loop by steps of 0, or of numbers that are none; correct it")
    script.expect(closing)
    body = script.mark()
    if name:
        script.variables[name] = [at]
    if not runs(at, last, step):
        script.skip_to(("EndFor",), "For")
    while runs(at, last, step):
        script.jump(body)
        if not read_block(reader, ("EndFor",)):
            return
        at = (script.variables.get(name) or [last + step])[0] + step if name else at + step
        if name:
            script.variables[name] = [at]


def runs(at: float, last: float, step: float) -> bool:
    """Whether a loop goes on."""
    return (step > 0.0 and at <= last) or (step < 0.0 and at >= last)


def choose(reader: Reader) -> None:
    """``If (condition) ... ElseIf (condition) ... Else ... EndIf``."""
    script = reader.script
    word = "If"
    while word != "EndIf":
        holds = True
        if word != "Else":
            script.expect("(")
            condition = script.number()
            if condition != condition:
                raise script.not_read("If of an option of Gmsh's")
            holds = condition != 0.0
            script.expect(")")
        if holds:
            if read_block(reader, ("ElseIf", "Else", "EndIf")) in ("ElseIf", "Else"):
                script.skip_to(("EndIf",), "If")
            return
        word = script.skip_to(("ElseIf", "Else", "EndIf"), "If")


def macro_name(script: Script) -> str:
    """The name of a macro, as a word or as a text."""
    return script.text() if script.is_text() else script.variable_name()


def define_macro(reader: Reader) -> None:
    """``Macro name ... Return``: where it begins."""
    script = reader.script
    name = macro_name(script)
    script.macros[name] = script.mark()
    script.skip_to(("Return",))


def call(reader: Reader) -> None:
    """``Call name;``."""
    script = reader.script
    name = macro_name(script)
    if name not in script.macros:
        raise script.fault(f"no macro {name[:40]!r} before; define it or correct the name")
    script.taken(";")
    behind = script.mark()
    script.jump(script.macros[name])
    if read_block(reader, ("Return",)):
        script.jump(behind)


def include(reader: Reader) -> None:
    """``Include "file"``: a file below the script's folder, read as if it stood here."""
    script = reader.script
    line = script.next.line
    name = script.text()
    script.taken(";")
    path = included_file(reader.folder, script.file, name)
    if path is None:
        raise script.fault(f"{name[:60]!r} lies outside the script's folder; put it there", line)
    try:
        check_file(path, MOST_INCLUDED)
        text = text_of(path, errors="replace")
    except DomainError as error:
        raise script.fault(f"Include: {error}", line) from None
    reader.included += len(text)
    reader.blocks += 1
    if reader.included > MOST_INCLUDED or reader.blocks > DEPTH:
        raise script.fault("too many included files, or files that include themselves; put them into one", line)
    behind = script.mark()
    script.jump(Mark(text, str(path.relative_to(reader.folder.resolve())), 0, 1))
    read_all(reader)
    reader.blocks -= 1
    if not script.ended:
        script.jump(behind)


def included_file(folder: Path, file: str, name: str) -> Path | None:
    """The file that a script, or one included by it, means by a name; None: it lies outside the script's folder."""
    top = folder.resolve()
    try:
        path = (top / file).parent / name if file else top / name
        path = path.resolve()
    except (OSError, ValueError, RuntimeError):  # no such path can be
        return None
    return path if path.is_relative_to(top) else None


def leave(reader: Reader) -> None:
    """``Exit;``: what follows is not read."""
    script = reader.script
    script.ended = True
    script.jump(Mark("", script.file, 0, script.next.line))


def stray(reader: Reader) -> None:
    """Refuse the end of a block that did not begin."""
    raise reader.script.fault("the end of a loop, a test or a macro that does not begin; remove it")


#: What says in which order statements are read.
FLOW = {
    "For": repeat, "If": choose, "Macro": define_macro, "Function": define_macro, "Call": call, "Include": include,
    "Exit": leave, "Abort": leave, "EndFor": stray, "EndIf": stray, "Else": stray, "ElseIf": stray, "Return": stray,
}  # fmt: skip
