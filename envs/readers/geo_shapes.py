"""Lists of points, curves and surfaces in a Gmsh script, and what copies, turns and moves them."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from envs.readers.geo_model import CURVE, POINT, SURFACE, VOLUME, Model, Shape
from envs.readers.geo_script import Script
from envs.types import Floats

#: The dimension of each kind, by its names.
DIMENSIONS = {"Point": POINT, "Line": CURVE, "Curve": CURVE, "Surface": SURFACE, "Volume": VOLUME}

#: What turns shapes into others.
OPERATIONS = ("Translate", "Rotate", "Symmetry", "Dilate", "Duplicata", "Boundary", "CombinedBoundary", "PointsOf")


def shapes_of(script: Script, model: Model) -> list[Shape]:
    """``{ Point{1, 2}; Surface{:}; }``: what is listed, all of it defined; or an operation in braces."""
    script.expect("{")
    found: list[Shape] = []
    while not script.taken("}"):
        line = script.next.line
        word = script.take().text
        if word in OPERATIONS:
            found += operated(script, model, word)
            script.taken(";")
            continue
        if word not in DIMENSIONS:
            raise script.not_read(word, line)
        dimension = DIMENSIONS[word]
        found += [(dimension, abs(tag)) for tag in listed(script, model, dimension)]
        if script.next.text != "}":
            script.expect(";")
    return found


def all_tags(script: Script, model: Model, dimension: int) -> list[int] | None:
    """The tags of all that there is where ``{:}`` comes; None, and nothing passed, where something else does."""
    mark = script.mark()
    if script.taken("{") and script.taken(":"):
        script.expect("}")
        script.counted([0.0] * len(model.of(dimension)))
        return sorted(model.of(dimension))
    script.jump(mark)
    return None


def listed(script: Script, model: Model, dimension: int) -> list[int]:
    """``{:}``, or a list of tags that are defined; of curves and surfaces with their signs."""
    found = all_tags(script, model, dimension)
    if found is not None:
        return found
    what = ("point", "curve", "surface", "volume")[dimension]
    return known(script, script.tags(), model.of(dimension), what, signed=dimension > 0, some=False)


def known(
    script: Script, tags: list[int], table: Collection[int], what: str, *, signed: bool = True, some: bool = True
) -> list[int]:
    """The tags, all of them defined; those of curves and loops may have a sign. ``some``: one at least."""
    for tag in tags:
        if (abs(tag) if signed else tag) not in table:
            raise script.fault(f"{what} {tag} is not defined before; define it or correct the tag")
    if some and not tags:
        raise script.fault(f"an empty list where a {what} is needed; correct the statement")
    return tags


def operated(script: Script, model: Model, word: str) -> list[Shape]:
    """What an operation, whose name was passed, gives: shapes moved, copied, or those of their boundary."""
    script.deeper("more than {} operations in each other; simplify the statement")
    moved = {"Translate": translation, "Rotate": rotation, "Symmetry": reflection, "Dilate": dilation}.get(word)
    if moved is not None and script.next.text != "{":
        raise script.not_read(word)
    move = moved(script) if moved is not None else None
    shapes = shapes_of(script, model)
    try:
        if move is not None:
            model.move(shapes, move)
        elif word == "Duplicata":
            shapes = model.copies(shapes)
        elif word == "PointsOf":
            model.look_at(len(shapes))
            shapes = [(POINT, tag) for tag in sorted(model.points_of(shapes))]
        else:
            shapes = model.boundary(shapes, combined=word == "CombinedBoundary")
    except ValueError as error:
        raise script.fault(f"{error}; simplify the script") from None
    script.counted([0.0] * len(shapes))
    script.depth -= 1
    return shapes


def three(script: Script) -> Floats:
    """(3,) three numbers in braces."""
    values = script.numbers()
    if len(values) != 3:
        raise script.fault(f"{len(values)} numbers where 3 are needed; correct the statement")
    return np.array(values)


def translation(script: Script) -> Callable[[Floats], Floats]:
    """``{dx, dy, dz}``."""
    by = three(script)
    return lambda places: places + by


def rotation(script: Script) -> Callable[[Floats], Floats]:
    """``{{axis}, {point}, angle}``: by Rodrigues' formula."""
    script.expect("{")
    axis = three(script)
    script.expect(",")
    centre = three(script)
    script.expect(",")
    angle = script.number()
    script.expect("}")
    length = float(np.linalg.norm(axis))
    if not length > 0.0:
        raise script.fault("a rotation about an axis of no length; correct the axis")
    axis = axis / length

    def moved(places: Floats) -> Floats:
        off = places - centre
        along = (off @ axis)[:, None] * axis
        return centre + along + np.cos(angle) * (off - along) + np.sin(angle) * np.cross(axis, off)

    return moved


def reflection(script: Script) -> Callable[[Floats], Floats]:
    """``{a, b, c, d}``: in the plane a x + b y + c z + d = 0."""
    values = script.numbers()
    sound = len(values) in (3, 4)
    normal, off = np.array(values[:3]), (*values, 0.0)[3] if sound else 0.0
    square = float(normal @ normal) if sound else 0.0
    if not square > 0.0:
        raise script.fault("a symmetry needs a plane, {a, b, c, d}; correct the statement")
    return lambda places: places - 2.0 * ((places @ normal + off) / square)[:, None] * normal


def dilation(script: Script) -> Callable[[Floats], Floats]:
    """``{{centre}, factor}``; factors by axis change what a circle is, and are not read."""
    script.expect("{")
    centre = three(script)
    script.expect(",")
    if script.next.text == "{":
        raise script.not_read("Dilate")
    factor = script.number()
    script.expect("}")
    return lambda places: centre + factor * (places - centre)
