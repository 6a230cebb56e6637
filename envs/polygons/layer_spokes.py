"""Spokes: the lines from the vertices of a side inwards that the rows of its boundary layers run between.

::

      |     |     |     |           A spoke is the normal of a smooth side; at a corner of the domain below 180 degrees
    --+-----+-----+-----+-\\        the bisector, longer so that the rows keep their height. Next to it the spokes lean
      |     |     |     |  \\  .     towards it, less and less, so that none crosses another.
    --+-----+-----+-----+---+-
      |     |     |     |   |\\     At a corner of more than 225 degrees there is a fan: two elements in the outer rows
    --o-----o-----o-----o   + +     and one in the first for each 90 degrees between the normals of its sides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from envs.polygons.outline import CORNER
from envs.polygons.turning import signed_angles
from envs.types import Floats, Ints

#: From this inner angle on a corner has a fan (radians).
FAN = np.radians(225.0)

#: Up to this inner angle the rows of a side end along the next one, which has none (radians).
ALONG = np.radians(135.0)

#: A spoke is at most this many times as long as the rows are high: sharp corners have less high ones.
LONGEST = 3.0

#: The same along a side.
LONGEST_ALONG = 2.0

#: Spokes lean over this many times as long a stretch as the first of them leans to the side.
LEANING = 3.0

#: By how much the rows may shorten a stretch that they are on.
SHORTENED = 0.5


@dataclass(frozen=True, eq=False)
class Run:
    """A stretch of a ring that carries layers.

    Attributes:
        points: (v, 2) float64 its vertices, the domain on the left.
        closed: the last vertex is followed by the first one.
        before, after: the ring's vertices before and behind it, unless it is closed.
    """

    points: Floats
    closed: bool
    before: Floats
    after: Floats

    @property
    def steps(self) -> Floats:
        """(segments, 2) from each vertex to the next."""
        return (np.roll(self.points, -1, axis=0) if self.closed else self.points[1:]) - (
            self.points if self.closed else self.points[:-1]
        )


@dataclass(frozen=True, eq=False)
class Spokes:
    """The spokes of a run, in the order of its walk.

    Attributes:
        vertex: (p,) int64 the vertex of the run that each leaves; in a fan several leave one.
        way: (p, 2) float64 how far it leads for a height of 1.
        first_along, last_along: whether the first and the last one lie along the next side; else they leave the run's
            end upright, and close the rows there.
        most: (v,) float64 in (0, 1]: share of the height that the run's shape has room for at each vertex.
    """

    vertex: Ints
    way: Floats
    first_along: bool
    last_along: bool
    most: Floats


def spokes_of(run: Run, height: float) -> Spokes:
    """The spokes of a run.

    Args:
        run: its segments have a length.
        height: of all rows where nothing limits it.
    """
    steps = run.steps
    lengths = np.linalg.norm(steps, axis=1)
    tangent = steps / lengths[:, None]
    count = len(run.points)
    ahead = tangent if run.closed else np.concatenate([tangent, _unit(run.after - run.points[-1])])
    behind = np.roll(tangent, 1, axis=0) if run.closed else np.concatenate([_unit(run.points[0] - run.before), tangent])
    turn = signed_angles(behind, ahead)
    inner = np.pi - turn
    left, right = _normals(behind), _normals(ahead)
    way = (left + right) / np.maximum(1.0 + (left * right).sum(axis=1), 1e-9)[:, None]
    long = np.linalg.norm(way, axis=1)
    # Of a turn back both normals are opposite; their bisector is behind.
    way[long < 1e-6] = -behind[long < 1e-6]
    way *= np.minimum(1.0, LONGEST / np.maximum(long, 1e-9))[:, None]
    knot = np.abs(turn) > CORNER
    fanned = inner > FAN
    first_along = last_along = False
    if not run.closed:
        knot[[0, -1]], fanned[[0, -1]] = True, False
        first_along, last_along = (bool(angle <= ALONG) for angle in inner[[0, -1]])
        way[0] = _end(-behind[0], inner[0]) if first_along else right[0]
        way[-1] = _end(ahead[-1], inner[-1]) if last_along else left[-1]
    forward, backward = (way * ahead).sum(axis=1), (way * behind).sum(axis=1)
    forward[fanned | ~knot] = backward[fanned | ~knot] = 0.0
    most = np.ones(count)
    lean = np.zeros(count)
    for here, there in _sides(np.flatnonzero(knot), count, run.closed):
        inside = np.arange(here + 1, there)
        stations = np.concatenate([[0.0], np.cumsum(lengths[np.arange(here, there) % count])])
        there %= count
        q, p = float(forward[here]), float(-backward[there])
        share = q / (q + p) if q > 0.0 and p > 0.0 else 1.0
        for vertex, pull, room, away, sign in (
            (here, q, stations[-1] * share, stations[1:-1], 1.0),
            (there, p, stations[-1] * (1.0 - share if share < 1.0 else 1.0), stations[-1] - stations[1:-1], -1.0),
        ):
            if pull > 0.0:
                most[vertex] = min(most[vertex], SHORTENED * room / (height * pull))
            if pull != 0.0:
                reach = min(LEANING * height * abs(pull), room)
                lean[inside % count] += sign * pull * np.maximum(0.0, 1.0 - away / reach)
    middle = _unit(ahead + behind)
    way = np.where(knot[:, None], way, way + lean[:, None] * middle)
    ways = [_fan(left[i], float(turn[i]), float(inner[i])) if fanned[i] else way[i : i + 1] for i in range(count)]
    leaving = np.repeat(np.arange(count), [len(fan) for fan in ways])
    return Spokes(leaving, np.concatenate(ways), first_along, last_along, most)


def _unit(ways: Floats) -> Floats:
    """(k, 2) or (2,) of length 1, each a row."""
    rows = np.atleast_2d(ways)
    return np.asarray(rows / np.maximum(np.linalg.norm(rows, axis=1), 1e-300)[:, None])


def _normals(ways: Floats) -> Floats:
    """To the left of (k, 2)."""
    return np.stack([-ways[:, 1], ways[:, 0]], axis=1)


def _end(along: Floats, inner: float) -> Floats:
    """The spoke along the side that rows end at."""
    return along * min(LONGEST_ALONG, 1.0 / max(np.sin(inner), 1e-9))


def _sides(knots: Ints, count: int, closed: bool) -> list[tuple[int, int]]:
    """From each knot to the next one; of a closed run the last ones count on."""
    ends = [*knots.tolist(), *(knots[:1] + count).tolist()] if closed else knots.tolist()
    return list(zip(ends[:-1], ends[1:], strict=True))


def _fan(normal: Floats, turn: float, inner: float) -> Floats:
    """The spokes of a corner, from the normal of the side before it to that of the side behind it."""
    steps = 2 * max(1, int(inner / (0.5 * np.pi) + 0.5) - 2)
    angle = turn / steps * np.arange(steps + 1)
    around = np.stack([
        np.cos(angle) * normal[0] - np.sin(angle) * normal[1], np.sin(angle) * normal[0] + np.cos(angle) * normal[1]
    ], axis=1)  # fmt: skip
    around[1::2] /= np.cos(turn / steps)
    return around
