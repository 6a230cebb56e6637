"""Well-shaped elements as actions, built from the front's own geometry; written for type 2 (five entries).

one new vertex: the parallelogram's fourth corner,      two: a quadrilateral upright on the edge V_0 -> V_r,1
or less far out                                              b---a
                                                             |   |
      l1 --- a                                           V_0 ----- V_r,1
       |     |
      V_0 -- r1
"""

from __future__ import annotations

import math

from envs.kernels.jit import inlined
from envs.mdp.action import TYPE_0_LEFT, TYPE_0_RIGHT, TYPE_1, TYPE_2, encode_point, encode_type, unit_length
from envs.mdp.front import Front, interior_angle
from envs.mdp.transition import Numbers
from envs.types import Floats

#: How far out the new vertices lie: the fourth corner's distance and the height over the edge, as shares.
DISTANCES = (1.0, 0.75, 0.5)
HEIGHTS = (1.0, 0.7, 0.4)
#: Shapes for a vertex: right, left, and each of the above.
SHAPES = 2 + len(DISTANCES) + len(HEIGHTS)
#: Least angle of the upright sides against the edge, in radians.
LEAST_SLOPE = math.pi / 3


@inlined
def shape(front: Front, slot: int, index: int, numbers: Numbers, action: Floats) -> bool:
    """Write shape ``index``, 0 <= index < SHAPES, at a slot into ``action``, (5,); whether an action reaches it."""
    reach = numbers.alpha * unit_length(front, slot, numbers.n, numbers.sized)
    if index == 0:
        action[0] = encode_type(TYPE_0_RIGHT, True)
        return True
    if index == 1:
        action[0] = encode_type(TYPE_0_LEFT, True)
        return True
    if index < 2 + len(DISTANCES):
        return fourth_corner(front, slot, DISTANCES[index - 2], reach, action)
    return upright(front, slot, HEIGHTS[index - 2 - len(DISTANCES)], reach, action)


@inlined
def fourth_corner(front: Front, slot: int, share: float, reach: float, action: Floats) -> bool:
    """One new vertex, at a share of the way to the parallelogram's fourth corner; whether it is within reach."""
    xy, before, after = front.xy, front.prv[slot], front.nxt[slot]
    x, y = xy[slot, 0], xy[slot, 1]
    ax = x + share * (xy[before, 0] + xy[after, 0] - 2.0 * x)
    ay = y + share * (xy[before, 1] + xy[after, 1] - 2.0 * y)
    action[0] = encode_type(TYPE_1, True)
    action[1], action[2] = encode_point(front, slot, reach, ax, ay)
    return max(abs(action[1]), abs(action[2])) <= 1.0


@inlined
def upright(front: Front, slot: int, share: float, reach: float, action: Floats) -> bool:
    """Two new vertices over the edge after a slot, at a share of its length; whether they are within reach."""
    xy, after = front.xy, front.nxt[slot]
    x, y = xy[slot, 0], xy[slot, 1]
    ex, ey = xy[after, 0] - x, xy[after, 1] - y
    here = min(0.5 * math.pi, max(LEAST_SLOPE, 0.5 * interior_angle(front, slot)))
    there = min(0.5 * math.pi, max(LEAST_SLOPE, 0.5 * interior_angle(front, after)))
    c, s = share * math.cos(here), share * math.sin(here)
    bx, by = x + c * ex - s * ey, y + s * ex + c * ey
    c, s = share * math.cos(there), share * math.sin(there)
    ax, ay = xy[after, 0] - c * ex - s * ey, xy[after, 1] + s * ex - c * ey
    action[0] = encode_type(TYPE_2, True)
    action[1], action[2] = encode_point(front, slot, reach, ax, ay)
    action[3], action[4] = encode_point(front, slot, reach, bx, by)
    return max(max(abs(action[1]), abs(action[2])), max(abs(action[3]), abs(action[4]))) <= 1.0
