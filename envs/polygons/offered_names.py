"""Names for the sides of an outline that was given without any: left, right, bottom and top, arcs and holes by number.

A box, with or without notches, holes and round corners, has four sides that lie on its bounding box; what is straight
elsewhere keeps no name. A hole that is no arc is one name, as a whole.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from envs.polygons.drawing import Line
from envs.polygons.outline import CORNER
from envs.polygons.rings import extent
from envs.polygons.turning import turns
from envs.types import RELATIVE_TOLERANCE, Floats

#: The share of a side of the bounding box that an outline covers at least, for it to be called by that side.
COVERED = 0.2

#: Segments of an arc at least.
ARC_LEAST = 3


def offered(rings: Sequence[Floats]) -> list[Line]:
    """Lines that name the sides of a polygon.

    Args:
        rings: valid, the outer one first, each (n, 2).
    """
    lines = box_sides(rings[0])
    lines += [Line(points, f"arc_{i}") for i, points in enumerate(round_stretches(rings[0]), 1)]
    return lines + [Line(ring_closed(hole), f"hole_{h}") for h, hole in enumerate(rings[1:], 1)]


def box_sides(outer: Floats) -> list[Line]:
    """Lines along the sides of the bounding box that an outline covers; none unless it covers all four."""
    low, high = outer.min(axis=0), outer.max(axis=0)
    near = RELATIVE_TOLERANCE * extent(outer)
    ends = np.stack([outer, np.roll(outer, -1, axis=0)], axis=1)
    lines = []
    for name, axis, at in (("left", 0, low), ("right", 0, high), ("bottom", 1, low), ("top", 1, high)):
        on = (np.abs(ends[:, :, axis] - at[axis]) <= near).all(axis=1)
        covered = np.abs(ends[on, 1, 1 - axis] - ends[on, 0, 1 - axis]).sum()
        if covered < COVERED * (high - low)[1 - axis]:
            return []
        lines += [Line(segment, name) for segment in ends[on]]
    return lines


def round_stretches(ring: Floats) -> list[Floats]:
    """The arcs of a ring, each (k, 2): runs of short turns to one side, of `ARC_LEAST` segments and more."""
    turn = turns(ring)
    if is_round(ring):
        return [ring_closed(ring)]
    bent = (np.abs(turn) > 1e-6) & (np.abs(turn) <= 2.0 * CORNER)
    if bent.all() or not bent.any():
        return []
    start = int(np.flatnonzero(~bent)[0])
    bent, rolled = np.roll(bent, -start), np.roll(ring, -start, axis=0)
    sign = np.sign(np.roll(turn, -start))
    found = []
    i, n = 0, len(ring)
    while i < n:
        if not bent[i]:
            i += 1
            continue
        j = i
        while j + 1 < n and bent[j + 1] and sign[j + 1] == sign[i]:
            j += 1
        if j - i + 2 >= ARC_LEAST:  # the vertices i..j turn: the segments i - 1 to j lie on the arc
            found.append(rolled[np.arange(i - 1, j + 2) % n])
        i = j + 1
    return found


def is_round(ring: Floats) -> bool:
    """Whether all of a ring turns gently, to one side."""
    turn = turns(ring)
    return bool((np.abs(turn) <= 2.0 * CORNER).all() and (np.sign(turn) == np.sign(turn[0])).all())


def ring_closed(ring: Floats) -> Floats:
    """(n + 1, 2): the ring with its first vertex again at its end."""
    return np.concatenate([ring, ring[:1]])
