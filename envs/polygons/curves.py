"""Curves as drawings define them, flattened: vertices on the curve, as far apart as a tolerance allows.

Every function returns (k, 2) float64 points from the curve's start to its end, both included.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from envs.polygons.rings import EDGE_LENGTH, MOST_VERTICES
from envs.polygons.turning import signed_angles
from envs.types import DomainError, Floats

#: Without an edge length, a chord stays within this share of the drawing's extent of its curve ...
SAGITTA = 1e-3

#: ... and an arc's chords turn by at most this (radians).
TURN = np.radians(30.0)

#: With an edge length: the chords of a curve that is to be discretised later, over the edge length ...
FINE_STEP = 1 / 8

#: ... what they turn by at most (radians) ...
FINE_TURN = np.radians(2.0)

#: ... and the shortest of them, over the drawing's extent: with so many an outline is as smooth as it needs to be.
LEAST_STEP = 5e-6

#: Chords of one smooth span at most.
MOST_CHORDS = 1 << 12

#: A step below this share of a curve's length is none.
TINY = 1e-6

#: Rows: coefficients of t^3, t^2, t, 1; columns: the weights of four control points.
CATMULL_ROM = 0.5 * np.array([[-1, 3, -3, 1], [2, -5, 4, -1], [-1, 0, 1, 0], [0, 2, 0, 0]], dtype=np.float64)
B_SPLINE = np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 0, 3, 0], [1, 4, 1, 0]]) / 6.0


class ChordsError(DomainError):
    """Curves of more chords than a boundary may have segments; who knows the file says which."""


@dataclass(frozen=True)
class Flattening:
    """How finely curves become chords.

    Attributes:
        sagitta: largest distance between a chord's middle and the curve.
        step: largest length of a chord.
        turn: largest angle between neighbouring chords, radians.
    """

    sagitta: float
    step: float
    turn: float


def flattening(extent: float, edge_length: float | None) -> Flattening:
    """The flattening that suits a drawing.

    Args:
        extent: diagonal of the drawing's bounding box.
        edge_length: what the outline is to be discretised by afterwards; None: the chords are the boundary segments.
            One so small that no boundary can have it is left for the discretisation to refuse.
    """
    if edge_length is None or extent > MOST_VERTICES * edge_length:
        return Flattening(sagitta=SAGITTA * extent, step=np.inf, turn=TURN)
    return Flattening(sagitta=np.inf, step=max(FINE_STEP * edge_length, LEAST_STEP * extent), turn=FINE_TURN)


def check_chords(chords: float) -> None:
    """Refuse more than ``MOST_VERTICES``, before they are made.

    Raises:
        ChordsError: there would be.
    """
    if chords > MOST_VERTICES:
        raise ChordsError(f"curves of more than {MOST_VERTICES:,} chords; simplify them, or use a larger {EDGE_LENGTH}")


def chords_of_arc(radius: float, sweep: float, fineness: Flattening) -> int:
    """Chords, at least one, of a circular arc of ``sweep`` radians; a chord's sagitta is r (1 - cos(angle / 2))."""
    angle = min(fineness.turn, fineness.step / radius)
    if fineness.sagitta < radius:
        angle = min(angle, 2.0 * float(np.arccos(1.0 - fineness.sagitta / radius)))
    chords = np.ceil(abs(sweep) / angle * (1.0 - 1e-12))
    check_chords(chords)
    return max(1, int(chords))


def arc(centre: Floats, radius: float, start: float, sweep: float, fineness: Flattening) -> Floats:
    """A circular arc from the angle ``start`` over ``sweep`` (radians, negative for clockwise)."""
    angles = start + sweep * np.linspace(0.0, 1.0, chords_of_arc(radius, sweep, fineness) + 1)
    return centre + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def arc_between(a: Floats, b: Floats, sweep: float, fineness: Flattening) -> Floats:
    """The circular arc from a to b that turns by ``sweep`` radians, 0 < |sweep| < 2 pi, exact at both ends.

    The chord from a to the point after an angle phi is the whole chord, turned by (phi - sweep) / 2 and scaled by
    sin(phi / 2) / sin(sweep / 2): no centre is needed, which lies far away when the arc is flat.
    """
    chord = b - a
    radius = float(np.linalg.norm(chord)) / (2.0 * abs(np.sin(sweep / 2.0)))
    phi = sweep * np.linspace(0.0, 1.0, chords_of_arc(radius, sweep, fineness) + 1)
    turn, scale = (phi - sweep) / 2.0, np.sin(phi / 2.0) / np.sin(sweep / 2.0)
    x = scale * (np.cos(turn) * chord[0] - np.sin(turn) * chord[1])
    y = scale * (np.sin(turn) * chord[0] + np.cos(turn) * chord[1])
    return pinned(a + np.stack([x, y], axis=1), a, b)


def ellipse(centre: Floats, major: Floats, minor: Floats, start: float, sweep: float, fineness: Flattening) -> Floats:
    """The arc centre + major cos(t) + minor sin(t), t from ``start`` over ``sweep`` radians."""

    def at(t: Floats) -> Floats:
        return centre + np.cos(t)[:, None] * major + np.sin(t)[:, None] * minor

    quarters = max(1, int(np.ceil(abs(sweep) / (np.pi / 2) - 1e-9)))
    return sampled(at, np.linspace(start, start + sweep, quarters + 1), fineness)


def sampled(at: Callable[[Floats], Floats], breaks: Floats, fineness: Flattening) -> Floats:
    """Points of a parametric curve, each of its smooth spans halved until its chords are fine enough.

    Args:
        at: (k,) parameters to (k, 2) points.
        breaks: (s + 1,) parameters between which the curve is smooth, ascending or descending.
        fineness: how finely.

    Raises:
        ChordsError: too finely.
    """
    pieces, total = [at(breaks[:1])], 0
    for low, high in zip(breaks[:-1], breaks[1:], strict=True):
        chords = 2
        points = at(np.linspace(low, high, chords + 1))
        while chords < MOST_CHORDS and not fine_enough(points, fineness):
            chords *= 2
            points = at(np.linspace(low, high, chords + 1))
        total += chords
        check_chords(total)
        pieces.append(points[1:])
    return without_tiny_steps(np.concatenate(pieces))


def without_tiny_steps(points: Floats) -> Floats:
    """The points without those hardly off the one before: a parameter may pass slowly where a curve begins or ends."""
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    kept = np.append(lengths > TINY * lengths.sum(), True)
    kept[0] = True
    return points[kept]


def fine_enough(points: Floats, fineness: Flattening) -> bool:
    """Whether (k, 2) samples of a smooth span, k odd, keep to a flattening."""
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    if lengths.max() > fineness.step:
        return False
    # The heading of a tiny step is rounding alone.
    steps = steps[lengths > TINY * lengths.sum()]
    if np.abs(signed_angles(steps[:-1], steps[1:])).max(initial=0.0) > fineness.turn:
        return False
    # A quarter of what a chord twice as long is off by.
    off = np.linalg.norm(points[1:-1:2] - 0.5 * (points[:-2:2] + points[2::2]), axis=1) / 4.0
    return bool(off.max() <= fineness.sagitta)


def pinned(points: Floats, a: Floats, b: Floats) -> Floats:
    """The points with the ends put back exactly where they are given."""
    points[0], points[-1] = a, b
    return points
