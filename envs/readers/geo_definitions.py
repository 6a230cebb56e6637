"""The statements of a Gmsh script that define something: points, curves, surfaces, groups, sizes, counts."""

from __future__ import annotations

from envs.polygons.rings import check_count
from envs.readers.geo_curves import LEAST_POINTS, MOST_BEZIER
from envs.readers.geo_model import CURVE, POINT, SURFACE, Curve
from envs.readers.geo_reader import Reader
from envs.readers.geo_script import Script
from envs.readers.geo_shapes import DIMENSIONS, all_tags, known, listed, shapes_of

#: Curves that Gmsh's own kernel and OpenCASCADE draw differently through the same points.
KERNELS_DIFFER = ("Spline", "BSpline", "Bezier")


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
        shapes = shapes_of(script, model)
        try:
            model.delete(shapes, recursive)
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


def compound(reader: Reader) -> None:
    """``Compound Curve {tags};``, which says how to mesh: passed over; ``Compound Spline(tag)`` is not read."""
    script = reader.script
    script.take()
    if script.next.text == "(":
        raise script.not_read("Compound")
    script.skip_statement()


def volume(reader: Reader) -> None:
    """Refuse a solid."""
    raise reader.script.fault("a volume; give plane surfaces alone")


def new_model(reader: Reader) -> None:
    """``NewModel;``, where there is none yet."""
    if reader.model.points:
        raise reader.script.not_read("NewModel")
    reader.script.expect(";")


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
