"""The statements of a Gmsh script, one after another, into a model.

Understood are Point, Line, Circle, Ellipse, Spline, BSpline, Bezier, Line/Curve Loop, Plane Surface, Physical groups,
curves and points In Surface, Transfinite Line/Curve (even or by progression), point sizes, Translate, Rotate,
Symmetry, Dilate and Duplicata, Boundary, Delete, Coherence, Include, For, If, Macro and Call, variables, lists, texts
and expressions. What does not change the outline (Mesh, Recombine, fields, ...) is passed over, what runs programs or
reads other files is refused, and of what is left `NotReadError` says that it is not read here.
"""

from __future__ import annotations

from pathlib import Path

from envs.readers.file_check import text_of
from envs.readers.geo_assignment import assignment, constants, option
from envs.readers.geo_definitions import (
    DEFINITIONS,
    TWO_WORDS,
    coherence,
    compound,
    deleted,
    embed,
    factory,
    new_model,
    point_sizes,
    recursive,
    transfinite,
    volume,
)  # fmt: skip
from envs.readers.geo_included import MOST_INCLUDED, included
from envs.readers.geo_model import Model
from envs.readers.geo_passed_over import ASSIGNING, OPTIONS, PASSED_OVER, REFUSED
from envs.readers.geo_reader import Reader
from envs.readers.geo_script import DEPTH, Script
from envs.readers.geo_shapes import DIMENSIONS, OPERATIONS, all_tags, known, operated
from envs.readers.geo_words import Mark


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
        if reader.factory == "OpenCASCADE":
            raise script.not_read(name)  # it numbers and orders in another way
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
    script = reader.script
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
    if word == "Compound":
        compound(reader)
        return
    if word in DIMENSIONS and second == "{":
        embed(reader, DIMENSIONS[word])
    elif word in DEFINITIONS and (second == "(" or (word, second) in TWO_WORDS):
        DEFINITIONS[word](reader, word, token.line)
        return
    elif word in OPERATIONS:
        query(reader, word)
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


def merge(reader: Reader) -> None:
    """``Merge "script.geo";``, as Include; a note says that ``"sizes.pos"`` is not read; other files are refused."""
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
    inside = included(reader.folder, script, name, line)
    reader.included += len(inside.text)
    reader.blocks += 1
    if reader.included > MOST_INCLUDED or reader.blocks > DEPTH:
        raise script.fault("too many included files, or files that include themselves; put them into one", line)
    behind = script.mark()
    script.enter(inside)
    read_all(reader)
    reader.blocks -= 1
    if not script.ended:
        script.jump(behind)


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
