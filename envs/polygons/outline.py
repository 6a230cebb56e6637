"""Outlines: closed curves with corners, and their discretisation into boundary vertices with graded spacing.

An outline is a closed polyline, (m, 2) float64 and much finer than the vertices wanted from it. Its corners are the
vertices where it turns by more than ``CORNER``; the discretisation keeps every corner as a vertex.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from envs.polygons.turning import turns
from envs.types import Floats, Ints

#: An outline's vertex that turns by more than this (radians) is a corner.
CORNER = np.radians(20.0)

#: Relative edge length wanted at (m, 2) places: (m,) positive numbers, of any scale.
Spacing = Callable[[Floats], Floats]


def even(places: Floats) -> Floats:
    """The spacing that is the same everywhere."""
    return np.ones(len(places))


def near(sources: Sequence[Sequence[float]], reach: float, ratio: float) -> Spacing:
    """Spacing 1 at the sources that grows smoothly to ``ratio`` at the distance ``reach`` from all of them."""
    centres = np.array(sources, dtype=np.float64)

    def spacing(places: Floats) -> Floats:
        distance = np.linalg.norm(places[:, None] - centres, axis=2).min(axis=1)
        t = np.clip(distance / reach, 0.0, 1.0)
        return ratio ** (t * t * (3.0 - 2.0 * t))

    return spacing


def wave(ratio: float, direction: float, length: float, phase: float = 0.0) -> Spacing:
    """Spacing that swings between 1 and ``ratio`` along a direction (radians), over a wavelength ``length``."""
    heading = np.array([np.cos(direction), np.sin(direction)])

    def spacing(places: Floats) -> Floats:
        return ratio ** (0.5 + 0.5 * np.sin(2 * np.pi * (places @ heading) / length + phase))

    return spacing


def spline(controls: Sequence[Sequence[float]], samples: int = 48) -> Floats:
    """A closed centripetal Catmull-Rom curve through control points, sharp at those marked as corners.

    Args:
        controls: rows (x, y) or (x, y, corner), corner being 1 or 0; between two corners the curve is straight.
        samples: points of the outline between two controls.

    Returns:
        (len(controls) * samples, 2) float64, in the controls' orientation.
    """
    p = np.array([row[:2] for row in controls], dtype=np.float64)
    corner = np.array([len(row) > 2 and bool(row[2]) for row in controls])
    n = len(p)
    t = np.arange(samples) / samples
    pieces = []
    for i in range(n):
        a, b = p[i], p[(i + 1) % n]
        # Beyond a corner the curve does not look: its neighbour there is mirrored.
        before = 2 * a - b if corner[i] else p[i - 1]
        after = 2 * b - a if corner[(i + 1) % n] else p[(i + 2) % n]
        pieces.append(catmull_rom(before, a, b, after, t))
    return np.concatenate(pieces)


def catmull_rom(p0: Floats, p1: Floats, p2: Floats, p3: Floats, t: Floats) -> Floats:
    """Points between p1 and p2 at t in [0, 1), (len(t), 2): Barry and Goldman's pyramid with centripetal knots."""
    k0 = 0.0
    k1, k2, k3 = np.cumsum([np.sqrt(np.linalg.norm(b - a)) for a, b in ((p0, p1), (p1, p2), (p2, p3))])
    u = (k1 + t * (k2 - k1))[:, None]
    a1 = (k1 - u) / (k1 - k0) * p0 + (u - k0) / (k1 - k0) * p1
    a2 = (k2 - u) / (k2 - k1) * p1 + (u - k1) / (k2 - k1) * p2
    a3 = (k3 - u) / (k3 - k2) * p2 + (u - k2) / (k3 - k2) * p3
    b1 = (k2 - u) / (k2 - k0) * a1 + (u - k0) / (k2 - k0) * a2
    b2 = (k3 - u) / (k3 - k1) * a2 + (u - k1) / (k3 - k1) * a3
    return (k2 - u) / (k2 - k1) * b1 + (u - k1) / (k2 - k1) * b2


def corners(outline: Floats) -> Ints:
    """Indices of the outline's corners."""
    return np.flatnonzero(np.abs(turns(outline)) > CORNER)


def discretise(outline: Floats, n: int, spacing: Spacing = even) -> Floats:
    """Vertices on an outline, its corners among them, at distances that follow the spacing.

    Between two corners the vertices split the integral of ds / spacing evenly, so lengths vary as smoothly as the
    spacing does; how many segments each piece gets is its share of the whole integral, at least one.

    Args:
        outline: (m, 2), closed, no point twice in a row.
        n: vertices wanted.
        spacing: relative edge length by place.

    Returns:
        (n, 2) float64, or as many as the corners when those are more.
    """
    kept = corners(outline)
    first = int(kept[0]) if len(kept) else 0
    closed = np.roll(outline, -first, axis=0)
    closed = np.concatenate([closed, closed[:1]])
    middle = 0.5 * (closed[1:] + closed[:-1])
    steps = np.linalg.norm(np.diff(closed, axis=0), axis=1) / spacing(middle)
    measure = np.concatenate([[0.0], np.cumsum(steps)])
    bounds = np.append((kept - first if len(kept) else np.array([0])), len(outline))
    counts = shares(np.diff(measure[bounds]), n)
    wanted = np.concatenate([
        np.linspace(measure[a], measure[b], count, endpoint=False)
        for a, b, count in zip(bounds[:-1], bounds[1:], counts, strict=True)
    ])  # fmt: skip
    vertices = np.stack([np.interp(wanted, measure, closed[:, axis]) for axis in (0, 1)], axis=1)
    # Interpolation may move a corner by a rounding error: put it back exactly.
    vertices[np.concatenate([[0], np.cumsum(counts)[:-1]])] = closed[bounds[:-1]]
    return vertices


def shares(weights: Floats, n: int) -> Ints:
    """Shares of n in proportion to the weights, (len(weights),), each at least one (Sainte-Lague's quotients)."""
    counts = np.ones(len(weights), dtype=np.int64)
    for _ in range(n - len(weights)):
        counts[np.argmax(weights / (counts + 0.5))] += 1
    return counts
