"""DXF drawings: closed polylines, circles and chains of lines, arcs and splines become polygons.

Read are LINE, LWPOLYLINE, POLYLINE, ARC, CIRCLE, ELLIPSE and SPLINE of the model space and of the blocks inserted in
it, on layers that are neither frozen nor off, or on those asked for. Lines that bound nothing and all else (text,
dimensions, hatches) are passed over, with one note. Layers are the names of sides, or of regions. Heights are ignored,
units are the drawing's.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from envs.drawing import Drawing, Line, Reading
from envs.polygons import curves
from envs.polygons.rings import check_coordinates, extent, place
from envs.readers.dxf_entities import READ, Entity, entities_of, layers_of, pieces_of
from envs.readers.joins import option
from envs.readers.nesting import nested
from envs.readers.outlines import Face, Outlines, outlines
from envs.readers.pieces import Piece
from envs.readers.source import excerpt
from envs.types import DomainError, Floats

#: Ends closer than this share of the drawing's extent meet: drawings are often written with six digits.
ENDS_MEET = 1e-6

#: What is told by name in a note, of layers and of kinds of entities, at most.
MOST_TOLD = 6

#: The layer that is no name: every drawing has it.
NO_NAME = "0"

#: Units by their number in $INSUNITS.
UNITS = {
    1: "inches", 2: "feet", 3: "miles", 4: "millimetres", 5: "centimetres", 6: "metres", 7: "kilometres",
    8: "microinches", 9: "mils", 10: "yards", 11: "angstroms", 12: "nanometres", 13: "micrometres", 14: "decimetres",
}  # fmt: skip


def drawing_of_file(path: Path, reading: Reading) -> Drawing:
    """What a DXF drawing states; loops inside loops are holes.

    Raises:
        DomainError: no DXF, a layer that it has not, no outline in it, or one that does not close.
    """
    source = str(path)
    document = document_of(path)
    try:
        entities = list(entities_of(document, source, chosen_layers(document, reading.layers, source)))
        pieces = [piece for i, entity in enumerate(entities) for piece in pieces_of(entity.drawn, i)]
        size = extent_of(pieces, entities, source)
        # Where ends meet, the place that the file states is kept, not one computed from a centre and angles.
        pieces.sort(key=lambda piece: not entities[piece.entity].given)
        found = outlines(
            pieces, np.array([entity.broken for entity in entities], dtype=bool), size, ENDS_MEET * size,
            curves.flattening(size, reading.edge_length), source, join=reading.join,
        )  # fmt: skip
    except DomainError:
        raise
    except Exception as error:  # what a broken entity makes ezdxf raise is not documented
        raise broken(source, error) from None
    check_closed(found, source)
    return drawn(found, entities, document, source)


def chosen_layers(document: Any, wanted: Sequence[str], source: str) -> frozenset[str] | None:
    """The layers asked for, in lower case; None: all that are seen.

    Raises:
        DomainError: one that is not there.
    """
    if not wanted:
        return None
    there = layers_of(document)
    for name in wanted:
        if name.lower() not in there:
            known = ", ".join(excerpt(layer, 40) for layer in list(there.values())[:40])
            more = f" and {len(there) - 40} more" if len(there) > 40 else ""
            raise DomainError(f"{source}: no layer {excerpt(name, 40)!r}; it has {known}{more}")
    return frozenset(name.lower() for name in wanted)


def extent_of(pieces: Sequence[Piece], entities: Sequence[Entity], source: str) -> float:
    """Diagonal of the pieces' bounding box.

    Raises:
        DomainError: no pieces among the entities, or coordinates that are no places.
    """
    if not pieces:
        found = ", ".join(f"{n} {kind}" for kind, n in Counter(e.drawn.dxftype() for e in entities).most_common(5))
        raise DomainError(
            f"{source}: no outline among its {len(entities)} entities ({found or 'it is empty'}); draw closed curves "
            f"of {', '.join(READ)} in the model space"
        )
    places = np.concatenate([piece.rough for piece in pieces])
    check_coordinates(places, source)
    return extent(places)


def document_of(path: Path) -> Any:
    """The drawing in a file, repaired where ezdxf can."""
    try:
        import ezdxf
        from ezdxf import recover
    except ImportError:
        raise DomainError(f"{path}: DXF needs ezdxf; use pip install ezdxf") from None
    # Its warnings about what it repaired would go to the terminal.
    logger = logging.getLogger("ezdxf")
    if not logger.handlers:
        logger.addHandler(logging.NullHandler())
    try:
        try:
            return ezdxf.readfile(path)
        except Exception:  # a broken file makes it raise anything
            return recover.readfile(path)[0]
    except Exception as error:  # nor what a broken file does
        raise broken(path, error) from None


def broken(source: str | Path, error: Exception) -> DomainError:
    """What to raise for a drawing that cannot be read."""
    reason = excerpt(str(error), 80) or type(error).__name__
    return DomainError(f"{source}: not a valid DXF drawing ({reason}); save it again as DXF R2000 or later")


def check_closed(found: Outlines, source: str) -> None:
    """Refuse a drawing of which nothing closes, or an outline of it that nearly does.

    Raises:
        DomainError: the gap with its places, and the option that joins it.
    """
    gap = found.slip if found.groups else next(iter(found.gaps), None)
    if gap is not None:
        a, b = gap.told
        raise DomainError(
            f"{source}: a curve ends at {a} and no other begins there, the nearest open end is {gap.width:.3g} away at "
            f"{b}; join them with {option(gap.width)}, or choose the layers to read"
        )
    if not found.groups:
        tip = found.left[0].ends[1] if found.left else np.zeros(2)
        raise DomainError(f"{source}: a curve ends at {place(tip)} and no other begins there; close the outline")


def drawn(found: Outlines, entities: Sequence[Entity], document: Any, source: str) -> Drawing:
    """The drawing of what was found."""
    all_faces = {id(face.rings[0]): face for group in found.groups for face in group}
    polygons = nested([[face.rings for face in group] for group in found.groups], source)
    layers = [layer_of(all_faces[id(rings[0])], entities) for rings in polygons]
    several = len({layer for layer in layers if layer is not None}) > 1
    regions = tuple(layer or "" if several else "" for layer in layers)
    # What names a region names no side.
    silent = {name for name in regions if name}
    # Where two lie on one side the first one's name counts.
    lines = [*optional_lines(found, entities), *found_lines(found, entities, silent)]
    notes = [note for note in (joined_note(found), left_note(found, entities), units_note(document)) if note]
    return Drawing(polygons, regions if any(regions) else (), lines, notes=notes)


def layer_of(face: Face, entities: Sequence[Entity]) -> str | None:
    """The one layer that a face's outer ring was drawn on, empty for the layer that is no name; None: several."""
    layers = {name_of(entities[i].layer) for i in face.around}
    return layers.pop() if len(layers) == 1 else None


def name_of(layer: str) -> str:
    """The name that a layer gives."""
    return "" if layer == NO_NAME else layer


def found_lines(found: Outlines, entities: Sequence[Entity], silent: set[str]) -> Iterable[Line]:
    """The sides that have a name or a curve; the layers that are names of regions give none."""
    for side in found.sides:
        name = name_of(entities[side.piece.entity].layer)
        name = "" if name in silent else name
        if name or side.piece.curve is not None:
            yield Line(side.points, name=name, curve=side.piece.curve)


def optional_lines(found: Outlines, entities: Sequence[Entity]) -> Iterable[Line]:
    """What bounds nothing, and what was drawn upon a side: it names what lies on it."""
    for piece in (*found.beside, *found.left):
        name = name_of(entities[piece.entity].layer)
        if name:
            yield Line(piece.fine, name=name, curve=piece.curve, optional=True)


def joined_note(found: Outlines) -> str:
    """What was joined."""
    if not found.joined:
        return ""
    return f"joined {counted(len(found.joined), 'gap')} of up to {max(found.joined):.3g}"


def left_note(found: Outlines, entities: Sequence[Entity]) -> str:
    """What was passed over, by kind and layer, and what keeps lines from closing."""
    open_ones = {piece.entity for piece in found.left}
    kinds: dict[str, Counter[str]] = {}
    for i, entity in enumerate(entities):
        kind = entity.drawn.dxftype()
        if i in open_ones:
            kind = "open line"
        elif kind in READ:
            continue
        kinds.setdefault(kind, Counter())[entity.layer] += 1
    if not kinds:
        return ""
    told = [
        f"{counted(sum(layers.values()), kind)} ({some(layers)})"
        for kind, layers in sorted(kinds.items(), key=lambda item: -sum(item[1].values()))[:MOST_TOLD]
    ]
    more = sum(sum(layers.values()) for layers in kinds.values()) - sum(
        sum(layers.values()) for layers in sorted(kinds.values(), key=lambda c: -sum(c.values()))[:MOST_TOLD]
    )
    line = f"passed over: {', '.join(told)}{f' and {more} others' if more else ''}"
    for gap in found.gaps[:1]:
        a, b = gap.told
        line += f"; ends at {a} and {b} are {gap.width:.3g} apart, {option(gap.width)} joins them"
    return line


def counted(number: int, kind: str) -> str:
    """A number of things; what is in capitals has no plural."""
    return f"{number} {kind}" if number == 1 or kind.isupper() else f"{number} {kind}s"


def some(layers: Counter[str]) -> str:
    """The layers with most."""
    names = [excerpt(layer, 40) for layer, _ in layers.most_common(MOST_TOLD)]
    word = "layer" if len(layers) == 1 else "layers"
    return f"{word} {', '.join(names)}{', ...' if len(layers) > MOST_TOLD else ''}"


def units_note(document: Any) -> str:
    """The drawing's units, if it tells any."""
    unit = UNITS.get(int(document.header.get("$INSUNITS", 0)))
    return f"lengths are {unit}, the drawing's units ($INSUNITS); they are not converted" if unit else ""
