"""Varied domains: random outlines with fine fronts too, and what is drawn most: rectangles, L, T, discs, rings.

A policy that is to mesh any size has to see long straight rows and fine round fronts, which the domains of
``random_domain`` are too coarse for. One seed, one domain.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely

from envs.domains.endless import HELD_OUT, HELD_OUT_PREFIX, EndlessDomains
from envs.domains.random_domain import Wishes, attempt, circle, discretised, roomy, turned
from envs.polygons.element_count import expected_in_domain
from envs.polygons.outline import Spacing, even, wave
from envs.polygons.validation import from_rings
from envs.types import Domain, DomainError, Floats

#: What names of varied domains begin with (``varied-7``, ``varied-held-out-3``), and what else asks for one.
PREFIX, SPEC = "varied-", "varied:"
NAME = re.compile(rf"{PREFIX}({HELD_OUT_PREFIX})?\d+", re.IGNORECASE)

#: Least and most given boundary vertices, and most elements expected of a domain.
FEWEST, MOST, ELEMENTS = 20, 600, 4000

#: Shapes drawn, one after another, until one makes a domain.
ATTEMPTS = 200

#: Points of the outline of a round shape.
FINE = 1440


@dataclass(frozen=True)
class VariedDomains(EndlessDomains):
    """An endless supply of domains called ``varied-SEED``."""

    name: str = "varied"
    vertices: int = 700
    elements: int = 4 * ELEMENTS

    def domain(self, seed: int) -> Domain:
        """See `varied_domain`."""
        return varied_domain(seed)


def varied_domain(seed: int) -> Domain:
    """The domain of a seed: 20 to 600 given vertices, for at most about 4,000 elements.

    Args:
        seed: 0 to 2**63 - 1.

    Raises:
        DomainError: a seed out of its range.
    """
    if not 0 <= seed < 2**63:
        raise DomainError(f"{PREFIX}{seed}: seed = {seed} is out of range; choose it from 0 to {2**63 - 1}")
    name = f"{PREFIX}{seed}" if seed < HELD_OUT else f"{PREFIX}{HELD_OUT_PREFIX}{seed - HELD_OUT}"
    rng = np.random.default_rng(seed)
    shape = SHAPES[int(np.searchsorted(np.cumsum(SHARES), rng.random(), side="right").clip(max=len(SHAPES) - 1))]
    # Small domains are as frequent as large ones.
    vertices = 2 * round(0.5 * FEWEST * (MOST / FEWEST) ** rng.random())
    for _ in range(ATTEMPTS):
        domain = shape(rng, vertices, name)
        if domain is None:
            continue
        expected = expected_in_domain(domain)
        if expected <= ELEMENTS:
            return domain
        vertices = max(FEWEST, 2 * int(0.5 * vertices * min(0.95, np.sqrt(ELEMENTS / expected))))
    raise AssertionError(f"{name}: no {shape.__name__} of {ATTEMPTS} makes a domain")


def is_spec(text: str) -> bool:
    """Whether a text asks for a varied domain."""
    return text.lower().startswith(SPEC) or NAME.fullmatch(text) is not None


def from_spec(spec: str) -> Domain:
    """The domain of ``varied-SEED``, ``varied-held-out-SEED`` or ``varied:SEED``.

    Raises:
        DomainError: no seed, or one out of its range.
    """
    text = spec[len(PREFIX) :].lower()
    try:
        seed = int(text.removeprefix(HELD_OUT_PREFIX))
    except ValueError:
        raise DomainError(f"{spec}: seed = {text!r} is not a whole number; write {PREFIX}7") from None
    return varied_domain(seed + (HELD_OUT if text.startswith(HELD_OUT_PREFIX) else 0))


def outlined(rng: np.random.Generator, vertices: int, name: str) -> Domain | None:
    """A random outline of `random_domain`, evenly spaced or graded."""
    holes = int(np.searchsorted([0.75, 0.92], rng.random())) if vertices > 40 else 0
    unevenness = rng.uniform(1.0, 3.0) if rng.random() < 0.7 else 1.0
    return attempt(rng, Wishes(max(24, vertices), float(rng.random()), holes, float(unevenness)), name)


def rectangle(rng: np.random.Generator, vertices: int, name: str) -> Domain | None:
    """A rectangle: a lattice of n x m squares or nearly so, or graded along its sides."""
    half = vertices // 2
    most = half / 2 if half * half / 4 <= ELEMENTS else 0.5 * (half - np.sqrt(half * half - 4.0 * ELEMENTS))
    n = max(2, round(2.0 * (most / 2.0) ** rng.random()))
    m = max(2, half - n)
    if rng.random() < 0.65:
        stretch = 1.0 if rng.random() < 0.5 else rng.uniform(0.75, 1.33)
        corners = np.array([[0, 0], [n, 0], [n, m], [0, m]], dtype=np.float64)
        return placed(rng, [lattice(corners) * [1.0, stretch]], name)
    return spaced(rng, [sampled(shapely.box(0.0, 0.0, n / m, 1.0))], vertices, name)


def rectilinear(rng: np.random.Generator, vertices: int, name: str) -> Domain | None:
    """L, T, plus, U, stairs and the like, with a window now and then: cells of a lattice, in unit segments."""
    columns, rows = int(rng.integers(2, 4)), int(rng.integers(2, 4))
    cells = rng.random((columns, rows)) < rng.uniform(0.5, 0.9)
    # The perimeter is about 3 sides a column and a row; sides differ by up to 3.
    unit = max(1.0, vertices / (3.0 * (columns + rows)))
    x, y = (
        np.concatenate([[0], np.cumsum(np.maximum(2, np.rint(unit * 3.0 ** rng.uniform(-0.5, 0.5, k))))])
        for k in (columns, rows)
    )
    boxes = [shapely.box(x[i], y[j], x[i + 1], y[j + 1]) for i, j in zip(*np.nonzero(cells), strict=True)]
    union = shapely.union_all(boxes).simplify(0.0)
    if not isinstance(union, shapely.Polygon) or union.is_empty or len(union.exterior.coords) < 7:
        return None
    rings = [lattice(corners_of(ring)) for ring in (union.exterior, *union.interiors)]
    if sum(len(ring) for ring in rings) > MOST:
        return None
    return placed(rng, rings, name)


def disc(rng: np.random.Generator, vertices: int, name: str) -> Domain | None:
    """A disc or an ellipse, evenly spaced or graded."""
    flat = 1.0 if rng.random() < 0.6 else rng.uniform(0.35, 1.0)
    return spaced(rng, [circle(FINE) * [1.0, flat]], vertices, name)


def annulus(rng: np.random.Generator, vertices: int, name: str) -> Domain | None:
    """A ring, its hole in the middle or beside it."""
    inner = rng.uniform(0.15, 0.75)
    aside = np.zeros(2) if rng.random() < 0.5 else np.array([rng.uniform(0.0, 0.7) * (1.0 - inner), 0.0])
    return spaced(rng, [circle(FINE), inner * circle(FINE) + aside], max(32, vertices), name)


#: Shapes, and how often each is drawn.
SHAPES: tuple[Callable[[np.random.Generator, int, str], Domain | None], ...] = (
    outlined, rectangle, rectilinear, disc, annulus,
)  # fmt: skip
SHARES = (0.45, 0.18, 0.15, 0.14, 0.08)


def spaced(rng: np.random.Generator, outlines: list[Floats], vertices: int, name: str) -> Domain | None:
    """The domain of outlines, evenly spaced or graded."""
    spacing: Spacing = even
    if rng.random() < 0.4:
        spacing = wave(rng.uniform(1.3, 3.0), rng.uniform(0.0, np.pi), rng.uniform(1.5, 4.0), rng.uniform(0, 2 * np.pi))
    rings = discretised(outlines, vertices, spacing)
    if rings is None or not roomy(rings):
        return None
    return placed(rng, rings, name)


def placed(rng: np.random.Generator, rings: list[Floats], name: str) -> Domain | None:
    """The domain of rings, the outer one first, turned at random; None where it is none."""
    angle = rng.uniform(0.0, 2 * np.pi)
    rings = [turned(ring, angle) for ring in rings]
    try:
        return from_rings(rings[0], rings[1:], name)
    except DomainError:
        return None


def lattice(corners: Floats) -> Floats:
    """The corners of a rectilinear ring with whole coordinates, (k, 2), and the whole points between them."""
    ahead = np.roll(corners, -1, axis=0) - corners
    counts = np.rint(np.abs(ahead).sum(axis=1)).astype(np.int64)
    return np.concatenate([
        corner + np.arange(count)[:, None] / count * step
        for corner, step, count in zip(corners, ahead, counts, strict=True)
    ])  # fmt: skip


def corners_of(ring: shapely.LinearRing) -> Floats:
    """The corners of a ring, (k, 2): where it runs straight on there is none."""
    points = shapely.get_coordinates(ring)[:-1]
    behind, ahead = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    return points[np.abs(behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0]) > 0.0]


def sampled(polygon: shapely.Polygon) -> Floats:
    """The outer ring of a polygon as a fine polyline, (m, 2), counter-clockwise."""
    corners = shapely.get_coordinates(shapely.orient_polygons(polygon).exterior)[:-1]
    t = np.arange(FINE // len(corners))[:, None] / (FINE // len(corners))
    return (corners[:, None] * (1.0 - t) + np.roll(corners, -1, axis=0)[:, None] * t).reshape(-1, 2)
