"""Outlines among the pieces of a drawing: closed curves, chains that close, and the regions that dividing lines make.

::

    +---------+---+      closed curves, chains that close        the regions that they bound
    |   ( )   |   |      a line that ends on them at both ends   divides the region
    | -  -  - | - |-     lines that end in the open, and         passed over
    +---------+---+      those of a broken line type
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from scipy.spatial import cKDTree

from envs.polygons.curves import Flattening
from envs.polygons.rings import check_coordinates, check_count, place
from envs.readers.closed_loops import loop, regions_and_strays
from envs.readers.joins import SLIP, Gap, gaps, joined
from envs.readers.nesting import Rings
from envs.readers.piece_network import (
    Chords,
    Network,
    Splits,
    covered,
    crossings,
    folded,
    leads_on,
    lies_on,
    middle_of,
    network_of,
    split,
    touching,
    touching_vertices,
    without_copies,
)
from envs.readers.pieces import Piece
from envs.types import RELATIVE_TOLERANCE, Floats, Ints

#: Gaps are looked for up to this share of the drawing's extent.
REACH = 0.02


#: The entities that close by themselves, each with its pieces.
Closed = dict[int, list[Piece]]


@dataclass(frozen=True, eq=False)
class Side:
    """A piece of an outline, flattened.

    Attributes:
        points: (k, 2) the vertices that the rings have there.
        piece: it.
        entities: what it was drawn as: its own entity, and those that it was drawn as once more.
    """

    points: Floats
    piece: Piece
    entities: frozenset[int]


@dataclass(frozen=True, eq=False)
class Face:
    """A region.

    Attributes:
        rings: the outer one first, each (n, 2).
        around: the sides of its outer ring.
    """

    rings: Rings
    around: list[Side]


@dataclass(frozen=True, eq=False)
class Outlines:
    """What is found among the pieces.

    Attributes:
        groups: the faces of each connected part.
        sides: the pieces that bound them.
        beside: pieces that lie on these, drawn once more.
        left: pieces that bound nothing.
        joined: how far ends were apart that were joined on request.
        gaps: where open ends nearly meet, the smallest first.
    """

    groups: list[list[Face]]
    sides: list[Side]
    beside: list[Piece]
    left: list[Piece]
    joined: list[float] = field(default_factory=list)
    gaps: list[Gap] = field(default_factory=list)

    @property
    def slip(self) -> Gap | None:
        """The widest gap that can be nothing else than an outline that should close; None when there is none."""
        return next((gap for gap in reversed(self.gaps) if gap.outline and gap.share <= SLIP), None)

    @property
    def tip(self) -> str:
        """Where a piece that bounds nothing ends, as messages show it; empty when there is none."""
        return place(self.left[0].ends[1]) if self.left else ""


def outlines(
    pieces: Sequence[Piece],
    aids: np.ndarray,
    size: float,
    tolerance: float,
    fineness: Flattening,
    source: str,
    *,
    join: float | None = None,
) -> Outlines:
    """The outlines among pieces.

    Args:
        pieces: those of one entity in a row, end to end; where ends meet, the first one's place is kept.
        aids: (e,) bool, which entities are of a broken line type: they count where they close what others leave open,
            or where there is no outline without them.
        size: the drawing's extent.
        tolerance: within which ends meet.
        fineness: of the vertices on curves.
        source: the name that messages begin with.
        join: within which open ends are joined; None: they are not.

    Raises:
        DomainError: too many vertices, or pieces that meet at too many places.
    """
    pieces = [clean for piece in pieces if (clean := without_repeats(piece, RELATIVE_TOLERANCE * size)) is not None]
    aids = aids[np.array([piece.entity for piece in pieces], dtype=np.int64)]
    needed = ~aids | closing(pieces, aids, tolerance, source)
    found = outlines_of([p for p, n in zip(pieces, needed, strict=True) if n], size, tolerance, fineness, source, join)
    if found.groups or needed.all():
        found.left.extend(p for p, n in zip(pieces, needed, strict=True) if not n)
        return found
    return outlines_of(pieces, size, tolerance, fineness, source, join)


def without_repeats(piece: Piece, least: float) -> Piece | None:
    """A piece without vertices that repeat the one before; None when nothing is left of it."""
    if piece.curve is not None:
        return piece
    steps = np.linalg.norm(np.diff(piece.points, axis=0), axis=1)
    if steps.min(initial=np.inf) > least:
        return piece
    points = piece.points[np.append(True, steps > least)]
    return Piece(points, entity=piece.entity) if len(points) > 1 else None


def closing(pieces: Sequence[Piece], aids: np.ndarray, tolerance: float, source: str) -> np.ndarray:
    """(p,) bool: the pieces of broken line types between two open ends of others, as the axis of a drawn half."""
    found = np.zeros(len(pieces), dtype=bool)
    solid = [piece for piece, aid in zip(pieces, aids, strict=True) if not aid]
    if not solid or not aids.any():
        return found
    network = network_of(solid, tolerance, source)
    open_ends = network.places[network.meeting == 1]
    if len(open_ends) < 2:
        return found
    chosen = np.flatnonzero(aids)
    tips = np.array([pieces[i].ends for i in chosen.tolist()]).reshape(-1, 2)
    off, at = cKDTree(open_ends).query(tips)
    off, at = off.reshape(-1, 2), at.reshape(-1, 2)
    found[chosen] = (off <= tolerance).all(axis=1) & (at[:, 0] != at[:, 1])
    return found


def outlines_of(
    pieces: Sequence[Piece], size: float, tolerance: float, fineness: Flattening, source: str, join: float | None
) -> Outlines:
    """The outlines among pieces of which all count; see `outlines`."""
    closed = closed_entities(pieces, tolerance)
    open_ones = np.array([piece.entity not in closed for piece in pieces], dtype=bool)
    twice = covered(pieces, open_ones, tolerance, source)
    beside = [piece for piece, other in zip(pieces, twice, strict=True) if other]
    pieces = [piece for piece, other in zip(pieces, twice, strict=True) if not other]
    if not pieces:
        return Outlines([], [], beside, [])
    network = network_of(pieces, tolerance, source)
    network = split(network, touching(network, nodes_of_open(network, closed), tolerance)[0])
    widths = list[float]()
    if join is not None and join > tolerance:
        network, widths = joined(network, join)
    back = folded(network)
    left = network.kept(back).pieces
    network = network.kept(~back)
    leading = leads_on(network)
    left += network.kept(~leading).settled()
    bounding, copies = divided(network.kept(leading), closed)
    beside += copies
    groups, sides = faces(bounding, beside, closed, fineness, source)
    used = {id(side.piece) for side in sides}
    left += [piece for piece in bounding.pieces if id(piece) not in used]
    return Outlines(groups, sides, beside, left, widths, list(gaps(network, REACH * size)))


def closed_entities(pieces: Sequence[Piece], tolerance: float) -> Closed:
    """The entities whose pieces, one after the other, close, and these pieces."""
    of: dict[int, list[Piece]] = {}
    for piece in pieces:
        of.setdefault(piece.entity, []).append(piece)
    return {
        entity: row
        for entity, row in of.items()
        if np.hypot(*(row[0].ends[0] - row[-1].ends[1])) <= tolerance
        and (len(row) > 1 or row[0].curve is not None or len(row[0].points) > 3)
    }


def nodes_of_open(network: Network, closed: Closed) -> Ints:
    """The nodes that pieces of open entities end at."""
    chosen = [piece.entity not in closed for piece in network.pieces]
    return np.unique(network.ends[np.array(chosen, dtype=bool)])


def divided(network: Network, closed: Closed) -> tuple[Network, list[Piece]]:
    """The network with its pieces split where dividing lines cross others, and what of it was drawn once more."""
    dividing = complex_ones(network, closed)
    if not dividing.any():
        return network, []
    network = split(network, crossings(network, dividing & is_open(network, closed)))
    inside = complex_ones(network, closed)
    part = touching_vertices(network.kept(inside))
    network = split(network, Splits(np.flatnonzero(inside)[part.piece], part.parameter, part.node))
    network, copies = without_copies(network, complex_ones(network, closed))
    return network.kept(leads_on(network)), copies


def is_open(network: Network, closed: Closed) -> np.ndarray:
    """(p,) bool: the pieces of open entities."""
    return np.array([piece.entity not in closed for piece in network.pieces], dtype=bool)


def complex_ones(network: Network, closed: Closed) -> np.ndarray:
    """(p,) bool: the pieces of connected parts where three or more ends meet, those of open entities among them."""
    part = network.components
    most = np.zeros(part.max(initial=0) + 1, dtype=np.int64)
    np.maximum.at(most, part, network.meeting[network.ends].max(axis=1, initial=0))
    some = np.zeros(len(most), dtype=bool)
    some[part[is_open(network, closed)]] = True
    return ((most > 2) & some)[part]


def faces(
    network: Network, beside: Sequence[Piece], closed: Closed, fineness: Flattening, source: str
) -> tuple[list[list[Face]], list[Side]]:
    """The faces of each connected part, in the order of their pieces, and the sides that bound them.

    Closed entities that no open one connects are faces of their own, even if they touch. Of a face that only open
    entities bound the inside is solid; otherwise the even-odd rule tells.
    """
    sides, total = list[Side](), 0
    for piece, ends, entities in zip(network.pieces, network.ends, entities_of(network, beside), strict=True):
        points = piece.flattened(fineness).copy()
        points[0], points[-1] = network.places[ends]
        total += len(points)
        check_count(total, source)
        check_coordinates(points, source)
        sides.append(Side(points, piece, entities))
    dividing = complex_ones(network, closed)
    opened = is_open(network, closed)
    parts = np.split(np.argsort(network.components, kind="stable"), np.cumsum(np.bincount(network.components))[:-1])
    parts = sorted((part for part in parts if len(part)), key=lambda part: int(part.min()))
    groups: list[tuple[int, list[Face]]] = []
    bounding = list[int]()
    for part in parts:
        if dividing[part[0]]:
            found, strays = regions(sides, part, closed, fineness)
            kept = sorted(set(part.tolist()) - strays)
        elif opened[part].any():
            ring = loop([side.points for side in sides], network.ends, part)
            found, kept = [Face([ring], [sides[i] for i in part])], part.tolist()
        else:
            kept = part.tolist()
            by_entity: dict[int, list[int]] = {}
            for i in kept:
                by_entity.setdefault(sides[i].piece.entity, []).append(i)
            for row in by_entity.values():
                ring = np.concatenate([sides[i].points[:-1] for i in row])
                groups.append((row[0], [Face([ring], [sides[i] for i in row])]))
            found = []
        if found:
            groups.append((int(part.min()), found))
        if found or not opened[part].any():
            bounding += kept
    groups.sort(key=lambda group: group[0])
    return [found for _, found in groups], [sides[i] for i in sorted(bounding)]


def regions(sides: Sequence[Side], part: Ints, closed: Closed, fineness: Flattening) -> tuple[list[Face], set[int]]:
    """The faces of a connected part, and the pieces that bound none of them."""
    lines = [sides[i].points for i in part.tolist()]
    rings, strays = regions_and_strays(lines)
    owner = {key: i for i, line in zip(part.tolist(), lines, strict=True) for key in ends_of(line)}
    outside = {owner[key] for stray in strays for key in ends_of(stray) if key in owner}
    solid = closed_polygons({sides[i].piece.entity for i in part.tolist()}, closed, fineness)
    tree = shapely.STRtree(solid)
    inner = shapely.point_on_surface([shapely.Polygon(face[0], face[1:]) for face in rings])
    depth = np.bincount(tree.query(inner, predicate="within")[0], minlength=len(rings)) if len(solid) else None
    found = []
    for f, face in enumerate(rings):
        if depth is not None and depth[f] and depth[f] % 2 == 0:
            continue
        outer = np.concatenate([face[0], face[0][:1]])
        pairs = np.concatenate([outer[:-1], outer[1:]], axis=1)
        around = {owner.get(key) for key in keys_of(pairs)} - {None}
        found.append(Face(face, [sides[i] for i in around if i is not None]))
    return found, outside


def keys_of(segments: Floats) -> list[tuple[float, ...]]:
    """What (m, 4) segments x, y, u, v are known by, whichever end comes first."""
    x, y, u, v = segments.T
    kept = (x < u) | ((x == u) & (y <= v))
    return [tuple(row) for row in np.where(kept[:, None], segments, segments[:, [2, 3, 0, 1]]).tolist()]


def ends_of(line: Floats) -> list[tuple[float, ...]]:
    """What the first and the last segment of a line are known by."""
    return keys_of(np.concatenate([line[[0, -2]], line[[1, -1]]], axis=1))


def entities_of(network: Network, beside: Sequence[Piece]) -> list[frozenset[int]]:
    """For each piece the entities that it was drawn as, those of pieces beside it that it lies on among them."""
    found = [{piece.entity} for piece in network.pieces]
    if beside and network.pieces:
        chords = Chords.of(beside)
        middles = np.array([piece.at(np.array([middle_of(piece)]))[0] for piece in network.pieces])
        at, chord = chords.near(middles, network.tolerance, network.source)
        for i, j in np.unique(np.stack([at, chords.piece[chord]], axis=1), axis=0).tolist():
            if lies_on(network.pieces[i], beside[j], 2.0 * network.tolerance):
                found[i].add(beside[j].entity)
    return [frozenset(entities) for entities in found]


def closed_polygons(entities: set[int], closed: Closed, fineness: Flattening) -> list[shapely.Polygon]:
    """What those of the entities that close enclose, each; broken ones are left out."""
    rings = [np.concatenate([p.flattened(fineness)[:-1] for p in closed[e]]) for e in sorted(entities & closed.keys())]
    found = [shapely.Polygon(ring) for ring in rings if len(ring) > 2]
    return [polygon for polygon in found if polygon.is_valid]
