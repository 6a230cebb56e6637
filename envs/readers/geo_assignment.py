"""What sets the variables of a Gmsh script: numbers, lists and texts."""

from __future__ import annotations

from envs.polygons.rings import check_count
from envs.readers.geo_passed_over import ASSIGNING
from envs.readers.geo_reader import Reader
from envs.readers.geo_script import CLOSING, Script
from envs.readers.geo_shapes import OPERATIONS


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
        script.taken(",")
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
