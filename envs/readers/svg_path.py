"""The ``d`` of an SVG path: its subpaths, each straight stretches, arcs and Bezier curves end to end."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import comb
from typing import NamedTuple

import numpy as np

from envs.polygons.exact_curves import ParametricCurve
from envs.polygons.rings import check_coordinates, check_count
from envs.readers.file_check import excerpt
from envs.readers.pieces import Piece, arc_piece
from envs.types import RELATIVE_TOLERANCE, DomainError, Floats

#: Curves of a drawing at most.
MOST_CURVES = 200_000

BETWEEN = re.compile(r"[\s,]*")
COMMAND = re.compile(r"[MmZzLlHhVvCcSsQqTtAa]")
NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
FLAG = re.compile(r"[01]")

#: Numbers behind each command, again and again.
NUMBERS = {"M": 2, "Z": 0, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7}

#: Which numbers of an arc are flags: a digit each, perhaps without anything between it and the next.
FLAGS = (3, 4)


@dataclass(frozen=True, eq=False)
class Bezier:
    """The function of a Bezier curve.

    Attributes:
        controls: (n + 1, 2) float64.
    """

    controls: Floats

    def __call__(self, parameters: Floats) -> Floats:
        """(m, 2) places at (m,) parameters, 0 to 1 along the curve."""
        t, degree = np.asarray(parameters)[..., None], len(self.controls) - 1
        weights = [comb(degree, k) * t**k * (1.0 - t) ** (degree - k) for k in range(degree + 1)]
        return np.asarray(sum(w * control for w, control in zip(weights, self.controls, strict=True)))


@dataclass(frozen=True, eq=False)
class Transform:
    """An affine map, (x, y) to matrix @ (x, y) + offset.

    Attributes:
        matrix: (2, 2) float64.
        offset: (2,) float64.
    """

    matrix: Floats
    offset: Floats

    def places(self, points: Floats) -> Floats:
        """(k, 2) points, mapped."""
        return np.asarray(points @ self.matrix.T + self.offset)

    def after(self, other: Transform) -> Transform:
        """The map that does the other one first."""
        return Transform(self.matrix @ other.matrix, self.matrix @ other.offset + self.offset)


@dataclass(eq=False)
class Subpath:
    """One stretch of a path without a jump.

    Attributes:
        pieces: end to end, in the drawing's coordinates.
        closed: whether the path says that it closes.
    """

    pieces: list[Piece]
    closed: bool = False


class Pen:
    """Draws subpaths in an element's coordinates, and maps them to the drawing's.

    Attributes:
        subpaths: those drawn so far.
        at: where the pen is.
    """

    def __init__(self, transform: Transform, source: str) -> None:
        self.subpaths: list[Subpath] = []
        self.at = self.start = np.zeros(2)
        self.transform, self.source = transform, source
        self.run: list[Floats] = []
        self.curves = self.vertices = 0

    def move(self, to: Floats) -> None:
        """Begin a subpath."""
        self.lay()
        self.subpaths.append(Subpath([]))
        self.at = self.start = to
        self.run = [to]

    def line(self, to: Floats) -> None:
        """A straight line."""
        self.begin()
        self.run.append(to)
        self.vertices += 1
        check_count(self.vertices, self.source)
        self.at = to

    def bezier(self, *controls: Floats) -> None:
        """A Bezier curve from here, by its other control points."""
        points = np.array([self.at, *controls])
        if straight(points):
            self.line(points[-1])
            return
        self.begin()
        placed = self.transform.places(points)
        curve = ParametricCurve(Bezier(placed), np.array([0.0, 1.0]))
        self.add(Piece(placed[[0, -1]], curve, (0.0, 1.0)), points[-1])

    def arc(self, radii: Floats, turned: float, large: bool, sweeping: bool, to: Floats) -> None:
        """An arc of an ellipse from here, as SVG 1.1 states it (its appendix F.6)."""
        radii = np.abs(radii)
        if not np.any(to != self.at):
            return
        if not radii.all() or not np.isfinite(radii).all():
            self.line(to)
            return
        c, s = np.cos(np.radians(turned)), np.sin(np.radians(turned))
        # In the ellipse's own frame, its axes scaled to one.
        half = np.array([[c, s], [-s, c]]) @ (0.5 * (self.at - to)) / radii
        size = float(half @ half)
        radii = radii * np.sqrt(max(1.0, size))
        half = half / np.sqrt(max(1.0, size))
        off = np.sqrt(max(0.0, 1.0 / max(float(half @ half), 1e-300) - 1.0)) * (-1.0 if large == sweeping else 1.0)
        middle = off * np.array([half[1], -half[0]])
        first, last = half - middle, -half - middle
        start = float(np.arctan2(first[1], first[0]))
        sweep = (float(np.arctan2(last[1], last[0])) - start) % (2 * np.pi)
        sweep = sweep if sweeping else sweep - 2 * np.pi
        axes = np.array([[c, -s], [s, c]]) * radii
        self.begin()
        centre = 0.5 * (self.at + to) + axes @ middle
        self.add(self.arc_piece(centre, axes, start, sweep, np.array([self.at, to])), to)

    def arc_piece(self, centre: Floats, axes: Floats, start: float, sweep: float, ends: Floats | None = None) -> Piece:
        """An arc of the ellipse with the half axes in the columns of (2, 2) ``axes``, in the drawing's coordinates."""
        there = self.transform.places(centre[None])
        turned = self.transform.matrix @ axes
        check_coordinates(np.concatenate([there, turned, [[start, sweep]]]), self.source, lambda _: "an arc")
        tips = None if ends is None else self.transform.places(ends)
        return arc_piece(there[0], turned[:, 0], turned[:, 1], start, sweep, tips)

    def whole(self, centre: Floats, radii: Floats) -> None:
        """A whole ellipse, a subpath of its own."""
        self.move(centre + np.array([radii[0], 0.0]))
        self.add(self.arc_piece(centre, np.diag(radii), 0.0, 2 * np.pi), self.at)
        self.subpaths[-1].closed = True
        self.run = []

    def close(self) -> None:
        """A straight line back to where the subpath began, which is then closed."""
        if self.subpaths:
            if np.any(self.at != self.start):
                self.line(self.start)
            self.lay()
            self.subpaths[-1].closed = True
            self.at = self.start
            self.run = []

    def begin(self) -> None:
        """Begin a subpath where the last one was closed, if none was begun."""
        if not self.subpaths or self.subpaths[-1].closed:
            self.move(self.at)

    def add(self, piece: Piece, to: Floats) -> None:
        """Add a curve to here."""
        self.lay()
        self.curves += 1
        if self.curves > MOST_CURVES:
            raise DomainError(f"{self.source}: more than {MOST_CURVES:,} curves; simplify the drawing")
        check_coordinates(piece.rough, self.source)
        self.subpaths[-1].pieces.append(piece)
        self.at = to
        self.run = [to]

    def lay(self) -> None:
        """Make a piece of the straight lines drawn last."""
        if len(self.run) > 1:
            points = self.transform.places(np.array(self.run))
            check_coordinates(points, self.source)
            apart = np.append(True, np.any(points[1:] != points[:-1], axis=1))
            if apart.sum() > 1:
                self.subpaths[-1].pieces.append(Piece(points[apart]))
        self.run = self.run[-1:]


def straight(points: Floats) -> bool:
    """Whether the (n, 2) control points of a Bezier curve lie in order on a straight line, within rounding."""
    chord = points[-1] - points[0]
    length = float(np.hypot(*chord))
    if not 0.0 < length < np.inf:
        return not np.any(points != points[0])
    off = points - points[0]
    along = off @ chord / length
    aside = np.abs(off[:, 0] * chord[1] - off[:, 1] * chord[0]) / length
    return bool(aside.max() <= RELATIVE_TOLERANCE * length and np.all(np.diff(along) >= -RELATIVE_TOLERANCE * length))


class Numbers:
    """The numbers and commands of a path, one after another."""

    def __init__(self, text: str, where: str) -> None:
        self.text, self.where, self.at = text, where, 0

    def command(self) -> str | None:
        """The next command's letter; None where a number is next, or nothing."""
        self.at = BETWEEN.match(self.text, self.at).end()  # type: ignore[union-attr]
        match = COMMAND.match(self.text, self.at)
        if match is None:
            return None
        self.at = match.end()
        return match.group()

    @property
    def go_on(self) -> bool:
        """Whether a number is next."""
        self.at = BETWEEN.match(self.text, self.at).end()  # type: ignore[union-attr]
        return NUMBER.match(self.text, self.at) is not None

    @property
    def ended(self) -> bool:
        """Whether nothing is left."""
        return self.at == len(self.text)

    def number(self, flag: bool = False) -> float:
        """The next number; a flag is one digit.

        Raises:
            DomainError: there is none.
        """
        self.at = BETWEEN.match(self.text, self.at).end()  # type: ignore[union-attr]
        match = (FLAG if flag else NUMBER).match(self.text, self.at)
        if match is None:
            found = excerpt(self.text[self.at : self.at + 20]) or "its end"
            raise DomainError(
                f"{self.where}: character {self.at} of the path: {found!r} where a number is needed; correct it"
            )
        self.at = match.end()
        return float(match.group())


def draw(pen: Pen, text: str, where: str) -> None:
    """Draw a path.

    Args:
        pen: draws it.
        text: its ``d``.
        where: what messages begin with.

    Raises:
        DomainError: what is no path, or one of too many curves.
    """
    numbers = Numbers(text, where)
    command = numbers.command()
    if command is None and numbers.ended:
        return
    if command not in ("M", "m"):
        raise DomainError(f"{where}: a path begins with M, this one with {excerpt(text, 20)!r}; correct it")
    mirrored = Mirrored("", pen.at)
    while command is not None:
        letter, relative = command.upper(), command.islower()
        first = True
        while first or (letter != "Z" and numbers.go_on):
            given = np.array([numbers.number(letter == "A" and k in FLAGS) for k in range(NUMBERS[letter])])
            mirrored = stroke(pen, letter, given, pen.at if relative else np.zeros(2), mirrored)
            letter = "L" if letter == "M" else letter  # what follows the first pair are lines
            first = False
        command = numbers.command()
    if not numbers.ended:
        found = excerpt(text[numbers.at : numbers.at + 20])
        raise DomainError(f"{where}: character {numbers.at} of the path: {found!r} is no command; correct it")
    pen.lay()


class Mirrored(NamedTuple):
    """What a smooth command mirrors.

    Attributes:
        kind: of the curve before, C or Q; empty: it was none.
        control: (2,) its last control point.
    """

    kind: str
    control: Floats


def stroke(pen: Pen, letter: str, n: Floats, base: Floats, before: Mirrored) -> Mirrored:
    """Draw a command's stroke.

    Args:
        pen: draws it.
        letter: of the command, in upper case.
        n: its numbers.
        base: (2,) what they are relative to.
        before: of the command before.

    Returns:
        What the next command may mirror.
    """
    at = pen.at
    match letter:
        case "M":
            pen.move(base + n)
        case "Z":
            pen.close()
        case "L":
            pen.line(base + n)
        case "H":
            pen.line(np.array([base[0] + n[0], at[1]]))
        case "V":
            pen.line(np.array([at[0], base[1] + n[0]]))
        case "A":
            pen.arc(n[:2], float(n[2]), bool(n[3]), bool(n[4]), base + n[5:])
        case "C" | "Q":
            points = base + n.reshape(-1, 2)
            pen.bezier(*points)
            return Mirrored(letter, points[-2])
        case "S":
            first = 2.0 * at - before.control if before.kind == "C" else at
            points = base + n.reshape(2, 2)
            pen.bezier(first, *points)
            return Mirrored("C", points[0])
        case "T":
            control = 2.0 * at - before.control if before.kind == "Q" else at
            pen.bezier(control, base + n)
            return Mirrored("Q", control)
    return Mirrored("", pen.at)
