"""Front -> observation vector: the partial boundary around the reference vertex (paper, Eq. "state function").

Polar coordinates with origin V_0 and axis V_0 -> V_r,1; lengths over L_r = beta L, clipped to 1; angles over pi.

    index                    entry                                     unit       range
    2 (n - j), + 1           V_l,j, j = n..1: length, angle            L_r, pi    [0, 1], [-1, 3]
    2 n + 2 (j - 1), + 1     V_r,j, j = 1..n: length, angle            L_r, pi    [0, 1], [-1, 1]
    4 n + 2 (j - 1), + 1     V_zeta,j, j = 1..g: length, angle         L_r, pi    [0, 1], [0, 2]
    4 n + 2 g                rho: area left over initial area          1          [0, 1]

Extended (MeshingParameters.extended), by the elements that vertices still lack to be regular, and the size wanted:

    4 n + 2 g + 1 + n - j    of V_l,j, j = n..1                        4          [-1, 1]
    5 n + 2 g + 1            of V_0                                    4          [-1, 1]
    5 n + 2 g + 1 + j        of V_r,j, j = 1..n                        4          [-1, 1]
    6 n + 2 g + 2            ln of L over the length wanted at V_0     ln 4       [-1, 1]

The interior angle theta at V_0 is the angle of V_l,1. The angle of V_r,j is the shorter turn from the axis, that of
V_l,j is theta plus the shorter turn from V_0 -> V_l,1: so a front that runs straight on does not flip between 0 and 2.

V_zeta,j is the nearest front vertex in the j-th of g equal slices of theta, within L_r; the 2 n neighbours, which are
observed anyway, and vertices at V_0's own place (the other side of a seam) do not count. A slice without one gives the
first hit of its bisector with the front, or the bisector's end at L_r.
"""

from __future__ import annotations

import math

import numpy as np

from envs.kernels import slot_tree
from envs.kernels.compiled import inlined
from envs.kernels.geometry import TWO_PI, angle, ray_hit, signed_angle
from envs.mdp.action import base_length
from envs.mdp.front import AREA, AREA_0, TOLERANCE, Front
from envs.types import Floats, MeshingParameters

LN_4 = math.log(4.0)

#: Directions closer than this count as one, in radians.
ANGLE_TOLERANCE = 1e-9


@inlined
def observe(front: Front, reference: int, n: int, g: int, beta: float, extended: bool, out: Floats) -> None:
    """Write the observation of V_0 in slot ``reference`` into ``out``, (4 n + 2 g + 1 [+ 2 n + 2],) float32."""
    xy = front.xy
    x, y = xy[reference, 0], xy[reference, 1]
    L_r = beta * base_length(front, reference, n)
    right, left = front.nxt[reference], front.prv[reference]
    axis_x, axis_y = xy[right, 0] - x, xy[right, 1] - y
    back_x, back_y = xy[left, 0] - x, xy[left, 1] - y
    theta = angle(axis_x, axis_y, back_x, back_y)
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
    out[4 * n + 2 * g] = min(1.0, max(0.0, front.measure[AREA] / front.measure[AREA_0]))
    if extended:
        lacks(front, reference, n, g, out)
        ratio = L_r / (beta * front.size[front.vid[reference]])
        out[6 * n + 2 * g + 2] = min(1.0, max(-1.0, math.log(ratio) / LN_4))


@inlined
def lacks(front: Front, reference: int, n: int, g: int, out: Floats) -> None:
    """Write the elements that V_l,n..V_0..V_r,n still lack into ``out``, over 4."""
    slot = reference
    for _ in range(n):
        slot = front.prv[slot]
    at = 4 * n + 2 * g + 1
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


def bounds(parameters: MeshingParameters) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and highest value of every entry, (size,) float32 each."""
    n, g = parameters.n, parameters.g
    extra = 2 * n + 2 if parameters.extended else 0
    low = np.array([0, -1] * (2 * n) + [0, 0] * g + [0] + [-1] * extra, dtype=np.float32)
    high = np.array([1, 3] * n + [1, 1] * n + [1, 2] * g + [1] + [1] * extra, dtype=np.float32)
    return low, high


def names(parameters: MeshingParameters) -> list[str]:
    """What each entry is called, in order."""
    n, g = parameters.n, parameters.g
    points = [f"l{j}" for j in range(n, 0, -1)] + [f"r{j}" for j in range(1, n + 1)]
    points += [f"zeta{j}" for j in range(1, g + 1)]
    polar = [f"{point}_{part}" for point in points for part in ("length", "angle")]
    if not parameters.extended:
        return [*polar, "rho"]
    around = [*points[:n], "0", *points[n : 2 * n]]
    return [*polar, "rho", *(f"{point}_lacks" for point in around), "size"]
