"""DXF drawings: closed polylines, circles and chains of lines, arcs and splines become polygons.

Read are LINE, LWPOLYLINE, POLYLINE, ARC, CIRCLE, ELLIPSE and SPLINE of the model space and of the blocks inserted in
it, on layers that are neither frozen nor off, or on those asked for. Lines that bound nothing and all else (text,
dimensions, hatches) are passed over, with one note. Layers are the names of sides, or of regions. Heights are ignored,
units are the drawing's.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from envs.polygons import curves
from envs.polygons.drawing import Drawing, Reading
from envs.polygons.rings import check_coordinates, extent
from envs.readers.drawn import check_closed, counted, drawn, gap_note
from envs.readers.dxf_entities import READ, Entity, entities_of, layers_of, pieces_of
from envs.readers.file_check import excerpt
from envs.readers.outline_search import Outlines, outlines
from envs.readers.pieces import Piece
from envs.types import DomainError

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
    check_closed(found, "choose the layers to read", source)
    names = ["" if entity.layer == NO_NAME else entity.layer for entity in entities]
    return drawn(found, names, (left_note(found, entities), units_note(document)), source)


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
    order = sorted(kinds.items(), key=lambda item: -item[1].total())
    told = [f"{counted(layers.total(), kind)} ({some(layers)})" for kind, layers in order[:MOST_TOLD]]
    more = sum(layers.total() for _, layers in order[MOST_TOLD:])
    return f"passed over: {', '.join(told)}{f' and {more} others' if more else ''}{gap_note(found)}"


def some(layers: Counter[str]) -> str:
    """The layers with most."""
    names = [excerpt(layer, 40) for layer, _ in layers.most_common(MOST_TOLD)]
    word = "layer" if len(layers) == 1 else "layers"
    return f"{word} {', '.join(names)}{', ...' if len(layers) > MOST_TOLD else ''}"


def units_note(document: Any) -> str:
    """The drawing's units, if it tells any."""
    unit = UNITS.get(int(document.header.get("$INSUNITS", 0)))
    return f"lengths are {unit}, the drawing's units ($INSUNITS); they are not converted" if unit else ""
