"""The size field: the edge length h that is wanted at every place of a domain.

    h(x) = min(h_max, min_i (h_i + g |x - x_i|))

The sources x_i are the given points of the boundary and of lines, h_i is the mean length of the segments that meet
there, h_max the largest h_i, and g bounds how fast h changes (``size_gradient``). So h is the boundary's own size near
it, grows inwards no faster than g, and stays within the boundary's sizes. Seams have no say: they are no boundary. What
a user says (`WantedSizes`) is another h_max, or more sources: where the boundary's segments are larger than these, h
falls towards them no faster than g, so that it is the boundary's own at the boundary.

The sources are the leaves of two trees as ``kernels.slot_tree`` has them: minima of h_i, and boxes. A query visits the
nodes that can hold a source with a lower cone. A source above which another one's cone, or h_max, lies lower is left
out: a uniform boundary has none, and its field costs nothing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from envs.kernels import slot_tree
from envs.kernels.jit import compiled, inlined
from envs.polygons.size_cells import cells
from envs.types import NO_WISHES, Domain, Floats, WantedSizes

#: Sizes that differ by less than this share are one.
EQUAL = 1e-9


class SizeField(NamedTuple):
    """A field of S places for sources.

    Attributes:
        key: (2 S,) float64, tree of minima over h_i, infinite where there is no source; domain units.
        box: (2 S, 4) float64, tree of boxes over x_i.
        most: h_max, domain units.
        gradient: g.
    """

    key: Floats
    box: Floats
    most: float
    gradient: float


@inlined
def size_at(key: Floats, box: Floats, most: float, gradient: float, x: float, y: float) -> float:
    """h at (x, y), in domain units; the other arguments are those of `SizeField`."""
    if key[1] >= most:
        return most
    sources = len(key) >> 1
    node = 1
    while node < sources:  # down to a source nearby: a bound to begin with
        node *= 2
        if slot_tree.box_distance2(box, node, x, y) > slot_tree.box_distance2(box, node + 1, x, y):
            node += 1
    least = min(most, key[node] + gradient * math.sqrt(slot_tree.box_distance2(box, node, x, y)))
    node = 1
    while node:
        # Whether any source below can be lower: it is one's own least size, at the nearest place of the box.
        room = least - key[node]
        if room <= 0.0 or gradient * gradient * slot_tree.box_distance2(box, node, x, y) >= room * room:
            node = slot_tree.following(node)
            continue
        if node < sources:
            node *= 2
            continue
        least = key[node] + gradient * math.sqrt(slot_tree.box_distance2(box, node, x, y))
        node = slot_tree.following(node)
    return least


def sources(domain: Domain) -> Floats:
    """(s, 3) float64: x, y and h_i of each given point of the boundary and of lines, in domain units."""
    kept = domain.kept
    ends = domain.points[kept]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    meeting = np.bincount(kept.ravel(), minlength=len(domain.points))
    total = np.bincount(kept.ravel(), np.repeat(lengths, 2), minlength=len(domain.points))
    at = np.flatnonzero(meeting)
    return np.column_stack([domain.points[at], total[at] / meeting[at]])


def capacity(points: int) -> int:
    """Places for the sources of a domain with so many points: a power of two."""
    return 1 << max(1, int(points - 1).bit_length())


def size_field(
    domain: Domain,
    gradient: float,
    places: int | None = None,
    *,
    sizes: WantedSizes = NO_WISHES,
    flat: bool = False,
) -> SizeField:
    """The field of a domain.

    Args:
        domain: its boundary is what the field comes from.
        gradient: g, above 0.
        places: S, a power of two, at least the number of sources; by default as many as are needed.
        sizes: what is said beyond the boundary.
        flat: h_max everywhere, for whom the sizes do not matter: a field that costs nothing.
    """
    boundary = sources(domain)
    largest = float(boundary[:, 2].max())
    most = max(largest, sizes.most if np.isfinite(sizes.most) else sizes.least)
    if flat:
        return _grown(boundary[:0], places, most, gradient)
    field = _grown(boundary, places, most, gradient)
    if not sizes.stated:
        return field
    points = sizes.points
    if sizes.most < largest:
        low, high = domain.points.min(axis=0), domain.points.max(axis=0)
        points = np.concatenate([points, cells(lambda at: np.full(len(at), sizes.most), low, high).points])
    # As far as the boundary, whose segments stay, lets them: from there sizes fall no faster than they may grow.
    ceiling = np.column_stack([boundary[:, :2], -sizes_at(field, boundary[:, :2])])
    key, box = _planted(ceiling, capacity(len(ceiling)))
    lifted = np.maximum(sizes.clipped(points[:, 2]), -sizes_at(SizeField(key, box, np.inf, gradient), points[:, :2]))
    return _grown(np.concatenate([boundary, np.column_stack([points[:, :2], lifted])]), places, most, gradient)


def _planted(given: Floats, places: int) -> tuple[Floats, Floats]:
    """The trees of sources, (m, 3) float64."""
    key = np.full(2 * places, np.inf)
    box = np.tile([np.inf, np.inf, -np.inf, -np.inf], (2 * places, 1))
    leaves = slice(places, places + len(given))
    key[leaves] = given[:, 2]
    box[leaves] = given[:, [0, 1, 0, 1]]
    _build(key, box)
    return key, box


def _grown(given: Floats, places: int | None, most: float, gradient: float) -> SizeField:
    """The field of sources, (m, 3) float64, without those that change nothing."""
    key, box = _planted(given, places or capacity(len(given)))
    field = SizeField(key, box, most, float(gradient))
    _prune(*field, np.zeros(len(key) // 2, dtype=np.bool_))
    return field


def elements_wanted(domain: Domain, gradient: float, sizes: WantedSizes) -> float:
    """Elements of the sizes wanted that the domain's box holds, which are at least those of the domain."""
    field = size_field(domain, gradient, sizes=sizes)
    low, high = domain.points.min(axis=0), domain.points.max(axis=0)
    return cells(lambda places: sizes_at(field, places), low, high).elements


def sizes_at(field: SizeField, points: Floats) -> Floats:
    """(p,) float64: h at each of (p, 2) points, in domain units."""
    found = np.zeros(len(points))
    _evaluate(*field, np.ascontiguousarray(points, dtype=np.float64), found)
    return found


@compiled
def _build(key: Floats, box: Floats) -> None:
    slot_tree.build(key, box)


@compiled
def _prune(key: Floats, box: Floats, most: float, gradient: float, needless: np.ndarray) -> None:
    """Take the sources that change nothing out of the trees; ``needless``: (S,) bool, all False."""
    places = len(needless)
    for i in range(places):
        h = key[places + i]
        if h < np.inf:
            x, y = box[places + i, 0], box[places + i, 1]
            needless[i] = h >= most * (1.0 - EQUAL) or size_at(key, box, most, gradient, x, y) < h * (1.0 - EQUAL)
    for i in range(places):
        if needless[i]:
            key[places + i] = np.inf
            box[places + i, 0] = box[places + i, 1] = np.inf
            box[places + i, 2] = box[places + i, 3] = -np.inf
    slot_tree.build(key, box)


@compiled
def _evaluate(key: Floats, box: Floats, most: float, gradient: float, points: Floats, out: Floats) -> None:
    for i in range(len(points)):
        out[i] = size_at(key, box, most, gradient, points[i, 0], points[i, 1])
