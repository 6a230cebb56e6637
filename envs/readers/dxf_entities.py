"""The entities of a DXF drawing that are seen, with their layers and line types, and the pieces that each draws."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from envs.polygons.exact_curves import ParametricCurve, Rational
from envs.polygons.rings import LARGEST_COORDINATE
from envs.readers.pieces import Piece, arc_piece
from envs.types import RELATIVE_TOLERANCE, DomainError, Floats

#: Entities of a drawing at most, those of blocks counted as often as they are inserted, ...
MOST_ENTITIES = 200_000

#: ... and inserted blocks among them.
MOST_BLOCKS = 10_000

#: Degree of a spline at most: what drawings have is 3, seldom 5 or more.
MOST_DEGREE = 25

READ = ("LINE", "LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE")

#: Line types that are not broken.
UNBROKEN = ("continuous", "bylayer", "byblock", "")


@dataclass(frozen=True)
class Entity:
    """One entity.

    Attributes:
        drawn: it, as ezdxf has it, in the world's coordinates.
        layer: the one it counts for: in a block, what lies on layer 0 is on the layer that the block is inserted on.
        broken: whether its line type is dashed, dotted or of centre lines.
    """

    drawn: Any
    layer: str
    broken: bool

    @property
    def given(self) -> bool:
        """Whether its ends are stated in the file, not computed from a centre and angles."""
        return self.drawn.dxftype() not in ("ARC", "CIRCLE", "ELLIPSE")


@dataclass(frozen=True)
class Inserted:
    """What the insertion of a block gives to what lies in it.

    Attributes:
        layer: to what lies on layer 0.
        line_type: to what is drawn by block.
    """

    layer: str = "0"
    line_type: str = ""


def layers_of(document: Any) -> dict[str, str]:
    """The names of a drawing's layers, those that only entities name among them, by their lower case, in order."""
    there = {layer.dxf.name.lower(): str(layer.dxf.name) for layer in document.layers}
    for entity in document.entitydb.values():
        if entity.dxf.is_supported("layer") and (layer := entity.dxf.get("layer")):
            there.setdefault(layer.lower(), layer)
    return dict(sorted(there.items()))


def entities_of(document: Any, source: str, chosen: frozenset[str] | None) -> Iterator[Entity]:
    """The entities that are seen in the model space, inserted blocks taken apart.

    Args:
        document: a drawing.
        source: the name that messages begin with.
        chosen: the layers asked for, in lower case, even if they are off; None: all but those.

    Raises:
        DomainError: too many.
    """
    line_types = {layer.dxf.name.lower(): layer.dxf.get("linetype", "") for layer in document.layers}
    hidden = {layer.dxf.name.lower() for layer in document.layers if layer.is_off() or layer.is_frozen()}
    hidden -= chosen or frozenset()
    waiting = [(iter(document.modelspace()), Inserted())]
    taken = blocks = 0
    while waiting:
        entity = next(waiting[-1][0], None)
        if entity is None:
            waiting.pop()
            continue
        around = waiting[-1][1]
        taken += 1
        layer = str(entity.dxf.get("layer", "0"))
        layer = around.layer if layer == "0" else layer
        if layer.lower() in hidden or entity.dxf.get("invisible", 0):
            continue
        inserting = entity.dxftype() == "INSERT"
        blocks += max(1, entity.mcount) if inserting else 0
        if taken > MOST_ENTITIES or blocks > MOST_BLOCKS:
            raise DomainError(
                f"{source}: more than {MOST_ENTITIES:,} entities or {MOST_BLOCKS:,} inserted blocks; "
                "remove what is no outline"
            )
        line_type = str(entity.dxf.get("linetype", "BYLAYER")).lower()
        if line_type == "byblock":
            line_type = around.line_type
        elif line_type == "bylayer":
            line_type = str(line_types.get(layer.lower(), "")).lower()
        if inserting:
            waiting.append((inserted(entity), Inserted(layer, line_type)))
        elif chosen is None or layer.lower() in chosen:
            yield Entity(entity, layer, line_type not in UNBROKEN)


def inserted(insert: Any) -> Iterator[Any]:
    """The entities of an inserted block, once for each place of an array of them."""
    if not insert.dxf.zscale:  # heights are ignored, and nothing can be turned in a space that is flattened
        insert.dxf.zscale = 1.0
    places: Iterable[Any] = insert.multi_insert() if insert.mcount > 1 else (insert,)
    for one in places:
        yield from one.virtual_entities()


def pieces_of(entity: Any, number: int) -> Iterator[Piece]:
    """What an entity draws, end to end; nothing when it draws no curve.

    Args:
        entity: as ezdxf has it.
        number: of the entity.
    """
    entity_type = entity.dxftype()
    if entity_type == "LINE":
        yield from straight(np.array([entity.dxf.start, entity.dxf.end])[:, :2], number)
    elif entity_type in ("ARC", "CIRCLE"):
        yield from round_pieces(entity, number)
    elif entity_type == "LWPOLYLINE":
        rows = np.array(entity.get_points("xyb"), dtype=np.float64).reshape(-1, 3)
        height = float(entity.dxf.get("elevation", 0.0))
        yield from polyline_pieces(rows[:, :2], rows[:, 2], entity.closed, Plane.of(entity.ocs(), height), number)
    elif entity_type == "POLYLINE" and (entity.is_2d_polyline or entity.is_3d_polyline):
        # The frame of a spline-fit polyline does not belong to the curve.
        vertices = [vertex for vertex in entity.vertices if not vertex.dxf.flags & 16]
        places = np.array([vertex.dxf.location for vertex in vertices]).reshape(-1, 3)
        bulges = np.array([vertex.dxf.get("bulge", 0.0) for vertex in vertices])
        height = float(places[0, 2]) if len(places) else 0.0
        plane = Plane.of(entity.ocs() if entity.is_2d_polyline else None, height)
        yield from polyline_pieces(places[:, :2], bulges, entity.is_closed, plane, number)
    elif entity_type == "ELLIPSE":
        yield from ellipse_pieces(entity, number)
    elif entity_type == "SPLINE":
        yield from spline_pieces(entity, number)


@dataclass(frozen=True)
class Plane:
    """An entity's own plane, seen from above: origin + x u + y v; mirrored drawings differ from the world in it.

    Attributes:
        origin, u, v: (2,) float64.
    """

    origin: Floats
    u: Floats
    v: Floats

    @classmethod
    def of(cls, ocs: Any, height: float) -> Plane | None:
        """An entity's plane at a height; None: it is the world's."""
        if ocs is None or not ocs.transform:
            return None
        axes = np.array([ocs.ux, ocs.uy, ocs.uz], dtype=np.float64)[:, :2]
        return cls(height * axes[2], axes[0], axes[1])

    def placed(self, points: Floats) -> Floats:
        """(k, 2) points of the plane in the world's x and y."""
        return np.asarray(self.origin + points[:, :1] * self.u + points[:, 1:] * self.v)


def straight(points: Floats, number: int) -> Iterator[Piece]:
    """A straight piece through (k, 2) points, if there is a way between any."""
    if len(points) > 1 and np.any(points[1:] != points[:-1]):
        yield Piece(points, entity=number)


def arc(
    centre: Floats,
    radius: float,
    start: float,
    sweep: float,
    plane: Plane | None,
    number: int,
    ends: Floats | None = None,
) -> Piece:
    """An arc in an entity's plane; the ends are those in the world, if the file states them."""
    if plane is None:
        return arc_piece(centre, np.array([radius, 0.0]), np.array([0.0, radius]), start, sweep, ends, number)
    return arc_piece(plane.placed(centre[None])[0], radius * plane.u, radius * plane.v, start, sweep, ends, number)


def round_pieces(entity: Any, number: int) -> Iterator[Piece]:
    """An ARC, counter-clockwise in its own plane, or a CIRCLE."""
    centre, radius = np.array(entity.dxf.center, dtype=np.float64), abs(float(entity.dxf.radius))
    whole = entity.dxftype() == "CIRCLE"
    start = 0.0 if whole else float(np.radians(entity.dxf.start_angle))
    sweep = 2 * np.pi if whole else float(np.radians(entity.dxf.end_angle)) - start
    if not whole:
        sweep = sweep % (2 * np.pi) or 2 * np.pi
    if 0.0 < radius <= LARGEST_COORDINATE and np.isfinite([start, sweep]).all():
        yield arc(centre[:2], radius, start, sweep, Plane.of(entity.ocs(), float(centre[2])), number)


def polyline_pieces(points: Floats, bulges: Floats, closed: bool, plane: Plane | None, number: int) -> Iterator[Piece]:
    """A polyline: bulge b makes of the segment after a vertex an arc of 4 arctan(b), positive counter-clockwise."""
    if closed:
        points, bulges = np.concatenate([points, points[:1]]), np.append(bulges, 0.0)
    apart = np.any(points[1:] != points[:-1], axis=1)
    points, bulges = points[np.append(apart, True)], bulges[np.append(apart, True)]
    if len(points) < 2:
        return
    world = points if plane is None else plane.placed(points)
    # A bulge so small that rounding makes a line of it.
    bent = np.flatnonzero(np.abs(bulges[:-1]) > RELATIVE_TOLERANCE)
    before = 0
    for i in bent.tolist():
        yield from straight(world[before : i + 1], number)
        a, b, sweep = points[i], points[i + 1], 4.0 * float(np.arctan(bulges[i]))
        chord, half = b - a, 0.5 * (b - a)
        centre = a + half + np.array([-chord[1], chord[0]]) / (2.0 * np.tan(sweep / 2.0))
        start = float(np.arctan2(*(a - centre)[::-1]))
        radius = float(np.hypot(*half)) / abs(np.sin(sweep / 2.0))
        yield arc(centre, radius, start, sweep, plane, number, world[i : i + 2])
        before = i + 1
    yield from straight(world[before:], number)


def ellipse_pieces(entity: Any, number: int) -> Iterator[Piece]:
    """An ELLIPSE, whole or an arc of one; it lies in the world's coordinates."""
    centre, major, minor = (np.array(v)[:2] for v in (entity.dxf.center, entity.dxf.major_axis, entity.minor_axis))
    start = float(entity.dxf.start_param)
    sweep = (float(entity.dxf.end_param) - start) % (2 * np.pi)
    # A whole one may be off a full turn by rounding.
    if min(sweep, 2 * np.pi - sweep) < RELATIVE_TOLERANCE:
        sweep = 2 * np.pi
    if np.isfinite([start, sweep]).all() and np.any(major) and np.any(minor):
        yield arc_piece(centre, major, minor, start, sweep, entity=number)


def spline_pieces(entity: Any, number: int) -> Iterator[Piece]:
    """A SPLINE of any degree, rational or not, by control or by fit points."""
    if entity.dxf.degree > MOST_DEGREE:
        raise ValueError(f"a spline of degree {entity.dxf.degree}, at most {MOST_DEGREE} are read")
    from scipy.interpolate import BSpline  # half a second that other files need not wait

    spline = entity.construction_tool()
    knots, degree = np.array(spline.knots()), spline.order - 1
    breaks = np.unique(knots[degree : spline.count + 1])
    hull = np.array(spline.control_points)[:, :2]
    weights = np.array(spline.weights() or np.ones(len(hull)))
    if not (np.isfinite(hull).all() and np.isfinite(breaks).all() and len(breaks) > 1):
        return
    if np.all(weights == weights[0]):
        curve = ParametricCurve(BSpline(knots, hull, degree), breaks)
    else:
        curve = ParametricCurve(
            Rational(BSpline(knots, np.column_stack([hull * weights[:, None], weights]), degree)), breaks
        )
    yield Piece(np.zeros((0, 2)), curve, (float(breaks[0]), float(breaks[-1])), number)
