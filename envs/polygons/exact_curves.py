"""Curves as drawings define them, exact: the nearest place to a point, and places along the way between two of them.

A circle's and an ellipse's parameter is an angle in radians, another curve's whatever its function takes. A curve
whose ends meet is closed: the way between two places on it may lead over them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
import shapely
from numpy.polynomial import chebyshev

from envs.polygons.turning import signed_angles
from envs.types import Floats, Ints

#: Ends of a curve closer than this share of its length are one place, a sweep as close to a full turn is one.
CLOSES = 1e-6

#: Chords of a curve's table in each of its smooth spans, before any is halved ...
CHORDS = 4

#: ... what neighbouring ones turn by at most (radians), ...
TURN = np.radians(5.0)

#: ... and how often one is halved.
HALVINGS = 10

#: Chords of a table at most, that are halved.
MOST_CHORDS = 100_000

#: Half the step that a tangent is measured over, as a share of the parameters that are searched.
TANGENT = 1e-4

#: Parameters closer than this share of the largest one are one.
ROUNDING = 2e-16

#: Places that the length of a piece of a curve is measured at.
STATIONS = 17

#: Newton's steps from a length to a parameter; each doubles the digits of the one before.
STEPS = 6


class Table(NamedTuple):
    """A curve in chords.

    Attributes:
        parameters: (n,) ascending.
        points: (n, 2) places on the curve.
        lengths: (n,) of the chords up to each.
    """

    parameters: Floats
    points: Floats
    lengths: Floats


@dataclass(frozen=True, eq=False)
class CircleArc:
    """An arc of a circle; of a full turn: the circle.

    Attributes:
        centre: (2,) float64.
        radius: above 0.
        start: angle at which it begins, radians.
        sweep: what it turns by, radians, negative for clockwise, -2 pi to 2 pi.
    """

    centre: Floats
    radius: float
    start: float = 0.0
    sweep: float = 2.0 * np.pi

    @property
    def closed(self) -> bool:
        """Whether it is a whole circle."""
        return abs(self.sweep) >= 2.0 * np.pi * (1.0 - CLOSES)

    def at(self, parameters: Floats, /) -> Floats:
        """(m, 2) places at (m,) angles, radians."""
        return np.asarray(self.centre) + self.radius * np.stack([np.cos(parameters), np.sin(parameters)], axis=-1)

    def nearest(self, points: Floats, /) -> Floats:
        """(m,) angles, radians, of the nearest places to (m, 2) points, from the start's angle to the end's."""
        off = np.asarray(points, dtype=np.float64) - np.asarray(self.centre)
        way = np.copysign(1.0, self.sweep)
        swept = (way * (np.arctan2(off[:, 1], off[:, 0]) - self.start)) % (2.0 * np.pi)
        if not self.closed:
            # Beyond the end: whichever end is nearer.
            length = abs(self.sweep)
            swept = np.where(swept > length, np.where(swept - length < 2.0 * np.pi - swept, length, 0.0), swept)
        return self.start + way * swept

    def between(self, a: Floats, b: Floats, fractions: Floats, /) -> Floats:
        """(m, f, 2) places at (f,) fractions of the arc's length from (m, 2) places a on it to b.

        On a whole circle the way is the shorter one; from the start's side where both are equal.
        """
        first = self.nearest(a)
        turn = self.nearest(b) - first
        if self.closed:
            turn = shorter(turn, 2.0 * np.pi)
        return self.at(first[:, None] + turn[:, None] * fractions)


class Sampled(ABC):
    """A curve known by its places at parameters."""

    @property
    @abstractmethod
    def bounds(self) -> Floats:
        """(s + 1,) ascending parameters between which the curve is smooth."""

    @abstractmethod
    def raw(self, parameters: Floats) -> Floats:
        """(m, 2) places at (m,) parameters within the bounds."""

    @cached_property
    def table(self) -> Table:
        """The curve in chords that turn by little."""
        spans = self.bounds
        t = np.append(np.linspace(spans[:-1], spans[1:], CHORDS, endpoint=False, axis=1).ravel(), spans[-1])
        p = self.raw(t)
        for _ in range(HALVINGS):
            steps = np.diff(p, axis=0)
            sharp = np.abs(signed_angles(steps[:-1], steps[1:])) > TURN
            coarse = np.append(sharp, False) | np.append(False, sharp)
            if not coarse.any() or len(t) + coarse.sum() > MOST_CHORDS:
                break
            middle = 0.5 * (t[:-1] + t[1:])[coarse]
            before = np.flatnonzero(coarse) + 1
            t, p = np.insert(t, before, middle), np.insert(p, before, self.raw(middle), axis=0)
        return Table(t, p, np.append(0.0, np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))))

    @cached_property
    def chords(self) -> shapely.STRtree:
        """The table's chords, to look the nearest one up."""
        points = self.table.points
        return shapely.STRtree(shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1)))

    @cached_property
    def closed(self) -> bool:
        """Whether its ends meet."""
        points, lengths = self.table.points, self.table.lengths
        return bool(np.linalg.norm(points[0] - points[-1]) <= CLOSES * lengths[-1])

    def place(self, parameters: Floats) -> Floats:
        """(m, 2) places at any (m,) parameters: a closed curve goes round, an open one stops at its ends."""
        low, high = self.bounds[[0, -1]]
        if not self.closed:
            return self.raw(np.clip(parameters, low, high))
        beyond = (parameters < low) | (parameters > high)
        return self.raw(np.where(beyond, low + (parameters - low) % (high - low), parameters))

    def nearest(self, points: Floats, /) -> Floats:
        """(m,) parameters of the nearest places to (m, 2) points.

        The nearest chord says where to look; there the curve's tangent is square to the way to the point. For a point
        off the curve by more than its radius there, another place may be as near.
        """
        from scipy.optimize.elementwise import find_root  # half a second that straight outlines need not wait

        points = np.asarray(points, dtype=np.float64)
        if not len(points):
            return np.empty(0)
        t, low, high = self.table.parameters, *self.bounds[[0, -1]]
        chord = self.chords.nearest(shapely.points(points))
        # The chord and its neighbours; those of a closed curve's first and last chord go round.
        period = high - low if self.closed else 0.0
        first = np.where(chord > 0, t[chord - 1], t[-2] - period if self.closed else low)
        after = np.minimum(chord + 2, len(t) - 1)
        last = np.where(chord + 2 < len(t), t[after], t[1] + period if self.closed else high)

        def leaning(s: Floats, x: Floats, y: Floats, step: Floats) -> Floats:
            tangent = self.place(s + step) - self.place(s - step)
            off = self.place(s) - np.stack([x, y], axis=-1)
            return (off * tangent).sum(axis=-1)

        # Without one of its own a root at 0 would be approached for a thousand steps.
        close = {"xatol": ROUNDING * max(abs(low), abs(high))}
        found = find_root(leaning, (first, last), args=(*points.T, TANGENT * (last - first)), tolerances=close).x
        # Where the tangent is square nowhere, an end is nearest; where it is at several places, the chord says which.
        a, ahead = self.table.points[chord], self.table.points[chord + 1] - self.table.points[chord]
        squares = np.maximum((ahead**2).sum(axis=1), np.finfo(np.float64).tiny)
        share = ((points - a) * ahead).sum(axis=1) / squares
        beside = t[chord] + np.clip(share, 0.0, 1.0) * (t[chord + 1] - t[chord])
        choices = np.stack([np.where(np.isfinite(found), found, beside), beside, first, last])
        off = np.stack([np.linalg.norm(self.place(s) - points, axis=1) for s in choices])
        best = choices[off.argmin(axis=0), np.arange(len(points))]
        return np.where(best < low, best + period, np.where(best > high, best - period, best))

    def between(self, a: Floats, b: Floats, fractions: Floats, /) -> Floats:
        """(m, f, 2) places at (f,) fractions, 0 to 1, of the curve's length from (m, 2) places a on it to b.

        Of its length, since a parameter may pass unevenly, or stand still at an end: nodes at equal lengths are those
        of a smooth map whatever the parameter is, so that interpolation through them has the full order. On a closed
        curve the way is the shorter one.
        """
        start, way = self.way(self.nearest(a), self.nearest(b))
        # From the lower parameter to the higher one, in pieces without a break.
        low, high = np.minimum(start, start + way), np.maximum(start, start + way)
        at, owner = self.pieces(low, high)
        x, derivative, integral, to_coefficients = stations()
        places = self.place((at[:, :1] + (at[:, 1:] - at[:, :1]) * x).ravel()).reshape(len(at), STATIONS, 2)
        speed = np.linalg.norm(np.einsum("ij,mjk->mik", derivative, places), axis=2)
        length = np.maximum.accumulate(speed @ integral.T, axis=1)
        ends = np.append(0.0, np.cumsum(length[:, -1]))
        mine = np.arange(len(low))
        first, last = np.searchsorted(owner, mine, "left"), np.searchsorted(owner, mine, "right")
        forward = np.broadcast_to(np.asarray(fractions, dtype=np.float64), (len(low), len(fractions)))
        share = np.where(way[:, None] < 0.0, 1.0 - forward, forward)
        reach = ends[first, None] + share * (ends[last] - ends[first])[:, None]
        piece = np.clip(np.searchsorted(ends, reach, "right") - 1, first[:, None], last[:, None] - 1)
        t = share_of_piece(length, speed, piece.ravel(), (reach - ends[piece]).ravel(), to_coefficients)
        begins, ends = at[piece.ravel()].T
        return self.place(begins + (ends - begins) * t).reshape(*share.shape, 2)

    def pieces(self, low: Floats, high: Floats) -> tuple[Floats, Ints]:
        """(p, 2) the ways from (m,) parameters to higher ones, cut at the breaks; (p,) int64, whose each is."""
        breaks = self.bounds
        if self.closed:
            period = breaks[-1] - breaks[0]
            breaks = np.concatenate([breaks[:-1] - period, breaks, breaks[1:] + period])
        first, last = np.searchsorted(breaks, low, "right"), np.searchsorted(breaks, high, "left")
        count = np.maximum(last - first, 0) + 1
        owner = np.repeat(np.arange(len(low)), count)
        number = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        inner = first[owner] + number
        begins = np.where(number == 0, low[owner], breaks[np.clip(inner - 1, 0, len(breaks) - 1)])
        ends = np.where(number == count[owner] - 1, high[owner], breaks[np.minimum(inner, len(breaks) - 1)])
        return np.stack([begins, ends], axis=1), owner

    def way(self, first: Floats, last: Floats) -> tuple[Floats, Floats]:
        """Where the way between (m,) parameters begins, and by how much the parameter changes along it, (m,) each."""
        change = last - first
        if not self.closed:
            return first, change
        low, high = self.bounds[[0, -1]]
        t, _, lengths = self.table
        direct = np.abs(np.interp(last, t, lengths) - np.interp(first, t, lengths))
        over = direct > 0.5 * lengths[-1] * (1.0 + CLOSES)
        return first, np.where(over, change - np.copysign(high - low, change), change)


@dataclass(frozen=True, eq=False)
class EllipseArc(Sampled):
    """The arc centre + major cos(t) + minor sin(t), t from ``start`` over ``sweep`` radians.

    Attributes:
        centre: (2,) float64.
        major, minor: (2,) float64, two conjugate half diameters, such as the half axes; not parallel.
        start: parameter at which it begins, radians; not its angle from the axis.
        sweep: -2 pi to 2 pi; a full turn: the whole ellipse.
    """

    centre: Floats
    major: Floats
    minor: Floats
    start: float = 0.0
    sweep: float = 2.0 * np.pi

    @cached_property
    def bounds(self) -> Floats:
        """(5,) quarters of the way."""
        return np.sort(self.start + self.sweep * np.linspace(0.0, 1.0, 5))

    def at(self, parameters: Floats, /) -> Floats:
        """(m, 2) places at (m,) parameters."""
        t = np.asarray(parameters)[..., None]
        return np.asarray(self.centre) + np.cos(t) * np.asarray(self.major) + np.sin(t) * np.asarray(self.minor)

    def raw(self, parameters: Floats) -> Floats:
        """(m, 2) places at (m,) parameters."""
        return self.at(parameters)


@dataclass(frozen=True, eq=False)
class ParametricCurve(Sampled):
    """A curve by a function of its parameter, such as a spline; it pickles when its function does.

    Attributes:
        at: (m,) parameters to (m, 2) places, such as a vector-valued ``scipy.interpolate.BSpline`` or ``PPoly``.
        breaks: (s + 1,) parameters, ascending or descending, from one end to the other; between them it is smooth.
    """

    at: Callable[[Floats], Floats]
    breaks: Floats

    @cached_property
    def bounds(self) -> Floats:
        """(s + 1,) the breaks, ascending."""
        return np.unique(np.asarray(self.breaks, dtype=np.float64))

    def raw(self, parameters: Floats) -> Floats:
        """(m, 2) places at (m,) parameters within the breaks."""
        return self.at(parameters)


@dataclass(frozen=True, eq=False)
class Rational:
    """The function of a rational curve.

    Attributes:
        weighted: (m,) parameters to (m, 3): x and y times the weight, and the weight, as a ``BSpline`` gives them.
    """

    weighted: Callable[[Floats], Floats]

    def __call__(self, parameters: Floats) -> Floats:
        """(m, 2) places at (m,) parameters."""
        places = self.weighted(parameters)
        return places[..., :2] / places[..., 2:]


def arc_between(a: Floats, b: Floats, sweep: float) -> CircleArc:
    """The circular arc from a to b that turns by ``sweep`` radians, 0 < |sweep| < 2 pi, negative for clockwise."""
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    chord = b - a
    radius = float(np.hypot(*chord)) / (2.0 * abs(np.sin(sweep / 2.0)))
    aside = np.array([-chord[1], chord[0]]) / (2.0 * np.tan(sweep / 2.0))
    centre = 0.5 * (a + b) + aside
    return CircleArc(centre, radius, float(np.arctan2(*(a - centre)[::-1])), sweep)


def share_of_piece(length: Floats, speed: Floats, piece: Ints, reach: Floats, to_coefficients: Floats) -> Floats:
    """(n,) shares, 0 to 1, of a piece's parameters after which its length has been walked to some reach.

    Args:
        length: (p, STATIONS) lengths walked at each station of every piece.
        speed: (p, STATIONS) their derivatives there.
        piece: (n,) int64, which piece is walked.
        reach: (n,) how far.
        to_coefficients: what makes Chebyshev coefficients of values at stations.
    """
    x = stations()[0]
    walked = length[piece]
    after = np.clip((walked <= reach[:, None]).sum(axis=1), 1, STATIONS - 1)
    rows = np.arange(len(piece))
    step = walked[rows, after] - walked[rows, after - 1]
    over = np.divide(reach - walked[rows, after - 1], step, out=np.zeros_like(step), where=step > 0.0)
    share = x[after - 1] + np.clip(over, 0.0, 1.0) * (x[after] - x[after - 1])
    c_length, c_speed = walked @ to_coefficients.T, speed[piece] @ to_coefficients.T
    for _ in range(STEPS):
        basis = chebyshev.chebvander(2.0 * share - 1.0, STATIONS - 1)
        rate = (basis * c_speed).sum(axis=1)
        off = (basis * c_length).sum(axis=1) - reach
        change = np.divide(off, rate, out=np.zeros_like(off), where=rate > 0.0)
        share = np.clip(share - np.clip(change, -0.1, 0.1), 0.0, 1.0)
    return share


def shorter(change: Floats, period: float) -> Floats:
    """Changes of a parameter that comes round, -period to period, the shorter way: -period / 2 to period / 2."""
    return np.where(np.abs(change) > 0.5 * period * (1.0 + CLOSES), change - np.copysign(period, change), change)


@lru_cache(maxsize=1)
def stations() -> tuple[Floats, Floats, Floats, Floats]:
    """Chebyshev's points in [0, 1], and what makes of values there derivatives, integrals from 0, and coefficients."""
    x = chebyshev.chebpts2(STATIONS)
    to_coefficients = np.asarray(np.linalg.inv(chebyshev.chebvander(x, STATIONS - 1)), dtype=np.float64)
    slopes, sums = chebyshev.chebder(np.eye(STATIONS)), chebyshev.chebint(np.eye(STATIONS), lbnd=-1.0)
    derivative = 2.0 * chebyshev.chebvander(x, STATIONS - 2) @ slopes @ to_coefficients
    integral = 0.5 * chebyshev.chebvander(x, STATIONS) @ sums @ to_coefficients
    return 0.5 * (x + 1.0), derivative, integral, to_coefficients
