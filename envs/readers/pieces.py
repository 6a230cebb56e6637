"""Pieces of a drawing: stretches between two places, straight from vertex to vertex or along one smooth curve.

A piece has a parameter: on a straight one, the number of the vertex and the share of the way to the next; on a smooth
one, the curve's own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely

from envs.polygons import curves
from envs.polygons.curves import Flattening, pinned
from envs.polygons.exact_curves import CircleArc, EllipseArc, ParametricCurve
from envs.types import Floats

#: Chords that stand for a quarter of a turn, or a smooth span, where places are looked for near a curve.
CHORDS = 8

#: Finer chords for each of them, where it matters whether one curve lies on another, ...
FINE = 64

#: ... and by what that divides how far the curve lies off: a chord's sagitta goes with the square of its length.
FINER = FINE * FINE / 2

#: Half the step that a tangent is measured over, as a share of the piece's parameters, ...
TANGENT = 1e-6

#: ... and steps to the parameter of a place.
STEPS = 5

#: An arc of a smaller sweep (radians) is flattened from its ends: its centre may lie too far away.
FLAT = 0.1

Smooth = CircleArc | EllipseArc | ParametricCurve


@dataclass(frozen=True, eq=False)
class Piece:
    """One stretch.

    Attributes:
        points: (k, 2) float64: the vertices of a straight one; of a smooth one its two ends, or none that are given.
        curve: of a smooth one.
        span: of a smooth one, the parameters at which it begins and ends, in either order.
        entity: number of what it was drawn as.
    """

    points: Floats
    curve: Smooth | None = None
    span: tuple[float, float] = (0.0, 0.0)
    entity: int = 0

    @cached_property
    def parameters(self) -> Floats:
        """(k,) parameters of its rough places, from its start to its end."""
        if self.curve is None:
            return np.arange(len(self.points), dtype=np.float64)
        start, end = self.span
        return (
            np.concatenate(
                [np.linspace(a, b, CHORDS, endpoint=False) for a, b in zip(*smooth_spans(self), strict=True)] + [[end]]
            )
            if start != end
            else np.array([start, end])
        )

    @cached_property
    def rough(self) -> Floats:
        """(k, 2) its rough places: the vertices of a straight one, some places on a curve."""
        if self.curve is None:
            return self.points
        found = np.asarray(self.curve.at(self.parameters), dtype=np.float64)
        return pinned(found, *self.points) if len(self.points) == 2 else found

    @cached_property
    def fine_parameters(self) -> Floats:
        """(m,) parameters of places on a curve, from whose chords it lies off by a share 1 / ``FINER`` of its bulge."""
        t = self.parameters
        steps = np.linspace(0.0, 1.0, FINE, endpoint=False)
        return np.append((t[:-1, None] + steps * np.diff(t)[:, None]).ravel(), t[-1])

    @cached_property
    def fine(self) -> Floats:
        """(m, 2) these places; the vertices of a straight piece."""
        return self.points if self.curve is None else self.at(self.fine_parameters)

    @cached_property
    def bulge(self) -> float:
        """How far the curve lies off the chords between its rough places, at most."""
        if self.curve is None:
            return 0.0
        t = self.parameters
        middle = np.asarray(self.curve.at(0.5 * (t[:-1] + t[1:])))
        # In the middle of a chord the curve is furthest off, or nearly so.
        return 1.5 * float(np.linalg.norm(middle - 0.5 * (self.rough[:-1] + self.rough[1:]), axis=1).max())

    @property
    def ends(self) -> Floats:
        """(2, 2) where it begins and ends."""
        return self.rough[[0, -1]]

    @property
    def bounds(self) -> tuple[float, float]:
        """The parameters of its start and end."""
        return self.span if self.curve is not None else (0.0, float(len(self.points) - 1))

    def at(self, parameters: Floats) -> Floats:
        """(m, 2) places at (m,) parameters."""
        if self.curve is not None:
            return np.asarray(self.curve.at(parameters))
        first = np.clip(parameters.astype(np.int64), 0, len(self.points) - 2)
        share = (parameters - first)[:, None]
        return (1.0 - share) * self.points[first] + share * self.points[first + 1]

    def nearest(self, points: Floats, chord: np.ndarray) -> Floats:
        """(m,) parameters of the places where (m, 2) points on the piece, or nearly so, are.

        Args:
            points: about as near to it as rounding lets them be.
            chord: (m,) int, the rough place that the chord nearest to each begins at.
        """
        if self.curve is None:
            a, step = self.points[chord], self.points[chord + 1] - self.points[chord]
            share = ((points - a) * step).sum(axis=1) / (step * step).sum(axis=1)
            return np.asarray(chord + np.clip(share, 0.0, 1.0))
        low, high = sorted(self.span)
        along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(self.fine, axis=0), axis=1)))
        located = shapely.line_locate_point(shapely.LineString(self.fine), shapely.points(points))
        t = np.interp(located, along, self.fine_parameters)
        width = TANGENT * (high - low)
        # Gauss's and Newton's steps: for a point on the curve each doubles the digits of the one before.
        for _ in range(STEPS):
            tangent = (self.at(t + width) - self.at(t - width)) / (2.0 * width)
            length = np.maximum((tangent * tangent).sum(axis=1), np.finfo(np.float64).tiny)
            t = np.clip(t + ((points - self.at(t)) * tangent).sum(axis=1) / length, low, high)
        return t

    def part(self, start: float, end: float, a: Floats, b: Floats) -> Piece:
        """The part between two parameters, in order of the piece, that begins at the place a and ends at b."""
        if self.curve is not None:
            return replace(self, points=np.stack([a, b]), span=(start, end))
        inner = np.arange(np.floor(start) + 1, np.ceil(end), dtype=np.int64)
        return replace(self, points=np.concatenate([a[None], self.points[inner], b[None]]))

    def flattened(self, fineness: Flattening) -> Floats:
        """(n, 2) vertices from its start to its end."""
        if self.curve is None:
            return self.points
        start, end = self.span
        found = chords_of(self, fineness)
        if len(self.points) == 2:
            return pinned(found, *self.points)
        return pinned(found, found[0], found[0]) if is_whole(self.curve, end - start) else found


def chords_of(piece: Piece, fineness: Flattening) -> Floats:
    """(n, 2) vertices of a smooth piece."""
    curve, (start, end) = piece.curve, piece.span
    if isinstance(curve, CircleArc):
        a, b = piece.ends
        if abs(end - start) < FLAT and np.any(a != b):
            return curves.arc_between(a, b, end - start, fineness)
        return curves.arc(curve.centre, curve.radius, start, end - start, fineness)
    if isinstance(curve, EllipseArc):
        return curves.ellipse(curve.centre, curve.major, curve.minor, start, end - start, fineness)
    assert curve is not None
    starts, ends = smooth_spans(piece)
    return curves.sampled(curve.at, np.append(starts, ends[-1:]), fineness)


def smooth_spans(piece: Piece) -> tuple[Floats, Floats]:
    """(s,) parameters where the smooth spans of a smooth piece begin, and (s,) where they end."""
    start, end = piece.span
    if isinstance(piece.curve, ParametricCurve):
        low, high = min(start, end), max(start, end)
        breaks = np.unique(np.asarray(piece.curve.breaks, dtype=np.float64))
        inner = breaks[(breaks > low) & (breaks < high)]
        found = np.concatenate([[low], inner, [high]])
        found = found if start < end else found[::-1]
    else:
        quarters = max(1, int(np.ceil(abs(end - start) / (np.pi / 2) - 1e-9)))
        found = np.linspace(start, end, quarters + 1)
    return found[:-1], found[1:]


def is_whole(curve: Smooth | None, sweep: float) -> bool:
    """Whether a sweep is a full turn of a circle or an ellipse."""
    return isinstance(curve, CircleArc | EllipseArc) and abs(abs(sweep) - 2.0 * np.pi) < 1e-9


def arc_piece(
    centre: Floats, u: Floats, v: Floats, start: float, sweep: float, ends: Floats | None = None, entity: int = 0
) -> Piece:
    """The arc centre + u cos(t) + v sin(t), t from ``start`` over ``sweep`` radians: of a circle where that is one.

    Args:
        ends: (2, 2) where the file says that it begins and ends; None: where the arc does.
    """
    points = np.zeros((0, 2)) if ends is None else ends
    radius, other = float(np.hypot(*u)), float(np.hypot(*v))
    if abs(radius - other) <= 1e-12 * radius and abs(float(u @ v)) <= 1e-12 * radius * radius:
        turn = np.copysign(1.0, u[0] * v[1] - u[1] * v[0])
        begin = float(np.arctan2(u[1], u[0]) + turn * start)
        return Piece(points, CircleArc(centre, radius, begin, turn * sweep), (begin, begin + turn * sweep), entity)
    return Piece(points, EllipseArc(centre, u, v, start, sweep), (start, start + sweep), entity)
