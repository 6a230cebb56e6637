"""Going another way: how far to take a mesh back from where it is stuck, and where to act differently.

What blocks a vertex may have been cut thousands of elements ago, when the front passed by on the other side of a gap.
So not the last elements count but the last ones near the stuck vertex: 1, 2, 4, .. of them are taken back, with all
that was cut since, and the agent's actions are drawn wherever the front comes by here again.
"""

from __future__ import annotations

import math

from envs.kernels.geometry import distance2_to_segment
from envs.kernels.jit import inlined, inner
from envs.mdp.front import Front
from envs.types import Floats

#: Near is what is within this many lengths of the longer edge at the stuck vertex.
NEARNESS = 2.0
#: Entries of a place: coordinates and the distance that is near.
X, Y, REACH = range(3)


@inlined
def mark(front: Front, slot: int, place: Floats) -> None:
    """Make ``place``, (3,), the surroundings of a slot."""
    xy, before, after = front.xy, front.prv[slot], front.nxt[slot]
    place[X], place[Y] = xy[slot, 0], xy[slot, 1]
    longer = max(
        math.hypot(xy[before, 0] - place[X], xy[before, 1] - place[Y]),
        math.hypot(xy[after, 0] - place[X], xy[after, 1] - place[Y]),
    )
    place[REACH] = NEARNESS * longer


@inlined
def is_near(front: Front, slot: int, place: Floats) -> bool:
    """Whether a slot lies in the surroundings."""
    return math.hypot(front.xy[slot, 0] - place[X], front.xy[slot, 1] - place[Y]) <= place[REACH]


@inner
def elements_back(front: Front, elements: int, near: int, place: Floats) -> int:
    """How many of ``elements`` must be taken back until ``near`` of those are elements near the place; all at most."""
    back = 0
    while near > 0 and back < elements:
        back += 1
        quad = front.quads[elements - back]
        least2 = math.inf
        for corner in range(4):
            a, b = quad[corner], quad[(corner + 1) & 3]
            least2 = min(
                least2,
                distance2_to_segment(
                    place[X], place[Y],
                    front.points[a, 0], front.points[a, 1], front.points[b, 0], front.points[b, 1],
                ),
            )  # fmt: skip
        near -= least2 <= place[REACH] * place[REACH]
    return back
