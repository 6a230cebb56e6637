"""The front: the ring of vertices that is still to be meshed, and its one change, ``advance``.

A ring vertex lives in a *slot*, 0 <= slot < C. The slots of a ring are linked by ``prv`` and ``nxt``; an element takes
slots out, puts a new vertex into a freed one, or both. Two vertices of the ring can be the same mesh vertex (the two
sides of a seam): they have different slots and the same ``vid``.

An element is described by its *chain*, the k + 1 front vertices it shares with the front, and 3 - k new vertices:

    chain            k   element (counter-clockwise)            front between chain ends afterwards
    l1 0 r1 r2       3   closed with the right chain (type 0)   l1 - r2
    l2 l1 0 r1       3   closed with the left chain (type 0)    l2 - r1
    l1 0 r1          2   one new vertex a (type 1)              l1 - a - r1
    0 r1             1   two new vertices a, b (type 2)         0 - b - a - r1

Around the chain's start and end the front keeps the interior angle less the element's own angle there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from envs.kernels import slot_tree
from envs.kernels.geometry import TWO_PI, angle, signed_angles
from envs.kernels.jit import compiled, inlined, inner
from envs.mdp.size_field import elements_wanted, size_at, size_field, sizes_at
from envs.types import NO_WISHES, RELATIVE_TOLERANCE, Domain, Floats, Ints, MeshingParameters, WantedSizes

# Entries of Front.counts.
RING, POINTS, ELEMENTS, INVALID, FREE, STEPS, GIVEN = range(7)
# Entries of Front.measure.
AREA, AREA_0, A_MIN, A_MAX, TOLERANCE, ETA_SUM, RETURN = range(7)
# Entries of Front.source_limits.
MOST, GRADIENT = range(2)

#: The size field, which stays as it is while a domain is meshed; episodes of a batch share those of their domains.
FIELD = ("source_key", "source_box", "source_limits")

#: Elements around a regular vertex in the interior; on the boundary it is one for every right angle.
REGULAR = 4

#: Free slots form a list through ``nxt``; a slot outside the ring has this ``prv``.
OUTSIDE = -1


class Front(NamedTuple):
    """Working memory of one episode, or with one more leading axis of a batch of them.

    Attributes:
        xy: (C, 2) float64, position of each slot.
        vid: (C,) int64, mesh vertex of each slot.
        prv, nxt: (C,) int64, the ring's neighbours of each slot.
        key: (2 C,) float64, tree of minima over the mean angles that choose the reference vertex, rad.
        box: (2 C, 4) float64, tree of boxes over the edges slot -> nxt[slot].
        points: (P, 2) float64, every mesh vertex so far.
        quads: (E, 4) int64, the elements so far.
        size: (P,) float64, edge length wanted at each mesh vertex, the size field's; domain units. All alike where
            nothing of the parameters asks for it.
        need: (P,) int64, elements that each mesh vertex still lacks to be regular, negative when it has too many.
        source_key: (2 S,) float64, source_box: (2 S, 4) float64, the size field's trees (see size_field.SizeField).
        source_limits: (2,) float64, [h_max, g] of the size field.
        field: (1,) int64, which of a batch's size fields is this front's.
        counts: (7,) int64, [ring, points, elements, invalid actions in a row, head of the free slots, steps,
            given points].
        measure: (7,) float64, [area left, initial area, A_min, A_max, tolerance, sum of eta_e, return].
    """

    xy: Floats
    vid: Ints
    prv: Ints
    nxt: Ints
    key: Floats
    box: Floats
    points: Floats
    quads: Ints
    size: Floats
    need: Ints
    source_key: Floats
    source_box: Floats
    source_limits: Floats
    field: Ints
    counts: Ints
    measure: Floats


@inlined
def row(batch: Front, i: int) -> Front:
    """The front of episode i of a batch (views, no copies)."""
    field = batch.field[i, 0]
    return Front(
        batch.xy[i], batch.vid[i], batch.prv[i], batch.nxt[i], batch.key[i], batch.box[i],
        batch.points[i], batch.quads[i], batch.size[i], batch.need[i],
        batch.source_key[field], batch.source_box[field], batch.source_limits[field], batch.field[i],
        batch.counts[i], batch.measure[i],
    )  # fmt: skip


@inlined
def interior_angle(front: Front, slot: int) -> float:
    """Angle inside the domain at a slot, [0, 2 pi]; all of it at a tip, where the ring turns back."""
    xy, after, before = front.xy, front.nxt[slot], front.prv[slot]
    if front.vid[after] == front.vid[before]:
        return TWO_PI
    x, y = xy[slot, 0], xy[slot, 1]
    return angle(xy[after, 0] - x, xy[after, 1] - y, xy[before, 0] - x, xy[before, 1] - y)


@inlined
def mean_angle(front: Front, slot: int, n_rv: int) -> float:
    """The mean of the angles V_l,j V V_r,j over j = 1..n_rv (paper, Eq. "reference vertex").

    Rounded to 1e-9 rad, so that equal angles stay equal under rotation and scaling; the ring's order breaks the tie.
    From a line's tip both ways are one: the angle is all of it. One step before the tip the second neighbour is V's
    other side, in no direction: the angle is the one before.
    """
    xy, vid = front.xy, front.vid
    x, y = xy[slot, 0], xy[slot, 1]
    left = right = slot
    total = turn = 0.0
    folded = True
    for _ in range(n_rv):
        left, right = front.prv[left], front.nxt[right]
        folded = folded and vid[left] == vid[right]
        if folded:
            turn = TWO_PI
        elif (left == slot or vid[left] != vid[slot]) and (right == slot or vid[right] != vid[slot]):
            turn = angle(xy[right, 0] - x, xy[right, 1] - y, xy[left, 0] - x, xy[left, 1] - y)
        total += turn
    return round(total / n_rv * 1e9) * 1e-9


@inlined
def reference_slot(front: Front) -> int:
    """The slot of the reference vertex V_0."""
    return slot_tree.least_slot(front.key)


@inlined
def chain_start(front: Front, reference: int, action_type: int) -> int:
    """The first slot of the chain of an action of this type, an index into action.ACTION_TYPES."""
    if action_type == 3:
        return reference
    start = front.prv[reference]
    return front.prv[start] if action_type == 2 else start


@inlined
def box_edge(front: Front, slot: int) -> None:
    """Put the edge slot -> next into the box tree."""
    after = front.nxt[slot]
    ax, ay = front.xy[slot, 0], front.xy[slot, 1]
    bx, by = front.xy[after, 0], front.xy[after, 1]
    slot_tree.set_box(front.box, slot, min(ax, bx), min(ay, by), max(ax, bx), max(ay, by))


@inlined
def release(front: Front, slot: int) -> None:
    """Take a slot out of the ring and remember it as free; free slots hold zeros."""
    front.xy[slot, 0], front.xy[slot, 1], front.vid[slot] = 0.0, 0.0, 0
    front.prv[slot] = OUTSIDE
    front.nxt[slot] = front.counts[FREE]
    front.counts[FREE] = slot
    slot_tree.set_key(front.key, slot, np.inf)
    slot_tree.clear_box(front.box, slot)


@inlined
def insert(front: Front, before: int, vertex: int) -> None:
    """Link a mesh vertex into the ring after ``before``, in a free slot."""
    slot = front.counts[FREE]
    front.counts[FREE] = front.nxt[slot]
    front.xy[slot, 0], front.xy[slot, 1] = front.points[vertex, 0], front.points[vertex, 1]
    front.vid[slot] = vertex
    after = front.nxt[before]
    front.prv[slot], front.nxt[slot] = before, after
    front.nxt[before], front.prv[after] = slot, slot


@inlined
def wanted_size(front: Front, x: float, y: float) -> float:
    """The edge length wanted at (x, y), in domain units."""
    return size_at(front.source_key, front.source_box, front.source_limits[MOST], front.source_limits[GRADIENT], x, y)


@inlined
def new_vertex(front: Front, x: float, y: float) -> int:
    """A new mesh vertex at (x, y)."""
    vertex = front.counts[POINTS]
    front.points[vertex, 0], front.points[vertex, 1] = x, y
    front.size[vertex], front.need[vertex] = wanted_size(front, x, y), REGULAR
    front.counts[POINTS] = vertex + 1
    return vertex


@inlined
def advance(
    front: Front, start: int, k: int, ax: float, ay: float, bx: float, by: float, area: float, n_rv: int
) -> None:
    """Cut an element with the chain of k + 1 slots from ``start`` off the front.

    Args:
        front: changed in place.
        start: first slot of the chain.
        k: edges in the chain, 1..3.
        ax, ay: new vertex next to the chain's end (k <= 2).
        bx, by: new vertex next to the chain's start (k == 1).
        area: the element's area, taken off the area left.
        n_rv: neighbour pairs in the choice of the reference vertex.
    """
    quad = front.quads[front.counts[ELEMENTS]]
    slot = start
    for corner in range(k + 1):
        quad[corner] = front.vid[slot]
        slot = front.nxt[slot]
    end = front.prv[slot]

    inner = front.nxt[start]
    front.nxt[start], front.prv[end] = end, start
    for _ in range(k - 1):
        beyond = front.nxt[inner]
        release(front, inner)
        inner = beyond
    if k < 3:
        quad[k + 1] = new_vertex(front, ax, ay)
        insert(front, start, quad[k + 1])
    if k == 1:
        quad[3] = new_vertex(front, bx, by)
        insert(front, start, quad[3])
    for corner in range(4):
        front.need[quad[corner]] -= 1

    front.counts[ELEMENTS] += 1
    front.counts[RING] += 4 - 2 * k
    front.measure[AREA] -= area
    index_stretch(front, start, end, n_rv)


@inlined
def retreat(front: Front, start: int, k: int, area: float, n_rv: int) -> None:
    """Put the last element back: the exact inverse of ``advance``, bit for bit.

    Args:
        front: changed in place.
        start, k: as given to ``advance`` for the last element.
        area: the area that was left before it, ``measure[AREA]`` (a difference of rounded numbers has no inverse).
        n_rv: neighbour pairs in the choice of the reference vertex.
    """
    front.counts[ELEMENTS] -= 1
    front.counts[RING] -= 4 - 2 * k
    front.measure[AREA] = area
    quad = front.quads[front.counts[ELEMENTS]]
    for corner in range(4):
        front.need[quad[corner]] += 1

    # Slots go back in the opposite order of their coming, so that the free ones lie in their old order.
    slot = front.nxt[start]
    for _ in range(3 - k):
        beyond = front.nxt[slot]
        release(front, slot)
        slot = beyond
        front.counts[POINTS] -= 1
        front.points[front.counts[POINTS], :] = 0.0
        front.size[front.counts[POINTS]], front.need[front.counts[POINTS]] = 0.0, 0
    end = slot
    front.nxt[start], front.prv[end] = end, start
    for corner in range(k - 1, 0, -1):
        insert(front, start, quad[corner])
    quad[:] = 0
    index_stretch(front, start, end, n_rv)


@inlined
def index_stretch(front: Front, start: int, end: int, n_rv: int) -> None:
    """Bring both trees up to date with new edges between two slots."""
    slot = start
    while slot != end:
        box_edge(front, slot)
        slot = front.nxt[slot]
    refresh_keys(front, start, end, n_rv)


@inlined
def refresh_keys(front: Front, start: int, end: int, n_rv: int) -> None:
    """Update the mean angles within n_rv of the edges between ``start`` and ``end``."""
    first, stretch = start, 2 * n_rv - 1
    for _ in range(n_rv - 1):
        first = front.prv[first]
    slot = start
    while slot != end:
        stretch += 1
        slot = front.nxt[slot]
    slot = first
    # On a ring shorter than the stretch, once around is enough.
    for _ in range(min(stretch, front.counts[RING])):
        slot_tree.set_key(front.key, slot, mean_angle(front, slot, n_rv))
        slot = front.nxt[slot]


@inlined
def close(front: Front) -> None:
    """Turn the 4-ring that is left into the last element."""
    quad = front.quads[front.counts[ELEMENTS]]
    slot = reference_slot(front)
    for corner in range(4):
        quad[corner] = front.vid[slot]
        front.need[quad[corner]] -= 1
        slot = front.nxt[slot]
    front.counts[ELEMENTS] += 1
    front.counts[RING] = 0
    front.measure[AREA] = 0.0


@inner
def restart(front: Front, template: Front) -> None:
    """Make ``front`` the initial front ``template`` (which may have room for no elements, and shares its field)."""
    for slot in range(len(template.vid)):
        front.xy[slot, 0], front.xy[slot, 1] = template.xy[slot, 0], template.xy[slot, 1]
        front.vid[slot], front.prv[slot], front.nxt[slot] = template.vid[slot], template.prv[slot], template.nxt[slot]
    for node in range(len(template.key)):
        front.key[node] = template.key[node]
        for side in range(4):
            front.box[node, side] = template.box[node, side]
    for vertex in range(len(template.points)):
        front.points[vertex, 0], front.points[vertex, 1] = template.points[vertex, 0], template.points[vertex, 1]
        front.size[vertex], front.need[vertex] = template.size[vertex], template.need[vertex]
    front.field[0] = template.field[0]
    for entry in range(len(template.counts)):
        front.counts[entry] = template.counts[entry]
    for entry in range(len(template.measure)):
        front.measure[entry] = template.measure[entry]


def capacity(ring: int, parameters: MeshingParameters) -> int:
    """Slots for a front that begins with ``ring`` vertices: a power of two.

    Without type 2 a front never grows; with it, there is room to double.
    """
    least = ring * (2 if parameters.type2 else 1)
    return 1 << max(3, int(least - 1).bit_length())


def element_cap(domain: Domain, parameters: MeshingParameters, sizes: WantedSizes = NO_WISHES) -> int:
    """Elements at which an episode is truncated."""
    if parameters.max_elements is not None:
        return parameters.max_elements
    edges = np.linalg.norm(domain.vertices - np.roll(domain.vertices, -1, axis=0), axis=1)
    expected = domain.area / edges.mean() ** 2
    if sizes.stated:
        expected = max(expected, elements_wanted(domain, parameters.size_gradient, sizes))
    return int(4.0 * expected) + len(domain.ring)


def area_bounds(domain: Domain, parameters: MeshingParameters) -> tuple[float, float]:
    """A_min = v e_min^2 and A_max = v ((e_max - e_min)/kappa + e_min)^2 of the given segments.

    With ``area_range`` released e_min and e_max are the second shortest and the second longest, at most L / sqrt 2 and
    2 L, L the mean.
    """
    ends = domain.points[domain.kept]
    edges = np.sort(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))
    e_min, e_max = float(edges[0]), float(edges[-1])
    if parameters.area_range == "released":
        mean = float(edges.mean())
        e_min, e_max = min(float(edges[1]), mean / math.sqrt(2.0)), min(float(edges[-2]), 2.0 * mean)
    v = parameters.upsilon
    return v * e_min**2, v * ((e_max - e_min) / parameters.kappa + e_min) ** 2


@compiled
def _index(front: Front, n_rv: int) -> None:
    for slot in range(len(front.vid)):
        leaf = len(front.vid) + slot
        if front.prv[slot] == OUTSIDE:
            front.key[leaf] = np.inf
            front.box[leaf, 0] = front.box[leaf, 1] = np.inf
            front.box[leaf, 2] = front.box[leaf, 3] = -np.inf
        else:
            after = front.nxt[slot]
            front.key[leaf] = mean_angle(front, slot, n_rv)
            front.box[leaf, 0] = min(front.xy[slot, 0], front.xy[after, 0])
            front.box[leaf, 1] = min(front.xy[slot, 1], front.xy[after, 1])
            front.box[leaf, 2] = max(front.xy[slot, 0], front.xy[after, 0])
            front.box[leaf, 3] = max(front.xy[slot, 1], front.xy[after, 1])
    slot_tree.build(front.key, front.box)


def wanted(domain: Domain) -> Ints:
    """(p,) int64: elements that make each given point regular, its angle inside the domain over a right one.

    A seam point has an angle on each side, which add up; at a line's tip it is all of it. Every point takes at least
    one element.
    """
    here = domain.vertices
    ahead, behind = np.roll(here, -1, axis=0) - here, np.roll(here, 1, axis=0) - here
    turns = np.mod(signed_angles(ahead, behind), 2 * np.pi)
    turns[np.roll(domain.ring, -1) == np.roll(domain.ring, 1)] = 2 * np.pi
    angles = np.bincount(domain.ring, turns, minlength=len(domain.points))
    return np.maximum(1, np.rint(angles / (0.5 * np.pi))).astype(np.int64)


def template(
    domain: Domain,
    parameters: MeshingParameters,
    slots: int,
    sources: int | None = None,
    sizes: WantedSizes = NO_WISHES,
) -> Front:
    """The initial front of a domain, with ``slots`` slots and no room for elements.

    Args:
        domain: what is to be meshed.
        parameters: the MDP's numbers.
        slots: C, see `capacity`.
        sources: S, places of the size field, by default as many as it needs.
        sizes: what is wanted beyond the boundary's own sizes.
    """
    n, p = len(domain.ring), len(domain.points)
    a_min, a_max = area_bounds(domain, parameters)
    field = size_field(domain, parameters.size_gradient, sources, sizes=sizes, flat=not parameters.uses_sizes)
    front = Front(
        xy=np.zeros((slots, 2)),
        vid=np.zeros(slots, dtype=np.int64),
        prv=np.full(slots, OUTSIDE, dtype=np.int64),
        nxt=np.arange(1, slots + 1, dtype=np.int64),
        key=np.full(2 * slots, np.inf),
        box=np.zeros((2 * slots, 4)),
        points=domain.points.astype(np.float64),
        quads=np.zeros((0, 4), dtype=np.int64),
        size=sizes_at(field, domain.points),
        need=wanted(domain),
        source_key=field.key,
        source_box=field.box,
        source_limits=np.array([field.most, field.gradient]),
        field=np.zeros(1, dtype=np.int64),
        counts=np.array([n, p, 0, 0, n, 0, p], dtype=np.int64),
        measure=np.array(
            [domain.area, domain.area, a_min, a_max, RELATIVE_TOLERANCE * domain.diameter, 0.0, 0.0], dtype=np.float64
        ),
    )
    front.xy[:n] = domain.vertices
    front.vid[:n] = domain.ring
    front.prv[:n] = np.roll(np.arange(n), 1)
    front.nxt[:n] = np.roll(np.arange(n), -1)
    _index(front, parameters.n_rv)
    return front


def with_room(template: Front, vertices: int, elements: int) -> Front:
    """A front at its beginning, with room for so many new mesh vertices and elements."""
    return template._replace(
        points=np.pad(template.points, ((0, vertices), (0, 0))),
        size=np.pad(template.size, (0, vertices)),
        need=np.pad(template.need, (0, vertices)),
        quads=np.zeros((elements, 4), dtype=np.int64),
    )


def allocate(batch: int, slots: int, points: int, elements: int, sources: int) -> Front:
    """Working memory for a batch of episodes.

    Args:
        batch: episodes.
        slots: C of each.
        points, elements: room for mesh vertices and elements.
        sources: S of each of as many size fields.
    """
    return Front(
        xy=np.zeros((batch, slots, 2)),
        vid=np.zeros((batch, slots), dtype=np.int64),
        prv=np.zeros((batch, slots), dtype=np.int64),
        nxt=np.zeros((batch, slots), dtype=np.int64),
        key=np.zeros((batch, 2 * slots)),
        box=np.zeros((batch, 2 * slots, 4)),
        points=np.zeros((batch, points, 2)),
        quads=np.zeros((batch, elements, 4), dtype=np.int64),
        size=np.zeros((batch, points)),
        need=np.zeros((batch, points), dtype=np.int64),
        source_key=np.zeros((batch, 2 * sources)),
        source_box=np.zeros((batch, 2 * sources, 4)),
        source_limits=np.zeros((batch, 2)),
        field=np.arange(batch)[:, None],
        counts=np.zeros((batch, 7), dtype=np.int64),
        measure=np.zeros((batch, 7)),
    )


def ring_slots(front: Front) -> Ints:
    """The slots of the ring that is left, in counter-clockwise order; (ring,) int64."""
    ring = np.empty(int(front.counts[RING]), dtype=np.int64)
    if len(ring):
        # The first of the least keys, as reference_slot finds it: the tree's leaves are its second half.
        slot = int(np.argmin(front.key[len(front.vid) :]))
        for i in range(len(ring)):
            ring[i] = slot
            slot = int(front.nxt[slot])
    return ring
