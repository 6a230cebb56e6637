"""SVG drawings: closed paths, rectangles, circles, ellipses and polygons become polygons, with curves kept exact.

Lines that end on outlines divide them, other open ones are passed over, as in DXF drawings. Loops inside loops are
holes. The y axis is turned upwards within the drawing's page. Units are the viewBox's, or pixels.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from envs.polygons import curves
from envs.polygons.drawing import Drawing, Reading
from envs.polygons.rings import check_coordinates, extent
from envs.readers.drawn import check_closed, counted, drawn, gap_note
from envs.readers.file_check import bytes_of
from envs.readers.outline_search import outlines
from envs.readers.pieces import Piece
from envs.readers.svg_elements import (
    PIXELS,
    SHAPES,
    Element,
    Seen,
    Shape,
    length,
    length_in,
    points_in,
    tree_of,
)
from envs.readers.svg_path import Pen, Transform, draw
from envs.types import DomainError

#: Ends closer than this share of the drawing's extent meet: drawings are often written with six digits.
ENDS_MEET = 1e-6


def drawing_of_file(path: Path, reading: Reading) -> Drawing:
    """What an SVG drawing states.

    Raises:
        DomainError: no SVG, no outline in it, or one that does not close.
    """
    source = str(path)
    seen = Seen(tree_of(bytes_of(path), source), source)
    page = page_of(seen.root, source)
    names, pieces = list[str](), list[Piece]()
    for shape in seen.shapes():
        pen = Pen(page.after(shape.transform), f"{source}: line {shape.element.line}")
        lay(pen, shape)
        for subpath in pen.subpaths:
            if subpath.pieces and not subpath.closed and shape.filled and shape.element.tag != "line":
                close(subpath.pieces)
            pieces += [Piece(p.points, p.curve, p.span, len(names)) for p in subpath.pieces]
            names += [shape.name] * bool(subpath.pieces)
    if not pieces:
        others = ", ".join(f"{n} {tag}" for tag, n in seen.passed_over.items())
        raise DomainError(f"{source}: no outline in it ({others or 'nothing is drawn'}); draw {', '.join(SHAPES)}")
    places = np.concatenate([piece.rough for piece in pieces])
    check_coordinates(places, source)
    size = extent(places)
    found = outlines(
        pieces, np.zeros(len(names), dtype=bool), size, ENDS_MEET * size, curves.flattening(size, reading.edge_length),
        source, join=reading.join,
    )  # fmt: skip
    check_closed(found, "close the paths", source)
    left = len({piece.entity for piece in found.left})
    told = [counted(left, "open line")] * bool(left) + [f"{n} {tag}" for tag, n in seen.passed_over.items()]
    note = f"passed over: {', '.join(told)}{gap_note(found)}" if told else ""
    return drawn(found, names, (note, units_note(seen.root, source)), source)


def lay(pen: Pen, shape: Shape) -> None:
    """Draw a shape."""
    element, where = shape.element, pen.source

    def number(name: str) -> float:
        return length(element, name, where)

    match element.tag:
        case "path":
            draw(pen, element.attributes.get("d", ""), where)
        case "rect":
            lay_rectangle(pen, element, where)
        case "circle":
            lay_ellipse(pen, number("cx"), number("cy"), number("r"), number("r"))
        case "ellipse":
            rx, ry = number("rx"), number("ry")
            lay_ellipse(pen, number("cx"), number("cy"), rx or ry, ry or rx)
        case "line":
            pen.move(np.array([number("x1"), number("y1")]))
            pen.line(np.array([number("x2"), number("y2")]))
            pen.lay()
        case _:
            points = points_in(element.attributes.get("points", ""), where)
            for i, point in enumerate(points):
                (pen.line if i else pen.move)(point)
            if element.tag == "polygon":
                pen.close()
            pen.lay()


def lay_rectangle(pen: Pen, element: Element, where: str) -> None:
    """Draw a rectangle, its corners perhaps rounded."""
    x, y, width, height = (length(element, name, where) for name in ("x", "y", "width", "height"))
    if not (width > 0.0 and height > 0.0):
        return
    rx, ry = length(element, "rx", where, -1.0), length(element, "ry", where, -1.0)
    rx, ry = (ry if rx < 0 else rx), (rx if ry < 0 else ry)
    rx, ry = min(max(rx, 0.0), width / 2), min(max(ry, 0.0), height / 2)
    radii = np.array([rx, ry])
    pen.move(np.array([x + rx, y]))
    for to, corner in (
        ((x + width - rx, y), (x + width, y + ry)),
        ((x + width, y + height - ry), (x + width - rx, y + height)),
        ((x + rx, y + height), (x, y + height - ry)),
        ((x, y + ry), (x + rx, y)),
    ):
        if np.any(pen.at != to):
            pen.line(np.array(to))
        pen.arc(radii, 0.0, False, True, np.array(corner))
    pen.close()


def lay_ellipse(pen: Pen, x: float, y: float, rx: float, ry: float) -> None:
    """Draw an ellipse."""
    if rx > 0.0 and ry > 0.0:
        pen.whole(np.array([x, y]), np.array([rx, ry]))


def close(pieces: list[Piece]) -> None:
    """Close the pieces of a subpath whose inside is painted, as painting does."""
    first, last = pieces[0], pieces[-1]
    a, b = last.ends[1], first.ends[0]
    if not np.any(a != b):
        return
    if last.curve is None:
        pieces[-1] = Piece(np.concatenate([last.points, b[None]]))
    else:
        pieces.append(Piece(np.stack([a, b])))


def page_of(root: Element, source: str) -> Transform:
    """The map that turns y upwards within the page, if the drawing says how high that is."""
    where = f"{source}: line {root.line}"
    box = view_box(root, where)
    if box is not None:
        top = 2.0 * box[1] + box[3]
    else:
        height = root.attributes.get("height", "100%").strip()
        top = 0.0 if height.endswith("%") else length(root, "height", where)
    return Transform(np.array([[1.0, 0.0], [0.0, -1.0]]), np.array([0.0, top]))


def view_box(root: Element, where: str) -> tuple[float, float, float, float] | None:
    """The viewBox: x, y, width and height.

    Raises:
        DomainError: it is none.
    """
    given = root.attributes.get("viewBox")
    if given is None:
        return None
    numbers = points_in(given, f"{where}: viewBox").ravel().tolist()
    if len(numbers) != 4 or not np.isfinite(numbers).all():
        raise DomainError(f"{where}: a viewBox has four numbers; correct it")
    return numbers[0], numbers[1], numbers[2], numbers[3]


def units_note(root: Element, source: str) -> str:
    """What a unit of the drawing is on paper, if it says."""
    where = f"{source}: line {root.line}"
    box, given = view_box(root, where), root.attributes.get("width", "").strip()
    if not given or given.endswith("%"):
        return ""
    width, unit = length_in(given, "width", where)
    if unit in ("", "px") or (box is not None and not box[2] > 0.0):
        return ""
    size = 1.0 / PIXELS[unit] if box is None else width / box[2]
    return f"lengths are the drawing's units, {size:.6g} {unit} each; they are not converted"
