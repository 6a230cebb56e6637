"""Pieces of a drawing as a network: which ends meet, which lie on other pieces, and which lead nowhere.

::

    a--------b-----c       The pieces a-c, c-d, d-f, f-a and, dividing the region, e-b: its end b lies on the piece a-c,
    |        |     |       which is split there. The piece g-h ends in the open at h: it bounds nothing and is dropped.
    |        |     |
    f--------e--g--d
                |
                h
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from envs.polygons.rings import pairs_of
from envs.readers.pieces import FINER, Piece
from envs.types import DomainError, Floats, Ints

#: Pairs of different places that meet, and of places and pieces, at most.
MOST_MEETING = 5_000_000

#: Crossings of dividing lines with others, at most.
MOST_CROSSINGS = 100_000

#: Steps to where two pieces cross at most, of which each doubles the digits.
STEPS = 20

#: Places of a piece that are looked at to tell whether it lies on another.
PROBES = 9


@dataclass(frozen=True, eq=False)
class Network:
    """Pieces between nodes.

    Attributes:
        pieces: each with the node that it begins at and the node that it ends at.
        ends: (p, 2) int64, these nodes.
        places: (n, 2) float64 of the nodes.
        tolerance: distance within which places meet.
        source: the name that messages begin with.
    """

    pieces: list[Piece]
    ends: Ints
    places: Floats
    tolerance: float
    source: str

    @cached_property
    def meeting(self) -> Ints:
        """(n,) how many ends of pieces meet at each node."""
        return np.bincount(self.ends.ravel(), minlength=len(self.places))

    @cached_property
    def components(self) -> Ints:
        """(p,) a number for each piece, the same where pieces are connected."""
        n = len(self.places)
        graph = coo_array((np.ones(len(self.ends)), (self.ends[:, 0], self.ends[:, 1])), shape=(n, n))
        return connected_components(graph, directed=False)[1][self.ends[:, 0]].astype(np.int64)

    def kept(self, mask: np.ndarray) -> Network:
        """The network of the pieces that a (p,) mask is true for."""
        chosen = np.flatnonzero(mask)
        return Network([self.pieces[i] for i in chosen], self.ends[chosen], self.places, self.tolerance, self.source)

    def settled(self) -> list[Piece]:
        """The pieces, with their ends where the nodes are."""
        return [
            piece.part(*piece.bounds, *self.places[ends]) for piece, ends in zip(self.pieces, self.ends, strict=True)
        ]


@dataclass(frozen=True, eq=False)
class Splits:
    """Where pieces are to be split.

    Attributes:
        piece: (s,) int64.
        parameter: (s,) float64 on it.
        node: (s,) int64, the node that is to sit there; -1: whichever is there, or a new one.
    """

    piece: Ints
    parameter: Floats
    node: Ints


def network_of(pieces: Sequence[Piece], tolerance: float, source: str) -> Network:
    """The network of pieces whose ends meet where they lie within a tolerance; the first one's place is kept.

    Raises:
        DomainError: a drawing so small beside its extent that all of its ends would meet.
    """
    tips = np.array([piece.ends for piece in pieces]).reshape(-1, 2)
    label, first = clusters(tips, tolerance, source)
    return Network(list(pieces), label.reshape(-1, 2), tips[first], tolerance, source)


def clusters(points: Floats, tolerance: float, source: str, also: Ints | None = None) -> tuple[Ints, Ints]:
    """Which of (m, 2) points are one place: (m,) its number, and for each place its first point.

    Args:
        also: (k, 2) pairs of points that are one, however far apart.
    """
    distinct, number = np.unique(points, axis=0, return_inverse=True)
    number = number.ravel()
    geometries = shapely.points(distinct)
    pairs, total = [np.zeros((2, 0), dtype=np.int64)], 0
    for i, j in pairs_of(shapely.STRtree(geometries), geometries, "dwithin", tolerance):
        pairs.append(np.stack([i, j]))
        total += len(i)
        if total > MOST_MEETING:
            raise too_dense(source, tolerance)
    if also is not None:
        pairs.append(number[also.T])
    i, j = np.concatenate(pairs, axis=1)
    near = coo_array((np.ones(len(i)), (i, j)), shape=(len(distinct), len(distinct)))
    label = connected_components(near, directed=False)[1][number].astype(np.int64)
    _, first = np.unique(label, return_index=True)
    return label, first


def too_dense(source: str, tolerance: float) -> DomainError:
    """What to raise for a drawing of which too much lies together."""
    return DomainError(
        f"{source}: too many curves end within {tolerance:.3g} of each other; remove what lies far from the rest"
    )


def touching(network: Network, nodes: Ints, tolerance: float) -> tuple[Splits, Floats]:
    """Where (k,) nodes lie on pieces, between their ends: the splits, and (s,) how far the nodes are from there."""
    chords = Chords.of(network.pieces)
    points = network.places[nodes]
    at, chord = chords.near(points, tolerance, network.source)
    piece, node = chords.piece[chord], nodes[at]
    foreign = (network.ends[piece] != node[:, None]).all(axis=1)
    at, chord, piece, node = at[foreign], chord[foreign], piece[foreign], node[foreign]
    parameter, off = nearest(network.pieces, piece, chords.number[chord], points[at], tolerance)
    # Of several chords of a piece the nearest one counts.
    order = np.lexsort([off, node, piece])
    order = order[off[order] <= tolerance * (1.0 + 1e-9)]
    new = np.append(True, np.any(np.diff(np.stack([piece, node])[:, order], axis=1) != 0, axis=0))[: len(order)]
    order = order[new]
    return Splits(piece[order], parameter[order], node[order]), off[order]


def touching_vertices(network: Network) -> Splits:
    """Where the vertices of straight pieces, between their ends, lie on other pieces: there both are split."""
    counts = [len(inner(piece)) for piece in network.pieces]
    owner = np.repeat(np.arange(len(counts)), counts)
    if not len(owner):
        return Splits(np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int64))
    points = np.concatenate([inner(piece) for piece in network.pieces])
    index = np.concatenate([np.arange(1, len(inner(piece)) + 1) for piece in network.pieces])
    chords = Chords.of(network.pieces)
    at, chord = chords.near(points, network.tolerance, network.source)
    piece = chords.piece[chord]
    foreign = piece != owner[at]
    at, chord, piece = at[foreign], chord[foreign], piece[foreign]
    parameter, off = nearest(network.pieces, piece, chords.number[chord], points[at], network.tolerance)
    on = off <= network.tolerance
    at, piece, parameter = at[on], piece[on], parameter[on]
    both = Splits(
        np.concatenate([owner[at], piece]), np.concatenate([index[at].astype(np.float64), parameter]),
        np.full(2 * len(at), -1),
    )  # fmt: skip
    return both


def inner(piece: Piece) -> Floats:
    """(k, 2) the vertices of a straight piece between its ends; of a smooth one none."""
    return piece.points[1:-1] if piece.curve is None else piece.points[:0]


@dataclass(frozen=True, eq=False)
class Chords:
    """The chords between the rough places of pieces.

    Attributes:
        piece: (c,) int64 that each belongs to.
        number: (c,) int64 of the rough place that it begins at.
        starts, ends: (c, 2) float64.
        bulge: (c,) float64, how far its piece lies off it at most.
    """

    piece: Ints
    number: Ints
    starts: Floats
    ends: Floats
    bulge: Floats

    @classmethod
    def of(cls, pieces: Sequence[Piece]) -> Chords:
        """The chords of pieces."""
        counts = np.array([len(piece.rough) - 1 for piece in pieces])
        owner = np.repeat(np.arange(len(pieces)), counts)
        return cls(
            owner, np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts),
            np.concatenate([piece.rough[:-1] for piece in pieces]),
            np.concatenate([piece.rough[1:] for piece in pieces]),
            np.array([piece.bulge for piece in pieces])[owner],
        )  # fmt: skip

    @cached_property
    def lines(self) -> np.ndarray:
        """(c,) the chords as shapely's."""
        return np.asarray(shapely.linestrings(np.stack([self.starts, self.ends], axis=1)))

    def disjoint(self, i: Ints, j: Ints) -> np.ndarray:
        """(m,) bool: whether chords i and j have no end in common."""
        pairs = [(self.starts, self.starts), (self.starts, self.ends), (self.ends, self.starts), (self.ends, self.ends)]
        return np.all([(one[i] != other[j]).any(axis=1) for one, other in pairs], axis=0)

    def near(self, points: Floats, distance: float, source: str) -> tuple[Ints, Ints]:
        """Pairs of a point and a chord whose piece may lie within a distance: (m,) points, (m,) chords."""
        tree = shapely.STRtree(shapely.points(points))
        straight, bent = np.flatnonzero(self.bulge == 0.0), np.flatnonzero(self.bulge > 0.0)
        reach = (self.bulge[bent] + distance)[:, None]
        low = np.minimum(self.starts[bent], self.ends[bent]) - reach
        high = np.maximum(self.starts[bent], self.ends[bent]) + reach
        found, total = [np.zeros((2, 0), dtype=np.int64)], 0
        for chosen, pairs in (
            (straight, pairs_of(tree, self.lines[straight], "dwithin", distance)),
            (bent, pairs_of(tree, shapely.box(*low.T, *high.T), "intersects")),
        ):
            for i, j in pairs:
                found.append(np.stack([j, chosen[i]]))
                total += len(i)
                if total > MOST_MEETING:
                    raise too_dense(source, distance)
        at, chord = np.concatenate(found, axis=1)
        close = shapely.distance(self.lines[chord], shapely.points(points[at])) <= self.bulge[chord] + distance
        return at[close], chord[close]


def nearest(pieces: Sequence[Piece], piece: Ints, number: Ints, points: Floats, within: float) -> tuple[Floats, Floats]:
    """Where pieces are nearest to points beside some of their chords, and how near.

    Args:
        piece: (m,) of the pieces.
        number: (m,) the rough place that the chord begins at.
        points: (m, 2).
        within: what lies further away need not be found.

    Returns:
        (m,) parameters within the pieces, and (m,) distances, infinite where they are not found.
    """
    parameter, off = np.zeros(len(points)), np.full(len(points), np.inf)
    order = np.argsort(piece, kind="stable")
    for chosen in np.split(order, np.flatnonzero(np.diff(piece[order])) + 1) if len(order) else []:
        one = pieces[piece[chosen[0]]]
        if one.curve is not None:
            beside = shapely.distance(shapely.points(points[chosen]), shapely.LineString(one.fine))
            chosen = chosen[beside <= within + one.bulge / FINER]
        if len(chosen):
            t = np.clip(one.nearest(points[chosen], number[chosen]), min(one.bounds), max(one.bounds))
            parameter[chosen] = t
            off[chosen] = np.linalg.norm(one.at(t) - points[chosen], axis=1)
    return parameter, off


def split(network: Network, splits: Splits) -> Network:
    """The network with pieces split: a node sits at each split, and nodes that are one place are one."""
    if not len(splits.piece):
        return network
    order = np.lexsort([splits.parameter, splits.piece])
    piece, parameter, node = splits.piece[order], splits.parameter[order], splits.node[order]
    places = np.concatenate([network.pieces[i].at(parameter[k : k + 1]) for k, i in enumerate(piece.tolist())])
    snapped = np.array([snap(network, i, t) for i, t in zip(piece.tolist(), parameter.tolist(), strict=True)])
    parameter = snapped[:, 0]
    places = np.where(np.isnan(snapped[:, 1:]), places, snapped[:, 1:])
    # New nodes come first: where one meets an old one, the place on the split piece is kept.
    new, count = np.arange(len(piece)), len(piece)
    told = node >= 0
    every = np.concatenate([places, network.places])
    label, first = clusters(every, network.tolerance, network.source, np.stack([new[told], node[told] + count], axis=1))
    ends = label[network.ends + count]
    at: dict[int, list[int]] = defaultdict(list)
    for k, i in enumerate(piece.tolist()):
        at[i].append(k)
    pieces, nodes = list[Piece](), list[tuple[int, int]]()
    for i, one in enumerate(network.pieces):
        begin, last = one.bounds
        stops = at.get(i, [])
        if last < begin:
            stops = stops[::-1]
        bounds = [begin, *parameter[stops].tolist(), last]
        marks = [int(ends[i, 0]), *label[stops].tolist(), int(ends[i, 1])]
        for t, u, a, b in zip(bounds[:-1], bounds[1:], marks[:-1], marks[1:], strict=True):
            if t != u and not (stops and a == b and short(one, t, u, network.tolerance)):
                pieces.append(one.part(t, u, every[first[a]], every[first[b]]) if stops else one)
                nodes.append((a, b))
    return Network(pieces, np.array(nodes, np.int64).reshape(-1, 2), every[first], network.tolerance, network.source)


def snap(network: Network, piece: int, parameter: float) -> tuple[float, float, float]:
    """A parameter of a piece at a vertex, and the vertex, where one is within the tolerance; else itself and NaN."""
    one = network.pieces[piece]
    if one.curve is None:
        vertex = round(parameter)
        place, at = one.points[vertex], one.at(np.array([parameter]))[0]
        if np.hypot(*(place - at)) <= network.tolerance:
            return float(vertex), float(place[0]), float(place[1])
    return parameter, np.nan, np.nan


def short(piece: Piece, start: float, end: float, tolerance: float) -> bool:
    """Whether a part of a piece is so short that its ends and its middle are one place."""
    places = piece.at(np.linspace(start, end, 3))
    return bool(np.linalg.norm(places[1:] - places[0], axis=1).max() <= 3.0 * tolerance)


def leads_on(network: Network) -> np.ndarray:
    """(p,) bool: the pieces that are left when those that end in the open are taken away, again and again."""
    kept = np.ones(len(network.pieces), dtype=bool)
    degree = network.meeting.copy()
    at = pieces_at(network.ends)
    waiting = np.flatnonzero(degree == 1).tolist()
    while waiting:
        node = waiting.pop()
        for piece in at[node]:
            if kept[piece] and degree[node] == 1:
                kept[piece] = False
                for end in network.ends[piece].tolist():
                    degree[end] -= 1
                    if degree[end] == 1:
                        waiting.append(end)
    return kept


def pieces_at(ends: Ints) -> dict[int, list[int]]:
    """The pieces at each node."""
    at: dict[int, list[int]] = defaultdict(list)
    for i, (a, b) in enumerate(ends.tolist()):
        at[a].append(i)
        if b != a:
            at[b].append(i)
    return at


def without_copies(network: Network, asked: np.ndarray) -> tuple[Network, list[Piece]]:
    """The network with each piece once, of those that a (p,) mask is true for, and the copies."""
    groups: dict[tuple[int, int], list[int]] = defaultdict(list)
    keep = np.ones(len(network.pieces), dtype=bool)
    for i in np.flatnonzero(asked).tolist():
        a, b = sorted(network.ends[i].tolist())
        known = groups[a, b]
        keep[i] = not any(lies_on(network.pieces[i], network.pieces[j], 2.0 * network.tolerance) for j in known)
        if keep[i]:
            known.append(i)
    return network.kept(keep), [network.pieces[i] for i in np.flatnonzero(~keep)]


def folded(network: Network) -> np.ndarray:
    """(p,) bool: the straight pieces that leave a node only to come back the same way."""
    flat = np.array([piece.curve is None and len(piece.points) < 4 for piece in network.pieces], dtype=bool)
    return flat & (network.ends[:, 0] == network.ends[:, 1])


def lies_on(piece: Piece, other: Piece, tolerance: float) -> bool:
    """Whether all of a piece lies on another one."""
    if piece.rough.shape == other.rough.shape and not (piece.curve is None) ^ (other.curve is None):
        # Drawn twice, it may be the other way round: then no nearest places are looked for.
        for places in (piece.rough, piece.rough[::-1]):
            if np.linalg.norm(places - other.rough, axis=1).max() <= tolerance:
                return True
    t = piece.parameters
    middle = np.stack([t[:-1], 0.5 * (t[:-1] + t[1:])], axis=1).ravel()
    chosen = np.append(middle, t[-1])
    if len(chosen) > PROBES and piece.curve is not None:
        chosen = chosen[np.linspace(0, len(chosen) - 1, PROBES).astype(np.int64)]
    probes = piece.at(chosen)
    off = shapely.distance(shapely.points(probes), shapely.LineString(other.rough))
    if (off > other.bulge + tolerance).any():
        return False
    if other.curve is not None:
        off = shapely.distance(shapely.points(probes), shapely.LineString(other.fine))
        tolerance += other.bulge / FINER
    return bool((off <= tolerance).all())


def covered(pieces: Sequence[Piece], asked: np.ndarray, tolerance: float, source: str) -> np.ndarray:
    """(p,) bool: the pieces that lie on a longer one, or on an equal one before them.

    Args:
        asked: (p,) bool, which pieces to ask about.
    """
    found = np.zeros(len(pieces), dtype=bool)
    chosen = np.flatnonzero(asked)
    if not len(chosen) or len(pieces) < 2:
        return found
    lengths = np.array([np.linalg.norm(np.diff(piece.rough, axis=0), axis=1).sum() for piece in pieces])
    chords = Chords.of(pieces)
    middles = np.array([pieces[i].at(np.array([middle_of(pieces[i])]))[0] for i in chosen.tolist()])
    at, chord = chords.near(middles, tolerance, source)
    one, other = chosen[at], chords.piece[chord]
    # As long as it, but for what rounding and rough places make of curves.
    able = (one != other) & (lengths[other] >= 0.98 * lengths[one])
    for i, j in np.unique(np.stack([one[able], other[able]], axis=1), axis=0).tolist():
        if found[i] or found[j] or not lies_on(pieces[i], pieces[j], tolerance):
            continue
        equal = lies_on(pieces[j], pieces[i], tolerance)
        found[max(i, j) if equal and asked[j] else i] = True
    return found


def middle_of(piece: Piece) -> float:
    """A parameter about the middle of a piece, between two rough places."""
    t = piece.parameters
    k = (len(t) - 1) // 2
    return float(0.5 * (t[k] + t[k + 1]))


def crossings(network: Network, dividing: np.ndarray) -> Splits:
    """Where dividing pieces cross others, and each other, between their ends.

    Args:
        dividing: (p,) bool.

    Raises:
        DomainError: too many of them.
    """
    chords = Chords.of(network.pieces)
    asked = np.flatnonzero(dividing[chords.piece])
    rows, total = list[tuple[int, float]](), 0
    for i, j in pairs_of(shapely.STRtree(chords.lines), chords.lines[asked], "intersects"):
        i = asked[i]
        apart = (chords.piece[i] != chords.piece[j]) & ~(dividing[chords.piece[j]] & (i < j)) & chords.disjoint(i, j)
        total += int(apart.sum())
        if total > MOST_CROSSINGS:
            raise DomainError(f"{network.source}: lines cross at more than {MOST_CROSSINGS:,} places; choose layers")
        for a, b in zip(i[apart].tolist(), j[apart].tolist(), strict=True):
            rows += crossing(network, chords, a, b)
    pieces, parameters = (
        (np.array(column) for column in zip(*rows, strict=True)) if rows else (np.zeros(0), np.zeros(0))
    )
    return Splits(pieces.astype(np.int64), parameters.astype(np.float64), np.full(len(rows), -1))


def crossing(network: Network, chords: Chords, a: int, b: int) -> Iterator[tuple[int, float]]:
    """The crossing of two chords' pieces, as a parameter on each that it is no end of; nothing where there is none."""
    i, j = int(chords.piece[a]), int(chords.piece[b])
    one, other = network.pieces[i], network.pieces[j]
    (s, at_s, low_s, high_s), (t, at_t, low_t, high_t) = beside(one, chords.number[a]), beside(other, chords.number[b])
    found = np.array([s, t])
    for _ in range(STEPS):
        off = other.at(found[1:])[0] - one.at(found[:1])[0]
        d, e = at_s(found[0]), at_t(found[1])
        det = e[0] * d[1] - d[0] * e[1]
        if abs(det) <= 1e-12 * float(np.hypot(*d) * np.hypot(*e)):
            return
        # one(s) + ds d = other(t) + dt e
        change = np.array([e[0] * off[1] - off[0] * e[1], d[0] * off[1] - off[0] * d[1]]) / det
        before, found = found, np.clip(found + change, [low_s, low_t], [high_s, high_t])
        if (np.abs(found - before) <= 1e-15 * np.abs(found)).all():
            break
    place = one.at(found[:1])[0]
    if np.linalg.norm(other.at(found[1:])[0] - place) <= network.tolerance:
        for piece, number, parameter in ((one, i, found[0]), (other, j, found[1])):
            if np.linalg.norm(piece.ends - place, axis=1).min() > network.tolerance:
                yield number, float(parameter)


def beside(piece: Piece, number: int) -> tuple[float, Callable[[float], Floats], float, float]:
    """Where a search for a crossing begins on a chord: the parameter, the tangent by parameter, and the bounds."""
    t = piece.parameters
    if piece.curve is None:
        step = piece.points[number + 1] - piece.points[number]
        return float(t[number]) + 0.5, lambda _: step, float(t[number]), float(t[number + 1])
    low, high = sorted((float(t[max(0, number - 1)]), float(t[min(len(t) - 1, number + 2)])))
    width = 1e-5 * (high - low)

    def tangent(at: float) -> Floats:
        before, after = piece.at(np.array([at - width, at + width]))
        return np.asarray((after - before) / (2.0 * width))

    return float(0.5 * (t[number] + t[number + 1])), tangent, low, high
