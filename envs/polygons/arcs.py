"""Arcs in a polyline, and the size that gives a full turn of each so many segments.

A stretch is halved until each part looks like an arc of at most the angle that one segment may stand for: its vertices
are no further from its chord than the arc's middle would be, chord / 2 tan(angle / 4). So zigzags that are small beside
a segment are no arcs, and a part between two vertices, as of a circle drawn with few, turns by half of the turns at its
ends. The size is what an arc of the part's radius is divided into.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from envs.polygons.boundary import Chain
from envs.polygons.turning import bends, turns
from envs.types import Floats

#: The middle of an arc is looked for between these shares of its chord; further out a vertex is taken for noise.
LEAST_HEIGHT = 0.75


class Arcs(NamedTuple):
    """The parts of a chain.

    Attributes:
        bounds: (p + 1,) distances along the chain, from 0 to its length.
        sizes: (p,) the largest size that each part allows; infinite where it is straight.
    """

    bounds: Floats
    sizes: Floats


def arcs(chain: Chain, angle: float) -> Arcs:
    """The arcs of a chain.

    Args:
        chain: its inner vertices turn by less than ``angle``.
        angle: what a segment may turn by, radians.
    """
    points, last = chain.points, len(chain.points) - 1
    along = chain.along
    if last == 1 or chain.turn == 0.0:
        return Arcs(along[[0, -1]], np.array([np.inf]))
    closed = chain.nodes[0] == chain.nodes[1] and last > 2
    turn = turns(points[:-1]) if closed else np.concatenate([[0.0], bends(points)])
    turn = np.append(turn, turn[0] if closed else 0.0)
    if closed and abs(turn[0]) > angle:
        turn[[0, -1]] = 0.0  # a corner
    starts, ends = np.array([0]), np.array([last])
    bounds, sizes = [], []
    while len(starts):
        single = ends - starts == 1
        swept = np.where(single, 0.5 * np.abs(turn[starts] + turn[ends]), 0.0)
        wide = np.flatnonzero(~single)
        if len(wide):
            swept[wide] = looks(points, starts[wide], ends[wide])
        kept = single | (swept <= angle * (1.0 + 1e-6))
        with np.errstate(divide="ignore"):
            sizes.append(((along[ends] - along[starts]) * angle / swept)[kept])
        bounds.append(along[starts][kept])
        starts, ends = starts[~kept], ends[~kept]
        middle = np.searchsorted(along, 0.5 * (along[starts] + along[ends]))
        middle = np.clip(middle, starts + 1, ends - 1)
        starts, ends = np.concatenate([starts, middle]), np.concatenate([middle, ends])
    order = np.argsort(np.concatenate(bounds), kind="stable")
    return Arcs(np.append(np.concatenate(bounds)[order], along[-1]), np.concatenate(sizes)[order])


def looks(points: Floats, starts: np.ndarray, ends: np.ndarray) -> Floats:
    """(p,) the angle, radians up to 2 pi, of the arc that each stretch of two segments or more looks like."""
    inner = ends - starts - 1
    part = np.repeat(np.arange(len(starts)), inner)
    at = np.arange(len(part)) - np.repeat(np.cumsum(inner) - inner, inner) + starts[part] + 1
    chord = points[ends] - points[starts]
    length = np.linalg.norm(chord, axis=1)
    off = points[at] - points[starts][part]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (off * chord[part]).sum(axis=1) / length[part] ** 2
        height = np.abs(off[:, 0] * chord[part, 1] - off[:, 1] * chord[part, 0]) / length[part]
        # A vertex beside the middle is lower than the middle, as on a parabola.
        height = height / np.maximum(4.0 * along * (1.0 - along), LEAST_HEIGHT)
        highest = np.maximum.reduceat(height, np.cumsum(inner) - inner)
        beyond = np.maximum.reduceat(np.abs(along - 0.5), np.cumsum(inner) - inner)
        swept = 4.0 * np.arctan(2.0 * highest / length)
    return np.where(np.isfinite(swept) & (beyond <= 0.5), swept, 2.0 * np.pi)
