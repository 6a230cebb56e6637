"""Action vector -> element, or a named rejection.

    index  meaning   range     decoded
    0      type      [-1, 1]   ACTION_TYPES in order, without type 2 the first three; each has an equal share
    1      radius    [-1, 1]   of the new vertex, [0, alpha L] from V_0, in domain units (with ``scale: size`` alpha h)
    2      angle     [-1, 1]   of the new vertex, [0, interior angle at V_0] from the axis V_0 -> V_r,1, in rad
    3, 4   radius, angle       of the second new vertex (type 2 only)

The base length L is the mean of the 2 n front edges around V_0 (paper, Eq. "radius"; its sum is printed with n + 1
terms a side over 2 n; the 2 n edges that the observation sees are meant here). With ``scale: size`` the edge length h
that is wanted at V_0 stands in its place: L is what the policy made of it, and an error in L goes on to the next row.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from envs.kernels import slot_tree
from envs.kernels.geometry import angle, distance2_to_segment, segments_touch
from envs.kernels.jit import inlined
from envs.mdp.front import POINTS, RING, TOLERANCE, Front, chain_start, interior_angle
from envs.quality import angles_valid, inner_angles
from envs.types import MIN_ELEMENT_ANGLE, Floats

# Types of action, by how many vertices the element adds; type 0 is closed with the right or with the left chain.
TYPE_0_RIGHT, TYPE_1, TYPE_0_LEFT, TYPE_2 = range(4)
ACTION_TYPES = ("type 0 right", "type 1", "type 0 left", "type 2")
#: Edges in the chain of each type.
CHAIN_EDGES = (3, 2, 3, 1)

# Rejections, in the order they are tested.
ACCEPTED, FRONT_FULL, BAD_ANGLE, SHARP_FRONT, CROSSING, BAD_LAST = range(6)
REJECTIONS = ("", "front full", "element angle", "front angle", "crossing", "last ring")


class Cut(NamedTuple):
    """An element that an action asks for.

    Attributes:
        start, k: first slot of its chain, edges in the chain.
        x, y: corners in counter-clockwise order, the chain's k + 1 first; domain units.
        angles: inner angles at the corners, rad.
        sigma_start, sigma_end: the angles that the front keeps at the chain's ends, rad.
        d_min: distance from the new vertices to the nearest front edge that touches neither end of the chain, infinite
            where the reward does not need it.
        rejection: ACCEPTED, or why the element is invalid.
    """

    start: int
    k: int
    x: tuple[float, float, float, float]
    y: tuple[float, float, float, float]
    angles: tuple[float, float, float, float]
    sigma_start: float
    sigma_end: float
    d_min: float
    rejection: int


@inlined
def base_length(front: Front, reference: int, n: int) -> float:
    """L: the mean length of the n front edges on each side of V_0."""
    total = 0.0
    left = right = reference
    for _ in range(n):
        before, after = front.prv[left], front.nxt[right]
        total += math.hypot(front.xy[before, 0] - front.xy[left, 0], front.xy[before, 1] - front.xy[left, 1])
        total += math.hypot(front.xy[after, 0] - front.xy[right, 0], front.xy[after, 1] - front.xy[right, 1])
        left, right = before, after
    return total / (2 * n)


@inlined
def unit_length(front: Front, reference: int, n: int, sized: bool) -> float:
    """What lengths at V_0 are measured by: the edge length wanted there if ``sized``, else L."""
    return front.size[front.vid[reference]] if sized else base_length(front, reference, n)


@inlined
def decode_type(value: float, type2: bool) -> int:
    """The type, an index into ACTION_TYPES, that the first entry of an action asks for."""
    if type2:
        return min(3, max(0, int((value + 1.0) * 2.0)))
    return min(2, max(0, int((value + 1.0) * 1.5)))


@inlined
def decode_point(front: Front, reference: int, reach: float, radius: float, turn: float) -> tuple[float, float]:
    """The new vertex: ``radius`` and ``turn`` in [-1, 1] over [0, reach] and [0, interior angle]."""
    xy = front.xy
    after = front.nxt[reference]
    x, y = xy[reference, 0], xy[reference, 1]
    axis = math.atan2(xy[after, 1] - y, xy[after, 0] - x)
    phi = axis + 0.5 * (turn + 1.0) * interior_angle(front, reference)
    r = 0.5 * (radius + 1.0) * reach
    return x + r * math.cos(phi), y + r * math.sin(phi)


@inlined
def encode_type(action_type: int, type2: bool) -> float:
    """The first entry of an action of this type: the middle of its share of the range."""
    return (2.0 * action_type + 1.0) / (4 if type2 else 3) - 1.0


@inlined
def encode_point(front: Front, reference: int, reach: float, x: float, y: float) -> tuple[float, float]:
    """The radius and turn that ``decode_point`` makes (x, y) of; beyond [-1, 1] where no action reaches it."""
    xy = front.xy
    after = front.nxt[reference]
    dx, dy = x - xy[reference, 0], y - xy[reference, 1]
    phi = angle(xy[after, 0] - xy[reference, 0], xy[after, 1] - xy[reference, 1], dx, dy)
    return 2.0 * math.hypot(dx, dy) / reach - 1.0, 2.0 * phi / interior_angle(front, reference) - 1.0


@inlined
def clearance(
    front: Front, start: int, k: int, x: tuple[float, float, float, float], y: tuple[float, float, float, float]
) -> float:
    """Whether the element's new edges touch the front, and how near its new vertices come to it.

    The new edges are corners (k, k+1), .., (3, 0). Front edges that end in one of the chain's two end vertices (on
    either side of a seam) are passed over: the angles kept at the chain's ends decide about them. The chain's own
    edges belong to the element.

    Returns:
        -1 when an edge touches; else the distance from the new vertices to the nearest front edge considered, up to
        the mean length of the new edges that meet there (infinite beyond; infinite without new vertices).
    """
    tol = front.measure[TOLERANCE]
    low_x, low_y = min(x[k], x[0]), min(y[k], y[0])
    high_x, high_y = max(x[k], x[0]), max(y[k], y[0])
    nearest2 = np.inf
    if k < 3:
        first = math.hypot(x[k + 1] - x[k], y[k + 1] - y[k])
        last = math.hypot(x[0] - x[3], y[0] - y[3])
        reach = 0.5 * (first + last)
        nearest2 = reach * reach
        for corner in range(k + 1, 4):
            low_x, low_y = min(low_x, x[corner] - reach), min(low_y, y[corner] - reach)
            high_x, high_y = max(high_x, x[corner] + reach), max(high_y, y[corner] + reach)
    bound2 = nearest2
    low_x, low_y, high_x, high_y = low_x - tol, low_y - tol, high_x + tol, high_y + tol

    inner_1 = front.nxt[start]
    inner_2 = front.nxt[inner_1]
    end = inner_1 if k == 1 else (inner_2 if k == 2 else front.nxt[inner_2])
    start_vertex, end_vertex = front.vid[start], front.vid[end]

    slots = len(front.vid)
    node = 1
    while node:
        if not slot_tree.box_meets(front.box, node, low_x, low_y, high_x, high_y):
            node = slot_tree.following(node)
            continue
        if node < slots:
            node *= 2
            continue
        slot = node - slots
        node = slot_tree.following(node)
        after = front.nxt[slot]
        head, tail = front.vid[slot], front.vid[after]
        if head == start_vertex or head == end_vertex or tail == start_vertex or tail == end_vertex:
            continue
        if k > 1 and (slot == inner_1 or (k == 3 and slot == inner_2)):
            continue
        ax, ay = front.xy[slot, 0], front.xy[slot, 1]
        bx, by = front.xy[after, 0], front.xy[after, 1]
        for corner in range(k, 4):
            other = (corner + 1) & 3
            if segments_touch(x[corner], y[corner], x[other], y[other], ax, ay, bx, by, tol):
                return -1.0
        for corner in range(k + 1, 4):
            nearest2 = min(nearest2, distance2_to_segment(x[corner], y[corner], ax, ay, bx, by))
    return math.sqrt(nearest2) if nearest2 < bound2 else np.inf


@inlined
def last_ring_valid(
    front: Front, start: int, k: int, x: tuple[float, float, float, float], y: tuple[float, float, float, float]
) -> bool:
    """Whether the 4-ring that an element with this chain would leave is itself a valid element.

    Only a chain of three edges shortens the ring, from six: what is left is its start, its end, and the two beyond.
    """
    end = front.nxt[front.nxt[front.nxt[start]]]
    beyond = front.nxt[end]
    before = front.prv[start]
    xy = front.xy
    alpha, beta, gamma, delta = inner_angles(
        x[0], y[0], x[3], y[3], xy[beyond, 0], xy[beyond, 1], xy[before, 0], xy[before, 1]
    )
    return angles_valid(alpha, beta, gamma, delta)


@inlined
def decode(front: Front, reference: int, action: Floats, n: int, alpha: float, sized: bool, type2: bool) -> Cut:
    """Turn an action into an element and test it (mdp: Action, Validity).

    Args:
        front: not changed.
        reference: slot of V_0.
        action: (3,) or (5,) in [-1, 1].
        n, alpha, sized, type2: see MeshingParameters.
    """
    action_type = decode_type(action[0], type2)
    k = CHAIN_EDGES[action_type]
    start = chain_start(front, reference, action_type)
    reach = alpha * unit_length(front, reference, n, sized)
    xy = front.xy
    s1 = front.nxt[start]
    s2, s3 = front.nxt[s1], front.nxt[front.nxt[s1]]
    x0, y0, x1, y1 = xy[start, 0], xy[start, 1], xy[s1, 0], xy[s1, 1]
    x2, y2, x3, y3 = xy[s2, 0], xy[s2, 1], xy[s3, 0], xy[s3, 1]
    end = s3
    rejection = ACCEPTED
    if k == 2:
        x3, y3 = decode_point(front, reference, reach, action[1], action[2])
        end = s2
    elif k == 1:
        x2, y2 = decode_point(front, reference, reach, action[1], action[2])
        x3, y3 = decode_point(front, reference, reach, action[3], action[4])
        end = s1
        if front.counts[RING] + 2 > len(front.vid):
            rejection = FRONT_FULL
    if front.counts[POINTS] + 3 - k > len(front.points):
        rejection = FRONT_FULL
    x, y = (x0, x1, x2, x3), (y0, y1, y2, y3)
    angles = inner_angles(x0, y0, x1, y1, x2, y2, x3, y3)
    sigma_start = interior_angle(front, start) - angles[0]
    sigma_end = interior_angle(front, end) - angles[k]
    d_min = np.inf
    if rejection == ACCEPTED:
        if not angles_valid(angles[0], angles[1], angles[2], angles[3]):
            rejection = BAD_ANGLE
        elif min(sigma_start, sigma_end) < MIN_ELEMENT_ANGLE:
            # At 0 the new edge lies on the front; below 0.01 pi no valid element could ever fill the corner.
            rejection = SHARP_FRONT
        elif k == 3 and front.counts[RING] == 6 and not last_ring_valid(front, start, k, x, y):
            rejection = BAD_LAST
        else:
            d_min = clearance(front, start, k, x, y)
            if d_min < 0.0:
                rejection = CROSSING
    return Cut(start, k, x, y, angles, sigma_start, sigma_end, d_min, rejection)
