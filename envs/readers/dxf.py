"""DXF drawings: closed polylines, circles and chains of lines, arcs and splines become polygons.

Read are LINE, LWPOLYLINE, POLYLINE, ARC, CIRCLE, ELLIPSE and SPLINE of the model space and of the blocks inserted in
it, on layers that are neither frozen nor off; all else (text, dimensions, hatches) is passed over. Heights are ignored,
units are the drawing's.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from envs.polygons import curves
from envs.polygons.curves import Flattening
from envs.polygons.rings import LARGEST_COORDINATE, check_coordinates, check_count, extent
from envs.readers.loops import faces, joined
from envs.readers.nesting import nested
from envs.readers.source import excerpt
from envs.types import RELATIVE_TOLERANCE, DomainError, Floats

#: Ends closer than this share of the drawing's extent meet: drawings are often written with six digits.
ENDS_MEET = 1e-6

#: Entities of a drawing at most, those of blocks counted as often as they are inserted, ...
MOST_ENTITIES = 200_000

#: ... and inserted blocks among them.
MOST_BLOCKS = 10_000

#: Degree of a spline at most: what drawings have is 3, seldom 5 or more.
MOST_DEGREE = 25

READ = ("LINE", "LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE")


@dataclass(frozen=True)
class Stroke:
    """One entity, before its flattening.

    Attributes:
        hull: (k, 2) points about as far apart as the entity reaches.
        flattened: its (k, 2) points, the first one repeated at the end when it is closed.
        given: whether its ends are stated in the file, not computed from a centre and angles.
    """

    hull: Floats
    flattened: Callable[[Flattening], Floats]
    given: bool = True


def polygons_of_file(path: Path, edge_length: float | None = None) -> list[list[Any]]:
    """The rings of every polygon in a DXF drawing; loops inside loops are holes.

    Raises:
        DomainError: no DXF, no outline in it, or one that does not close.
    """
    source = str(path)
    drawing = drawing_of(path)
    try:
        entities = list(visible(drawing, source))
        strokes = [stroke for entity in entities for stroke in strokes_of(entity)]
        size = extent_of(strokes, entities, source)
        pieces = list(flattened(strokes, curves.flattening(size, edge_length), source))
    except DomainError:
        raise
    except Exception as error:  # what a broken entity makes ezdxf raise is not documented
        raise broken(source, error) from None
    return nested(loops_of(pieces, size, source), source)


def extent_of(strokes: Sequence[Stroke], entities: Sequence[Any], source: str) -> float:
    """Diagonal of the strokes' bounding box.

    Raises:
        DomainError: no strokes among the entities, or coordinates that are no places.
    """
    if not strokes:
        found = ", ".join(f"{n} {name}" for name, n in Counter(e.dxftype() for e in entities).most_common(5))
        raise DomainError(
            f"{source}: no outline among its {len(entities)} entities ({found or 'it is empty'}); draw closed curves "
            f"of {', '.join(READ)} in the model space"
        )
    hull = np.concatenate([stroke.hull for stroke in strokes])
    check_coordinates(hull, source)
    return extent(hull)


def drawing_of(path: Path) -> Any:
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
        except (ezdxf.DXFError, ValueError):  # type: ignore[attr-defined]
            return recover.readfile(path)[0]
    except Exception as error:  # nor what a broken file does
        raise broken(path, error) from None


def broken(source: str | Path, error: Exception) -> DomainError:
    """What to raise for a drawing that cannot be read."""
    reason = excerpt(str(error), 80) or type(error).__name__
    return DomainError(f"{source}: not a valid DXF drawing ({reason}); save it again as DXF R2000 or later")


def visible(drawing: Any, source: str) -> Iterator[Any]:
    """The entities that are seen in the model space, inserted blocks taken apart."""
    hidden = {layer.dxf.name.lower() for layer in drawing.layers if layer.is_off() or layer.is_frozen()}
    waiting = [iter(drawing.modelspace())]
    taken = blocks = 0
    while waiting:
        entity = next(waiting[-1], None)
        if entity is None:
            waiting.pop()
            continue
        taken += 1
        if entity.dxf.layer.lower() in hidden or entity.dxf.get("invisible", 0):
            continue
        inserting = entity.dxftype() == "INSERT"
        blocks += max(1, entity.mcount) if inserting else 0
        if taken > MOST_ENTITIES or blocks > MOST_BLOCKS:
            raise DomainError(
                f"{source}: more than {MOST_ENTITIES:,} entities or {MOST_BLOCKS:,} inserted blocks; "
                "remove what is no outline"
            )
        if inserting:
            waiting.append(inserted(entity))
        else:
            yield entity


def inserted(insert: Any) -> Iterator[Any]:
    """The entities of an inserted block, once for each place of an array of them."""
    places: Iterable[Any] = insert.multi_insert() if insert.mcount > 1 else (insert,)
    for one in places:
        yield from one.virtual_entities()


def strokes_of(entity: Any) -> Iterator[Stroke]:
    """What an entity draws: one stroke, or none."""
    entity_type = entity.dxftype()
    if entity_type == "LINE":
        ends = np.array([entity.dxf.start, entity.dxf.end])[:, :2]
        yield Stroke(ends, lambda _: ends)
    elif entity_type in ("ARC", "CIRCLE"):
        yield from round_stroke(entity)
    elif entity_type == "LWPOLYLINE":
        rows = np.array(entity.get_points("xyb"), dtype=np.float64).reshape(-1, 3)
        yield from polyline_stroke(rows[:, :2], rows[:, 2], entity.closed, entity.ocs())
    elif entity_type == "POLYLINE" and (entity.is_2d_polyline or entity.is_3d_polyline):
        # The frame of a spline-fit polyline does not belong to the curve.
        vertices = [vertex for vertex in entity.vertices if not vertex.dxf.flags & 16]
        points = np.array([vertex.dxf.location for vertex in vertices]).reshape(-1, 3)[:, :2]
        bulges = np.array([vertex.dxf.get("bulge", 0.0) for vertex in vertices])
        yield from polyline_stroke(points, bulges, entity.is_closed, entity.ocs() if entity.is_2d_polyline else None)
    elif entity_type == "ELLIPSE":
        yield from ellipse_stroke(entity)
    elif entity_type == "SPLINE":
        yield from spline_stroke(entity)


def round_stroke(entity: Any) -> Iterator[Stroke]:
    """An ARC, counter-clockwise in its own plane, or a CIRCLE."""
    centre, radius = np.array(entity.dxf.center)[:2], abs(float(entity.dxf.radius))
    whole = entity.dxftype() == "CIRCLE"
    start = 0.0 if whole else float(np.radians(entity.dxf.start_angle))
    sweep = 2 * np.pi if whole else float(np.radians(entity.dxf.end_angle)) - start
    if not whole:
        sweep = sweep % (2 * np.pi) or 2 * np.pi
    if not 0.0 < radius <= LARGEST_COORDINATE:
        return
    ocs = entity.ocs()

    def flat(fineness: Flattening) -> Floats:
        return in_world(curves.arc(centre, radius, start, sweep, fineness), ocs)

    yield Stroke(flat(Flattening(np.inf, np.inf, curves.TURN)), flat, given=False)


def polyline_stroke(points: Floats, bulges: Floats, closed: bool, ocs: Any) -> Iterator[Stroke]:
    """A polyline: bulge b makes of the segment after a vertex an arc of 4 arctan(b), positive counter-clockwise."""
    if closed:
        points, bulges = np.concatenate([points, points[:1]]), np.append(bulges, 0.0)
    apart = np.any(points[1:] != points[:-1], axis=1)
    points, bulges = points[np.append(apart, True)], bulges[np.append(apart, True)]
    if len(points) < 2:
        return
    if not bulges[:-1].any():
        world = in_world(points, ocs)
        yield Stroke(world, lambda _: world)
        return

    def flat(fineness: Flattening) -> Floats:
        sweeps = 4.0 * np.arctan(bulges[:-1])
        pieces, total = [], 0
        for a, b, sweep in zip(points[:-1], points[1:], sweeps, strict=True):
            pieces.append(curves.arc_between(a, b, float(sweep), fineness)[:-1] if sweep else a[None])
            total += len(pieces[-1])
            curves.check_chords(total)
        return in_world(np.concatenate([*pieces, points[-1:]]), ocs)

    yield Stroke(flat(Flattening(np.inf, np.inf, curves.TURN)), flat)


def ellipse_stroke(entity: Any) -> Iterator[Stroke]:
    """An ELLIPSE, whole or an arc of one; it lies in the world's coordinates."""
    centre, major, minor = (np.array(v)[:2] for v in (entity.dxf.center, entity.dxf.major_axis, entity.minor_axis))
    start = float(entity.dxf.start_param)
    sweep = (float(entity.dxf.end_param) - start) % (2 * np.pi)
    # A whole one may be off a full turn by rounding.
    if min(sweep, 2 * np.pi - sweep) < RELATIVE_TOLERANCE:
        sweep = 2 * np.pi

    def flat(fineness: Flattening) -> Floats:
        return curves.ellipse(centre, major, minor, start, sweep, fineness)

    yield Stroke(centre + np.array([major, -major, minor, -minor]), flat, given=False)


def spline_stroke(entity: Any) -> Iterator[Stroke]:
    """A SPLINE of any degree, rational or not, by control or by fit points."""
    if entity.dxf.degree > MOST_DEGREE:
        raise ValueError(f"a spline of degree {entity.dxf.degree}, at most {MOST_DEGREE} are read")
    from scipy.interpolate import BSpline  # half a second that other files need not wait

    spline = entity.construction_tool()
    knots, degree = np.array(spline.knots()), spline.order - 1
    breaks = np.unique(knots[degree : spline.count + 1])
    hull = np.array(spline.control_points)[:, :2]
    weights = np.array(spline.weights() or np.ones(len(hull)))
    rational = BSpline(knots, np.column_stack([hull * weights[:, None], weights]), degree)

    def at(t: Floats) -> Floats:
        points = rational(t)
        return points[:, :2] / points[:, 2:]

    if np.isfinite(hull).all() and np.isfinite(breaks).all() and len(breaks) > 1:
        yield Stroke(hull, lambda fineness: curves.sampled(at, breaks, fineness))


def in_world(points: Floats, ocs: Any) -> Floats:
    """(k, 2) points of an entity's own plane in the world's x and y; mirrored drawings differ in the two."""
    if ocs is None or not ocs.transform:
        return points
    return np.array([(p.x, p.y) for p in ocs.points_to_wcs((x, y, 0.0) for x, y in points.tolist())])


def flattened(strokes: Sequence[Stroke], fineness: Flattening, source: str) -> Iterator[Floats]:
    """The strokes as polylines, first those whose ends the file states: where ends meet, the first one's is kept."""
    total = 0
    for stroke in sorted(strokes, key=lambda stroke: not stroke.given):
        points = stroke.flattened(fineness)
        total += len(points)
        check_count(total, source)
        check_coordinates(points, source)
        yield points


def loops_of(pieces: Sequence[Floats], size: float, source: str) -> list[list[list[Floats]]]:
    """Groups of faces: each closed piece by itself, the open ones chained."""
    groups, loose = [], []
    for piece in pieces:
        steps = np.linalg.norm(np.diff(piece, axis=0), axis=1)
        piece = piece[np.append(True, steps > RELATIVE_TOLERANCE * size)]
        if len(piece) > 3 and np.linalg.norm(piece[0] - piece[-1]) <= ENDS_MEET * size:
            groups.append([[piece[:-1]]])
        elif len(piece) > 1:
            loose.append(piece)
    if loose:
        groups += faces(*joined(loose, ENDS_MEET * size, source), source)
    return groups
