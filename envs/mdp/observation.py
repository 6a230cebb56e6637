"""Front -> observation vector: the partial boundary around the reference vertex (paper, Eq. "state function").

Polar coordinates with origin V_0 and axis V_0 -> V_r,1; lengths over L_r = beta L, clipped to 1; angles over pi. With
``scale: size`` L_r = beta h, h the edge length wanted at V_0.

    index                    entry           unit    range      meaning
    2 (n - j)                l{j}_length     L_r     [0, 1]     V_l,j, j = n..1
    2 (n - j) + 1            l{j}_angle      pi      [-1, 3]
    2 (n + j) - 2            r{j}_length     L_r     [0, 1]     V_r,j, j = 1..n
    2 (n + j) - 1            r{j}_angle      pi      [-1, 1]
    4 n + 2 j - 2            zeta{j}_length  L_r     [0, 1]     V_zeta,j, j = 1..g
    4 n + 2 j - 1            zeta{j}_angle   pi      [0, 2]
    4 n + 2 g                rho             1       [0, 1]     area left over initial area

With the setting ``extended``, the elements that vertices still lack to be regular:

    5 n + 2 g + 1 - j        l{j}_lacks      4       [-1, 1]    of V_l,j, j = n..1
    5 n + 2 g + 1            0_lacks         4       [-1, 1]    of V_0
    5 n + 2 g + 1 + j        r{j}_lacks      4       [-1, 1]    of V_r,j, j = 1..n

With ``extended`` or ``scale: size``, how far L is from h; m is the index after all that stands before:

    m                        size            ln 4    [-1, 1]    ln of L over h

With ``scale: size``, the size ahead:

    m + n + 1 - j            l{j}_size       ln 4    [-1, 1]    ln of the length wanted at V_l,j over h, j = n..1
    m + n + j                r{j}_size       ln 4    [-1, 1]    ln of the length wanted at V_r,j over h, j = 1..n
    m + 2 n + 1              ahead_size      ln 4    [-1, 1]    ln of the length wanted 2 h ahead over h

Ahead is where the bisector of the interior angle at V_0 points to.

`TABLE` is what size, bounds and names come from. A new entry is a row of it, the lines of `observe` that write it, and
the setting that switches it on.

The interior angle theta at V_0 is the angle of V_l,1. The angle of V_r,j is the shorter turn from the axis, that of
V_l,j is theta plus the shorter turn from V_0 -> V_l,1: so a front that runs straight on does not flip between 0 and 2.

V_zeta,j is the nearest front vertex in the j-th of g equal slices of theta, within L_r; the 2 n neighbours, which are
observed anyway, and vertices at V_0's own place (the other side of a seam) do not count. A slice without one gives the
first hit of its bisector with the front, or the bisector's end at L_r.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from envs.kernels import slot_tree
from envs.kernels.geometry import TWO_PI, angle, ray_hit, signed_angle
from envs.kernels.jit import inlined
from envs.mdp.action import base_length, unit_length
from envs.mdp.front import AREA, AREA_0, TOLERANCE, Front, interior_angle, wanted_size
from envs.types import Floats, MeshingParameters

LN_4 = math.log(4.0)

#: How far ahead the size wanted is told, over the one at V_0.
AHEAD = 2.0

#: Directions closer than this count as one, in radians.
ANGLE_TOLERANCE = 1e-9


class Entry(NamedTuple):
    """One number of the observation.

    Attributes:
        name: what it is called.
        unit: what the measured value is divided by.
        low, high: inclusive range.
    """

    name: str
    unit: str
    low: float
    high: float


class Row(NamedTuple):
    """Entries that follow each other, for one point of the front after another.

    Attributes:
        points: (n, g) -> the points' names, in the order of the observation.
        entries: what is told of each, by the ends of their names.
        setting: the attribute of MeshingParameters that switches the row on; empty: always there.
    """

    points: Callable[[int, int], Sequence[str]]
    entries: tuple[Entry, ...]
    setting: str = ""


def _left(n: int, g: int) -> list[str]:
    return [f"l{j}_" for j in range(n, 0, -1)]


def _right(n: int, g: int) -> list[str]:
    return [f"r{j}_" for j in range(1, n + 1)]


def _fan(n: int, g: int) -> list[str]:
    return [f"zeta{j}_" for j in range(1, g + 1)]


def _around(n: int, g: int) -> list[str]:
    return [*_left(n, g), "0_", *_right(n, g)]


def _nowhere(n: int, g: int) -> list[str]:
    return [""]


#: The observation, in order.
TABLE = (
    Row(_left, (Entry("length", "L_r", 0, 1), Entry("angle", "pi", -1, 3))),
    Row(_right, (Entry("length", "L_r", 0, 1), Entry("angle", "pi", -1, 1))),
    Row(_fan, (Entry("length", "L_r", 0, 1), Entry("angle", "pi", 0, 2))),
    Row(_nowhere, (Entry("rho", "1", 0, 1),)),
    Row(_around, (Entry("lacks", "4", -1, 1),), "extended"),
    Row(_nowhere, (Entry("size", "ln 4", -1, 1),), "drift"),
    Row(_left, (Entry("size", "ln 4", -1, 1),), "sized"),
    Row(_right, (Entry("size", "ln 4", -1, 1),), "sized"),
    Row(_nowhere, (Entry("ahead_size", "ln 4", -1, 1),), "sized"),
)


def entries(parameters: MeshingParameters) -> list[Entry]:
    """Every number of the observation, in order."""
    return [
        entry._replace(name=point + entry.name)
        for row in TABLE
        if not row.setting or getattr(parameters, row.setting)
        for point in row.points(parameters.n, parameters.g)
        for entry in row.entries
    ]


def observation_size(parameters: MeshingParameters) -> int:
    """How many numbers an observation has: 4 n + 2 g + 1 (15 for O2), 2 n + 2 more when extended or sized."""
    return len(entries(parameters))


def observation_names(parameters: MeshingParameters) -> list[str]:
    """What each entry is called, in order."""
    return [entry.name for entry in entries(parameters)]


def bounds(parameters: MeshingParameters) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and highest value of every entry, (size,) float32 each."""
    found = entries(parameters)
    return (
        np.array([entry.low for entry in found], dtype=np.float32),
        np.array([entry.high for entry in found], dtype=np.float32),
    )


@inlined
def observe(
    front: Front, reference: int, n: int, g: int, beta: float, extended: bool, sized: bool, out: Floats
) -> None:
    """Write the observation of V_0 in slot ``reference`` into ``out``, (size,) float32: `TABLE`, row by row."""
    xy = front.xy
    x, y = xy[reference, 0], xy[reference, 1]
    L_r = beta * unit_length(front, reference, n, sized)
    right, left = front.nxt[reference], front.prv[reference]
    axis_x, axis_y = xy[right, 0] - x, xy[right, 1] - y
    back_x, back_y = xy[left, 0] - x, xy[left, 1] - y
    theta = interior_angle(front, reference)
    for j in range(n):
        dx, dy = xy[left, 0] - x, xy[left, 1] - y
        at = 2 * (n - 1 - j)
        out[at] = min(1.0, math.hypot(dx, dy) / L_r)
        out[at + 1] = (theta + signed_angle(back_x, back_y, dx, dy)) / math.pi
        dx, dy = xy[right, 0] - x, xy[right, 1] - y
        at = 2 * (n + j)
        out[at] = min(1.0, math.hypot(dx, dy) / L_r)
        out[at + 1] = signed_angle(axis_x, axis_y, dx, dy) / math.pi
        left, right = front.prv[left], front.nxt[right]
    fan(front, reference, n, g, L_r, theta, axis_x, axis_y, out)
    at = 4 * n + 2 * g
    out[at] = min(1.0, max(0.0, front.measure[AREA] / front.measure[AREA_0]))
    at += 1
    if extended:
        lacks(front, reference, n, at, out)
        at += 2 * n + 1
    if extended or sized:
        h = front.size[front.vid[reference]]
        out[at] = log_ratio(base_length(front, reference, n), h)
        if sized:
            sizes(front, reference, n, math.atan2(axis_y, axis_x) + 0.5 * theta, at + 1, out)


@inlined
def log_ratio(length: float, h: float) -> float:
    """ln of a length over h, over ln 4, clipped to [-1, 1]."""
    return min(1.0, max(-1.0, math.log(length / h) / LN_4))


@inlined
def sizes(front: Front, reference: int, n: int, bisector: float, at: int, out: Floats) -> None:
    """Write the sizes wanted at V_l,n..V_l,1, V_r,1..V_r,n and ahead into ``out`` from entry ``at`` on."""
    h = front.size[front.vid[reference]]
    left = right = reference
    for j in range(n):
        left, right = front.prv[left], front.nxt[right]
        out[at + n - 1 - j] = log_ratio(front.size[front.vid[left]], h)
        out[at + n + j] = log_ratio(front.size[front.vid[right]], h)
    x, y = front.xy[reference, 0], front.xy[reference, 1]
    there = wanted_size(front, x + AHEAD * h * math.cos(bisector), y + AHEAD * h * math.sin(bisector))
    out[at + 2 * n] = log_ratio(there, h)


@inlined
def lacks(front: Front, reference: int, n: int, at: int, out: Floats) -> None:
    """Write the elements that V_l,n..V_0..V_r,n still lack, over 4, into ``out`` from entry ``at`` on."""
    slot = reference
    for _ in range(n):
        slot = front.prv[slot]
    for j in range(2 * n + 1):
        out[at + j] = min(1.0, max(-1.0, 0.25 * front.need[front.vid[slot]]))
        slot = front.nxt[slot]


@inlined
def fan(
    front: Front, reference: int, n: int, g: int, L_r: float, theta: float, axis_x: float, axis_y: float, out: Floats
) -> None:
    """Write the g fan points into ``out``."""
    xy = front.xy
    x, y = xy[reference, 0], xy[reference, 1]
    at = 4 * n
    for j in range(g):
        out[at + 2 * j] = np.inf
    slots = len(front.vid)
    slice_angle = theta / g
    own2 = front.measure[TOLERANCE] ** 2
    reach2 = L_r * L_r  # the largest of the slices' least squared distances so far
    scale = 1.0 / L_r
    node = 1
    while node:
        if slot_tree.box_distance2(front.box, node, x, y) > reach2:
            node = slot_tree.following(node)
            continue
        if node < slots:
            node *= 2
            continue
        slot = node - slots
        node = slot_tree.following(node)
        dx, dy = xy[slot, 0] - x, xy[slot, 1] - y
        distance2 = dx * dx + dy * dy
        if distance2 > reach2 or distance2 <= own2:
            continue
        phi = angle(axis_x, axis_y, dx, dy)
        if phi > theta:
            # On a straight side, rounding must not decide whether the vertices beyond the neighbours are seen.
            if phi > theta + ANGLE_TOLERANCE and phi < TWO_PI - ANGLE_TOLERANCE:
                continue
            phi = theta if phi <= theta + ANGLE_TOLERANCE else 0.0
        if is_neighbour(front, reference, slot, n):
            continue
        j = min(g - 1, int(phi / slice_angle))
        distance = math.sqrt(distance2) * scale
        if distance < out[at + 2 * j]:
            out[at + 2 * j] = distance
            out[at + 2 * j + 1] = phi / math.pi
            worst = 0.0
            for i in range(g):
                worst = max(worst, out[at + 2 * i])
            if worst <= 1.0:
                reach2 = (worst * L_r) ** 2
    axis = math.atan2(axis_y, axis_x)
    for j in range(g):
        if out[at + 2 * j] > 1.0:
            turn = (j + 0.5) * slice_angle
            out[at + 2 * j] = first_hit(front, reference, L_r, axis + turn)
            out[at + 2 * j + 1] = turn / math.pi


@inlined
def is_neighbour(front: Front, reference: int, slot: int, n: int) -> bool:
    """Whether ``slot`` is one of the n neighbours on either side."""
    left, right = front.prv[reference], front.nxt[reference]
    for _ in range(n):
        if slot == left or slot == right:
            return True
        left, right = front.prv[left], front.nxt[right]
    return False


@inlined
def first_hit(front: Front, reference: int, L_r: float, direction: float) -> float:
    """Length over L_r, in [0, 1], at which the ray from V_0 first meets a front edge that does not end in V_0."""
    xy = front.xy
    x, y = xy[reference, 0], xy[reference, 1]
    dx, dy = math.cos(direction), math.sin(direction)
    own = front.vid[reference]
    slots = len(front.vid)
    nearest = L_r
    node = 1
    while node:
        end_x, end_y = x + nearest * dx, y + nearest * dy
        if not slot_tree.box_meets(front.box, node, min(x, end_x), min(y, end_y), max(x, end_x), max(y, end_y)):
            node = slot_tree.following(node)
            continue
        if node < slots:
            node *= 2
            continue
        slot = node - slots
        node = slot_tree.following(node)
        after = front.nxt[slot]
        if front.vid[slot] == own or front.vid[after] == own:
            continue
        nearest = min(nearest, ray_hit(x, y, dx, dy, xy[slot, 0], xy[slot, 1], xy[after, 0], xy[after, 1]))
    return nearest / L_r
