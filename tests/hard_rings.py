"""Rings that a mesher has trouble with: families of weakly simple even rings, drawn from a generator."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely

from envs.domains.load import from_rings
from envs.types import Floats, Ints

Ring = tuple[Floats, Ints]


def polar(radius: Floats, angle: Floats) -> Floats:
    """(n, 2) points of (n,) radii and angles."""
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def plain(vertices: Floats) -> Ring:
    """A ring without seams."""
    return vertices, np.arange(len(vertices), dtype=np.int64)


def even(rng: np.random.Generator, low: int, high: int) -> int:
    """An even number from low to high."""
    return 2 * int(rng.integers(low // 2, high // 2 + 1))


def star(rng: np.random.Generator, size: int) -> Ring:
    """Random radii, over a ratio of up to 1000, at random angles."""
    n = even(rng, 4, size)
    gaps = rng.uniform(0.02, 1.0, n)
    while gaps.max() > 0.49 * gaps.sum():
        gaps = rng.uniform(0.02, 1.0, n)
    return plain(polar(10.0 ** rng.uniform(-rng.uniform(0.1, 3.0), 0.0, n), 2 * np.pi * np.cumsum(gaps) / gaps.sum()))


def gear(rng: np.random.Generator, size: int) -> Ring:
    """Square teeth."""
    teeth = int(rng.integers(2, max(3, size // 4 + 1)))
    angle = 2 * np.pi * (np.arange(4 * teeth) + np.tile([0.0, 0.1, 0.0, -0.1], teeth)) / (4 * teeth)
    return plain(polar(np.tile([1.0, 1.0, 0.6, 0.6], teeth) ** rng.uniform(0.1, 4.0), angle))


def comb(rng: np.random.Generator, size: int) -> Ring:
    """Thin prongs of different lengths on a bar."""
    prongs = int(rng.integers(1, max(2, size // 4)))
    width = rng.uniform(0.02, 0.9)
    top: list[tuple[float, float]] = []
    for k in range(prongs):
        height = rng.uniform(0.1, 30.0)
        top += [(k, 0.0), (k, height), (k + width, height), (k + width, 0.0)]
    return plain(np.array([(0.0, -rng.uniform(0.01, 3.0)), (prongs, -1.0 - rng.uniform(0.0, 1.0)), *top[::-1]]))


def spiral(rng: np.random.Generator, size: int) -> Ring:
    """A strip rolled up."""
    n = max(2, even(rng, 4, size) // 2)
    angle = np.linspace(0.0, rng.uniform(0.1, min(4.0, n / 8)) * 2 * np.pi, n)
    radius = 1.0 + angle
    return plain(np.concatenate([polar(radius + rng.uniform(0.02, 3.0), angle), polar(radius, angle)[::-1]]))


def wedge(rng: np.random.Generator, size: int) -> Ring:
    """A sector of 1 to 359 degrees with evenly divided straight sides: angles of exactly pi up to rounding."""
    opening = np.radians(rng.choice([1.0, 2.0, 30.0, 180.0, 300.0, 358.0, 359.0]))
    sides = int(rng.integers(1, max(2, size // 3)))
    arc = even(rng, 2, max(2, size // 3))
    out = np.stack([np.arange(sides) / sides, np.zeros(sides)], axis=1)
    bend = polar(np.ones(arc + 1), opening * np.arange(arc + 1) / arc)
    back = bend[-1] * ((np.arange(sides - 1, 0, -1)) / sides)[:, None]
    return plain(np.concatenate([out, bend, back]))


def lattice(rng: np.random.Generator, size: int) -> Ring:
    """The outline of a union of grid cells grown at random, all its grid points vertices: right angles and runs."""
    cells = {(0, 0)}
    while len(cells) < max(1, size // 3):
        x, y = list(cells)[int(rng.integers(len(cells)))]
        dx, dy = ((1, 0), (0, 1), (-1, 0), (0, -1))[int(rng.integers(4))]
        grown = cells | {(x + dx, y + dy)}
        shape = shapely.union_all([shapely.box(a, b, a + 1, b + 1) for a, b in grown])
        if isinstance(shape, shapely.Polygon) and not shape.interiors and len(shape.exterior.coords) <= 2 * size:
            cells = grown
        elif rng.random() < 0.1:
            break
    shape = shapely.union_all([shapely.box(a, b, a + 1, b + 1) for a, b in cells])
    corners = shapely.get_coordinates(shapely.orient_polygons(shapely.segmentize(shape, 1.0)).exterior)[:-1]
    stretch = 10.0 ** rng.uniform(-2.0, 0.0)
    return plain(corners * [1.0, stretch])


def walk(rng: np.random.Generator, size: int) -> Ring:
    """Random points joined in random order, and untangled by reversing stretches between crossing edges."""
    n = even(rng, 4, min(size, 40))
    ring = rng.uniform(0.0, 1.0, (n, 2))
    tangled = True
    while tangled:
        tangled = False
        lines = shapely.linestrings(np.stack([ring, np.roll(ring, -1, axis=0)], axis=1))
        for i in range(n - 2):
            for j in range(i + 2, n - (i == 0)):
                if shapely.intersects(lines[i], lines[j]):
                    ring[i + 1 : j + 1] = ring[i + 1 : j + 1][::-1].copy()
                    lines = shapely.linestrings(np.stack([ring, np.roll(ring, -1, axis=0)], axis=1))
                    tangled = True
    return plain(ring if shapely.LinearRing(ring).is_ccw else ring[::-1].copy())


def needle(rng: np.random.Generator, size: int) -> Ring:
    """Two chains a thousandth apart, with edges of very different lengths."""
    n = max(2, even(rng, 4, size) // 2)
    x = np.cumsum(10.0 ** rng.uniform(-3.0, 0.0, n))
    y = 0.02 * rng.uniform(-1.0, 1.0, n)
    gap = 10.0 ** rng.uniform(-3.0, -1.0) * rng.uniform(0.5, 1.0, n)
    return plain(np.concatenate([np.stack([x, y], axis=1), np.stack([x, y + gap], axis=1)[::-1]]))


def plate(rng: np.random.Generator, size: int) -> Ring:
    """A plate with one to four holes, joined by seams."""
    holes = int(rng.integers(1, 5))
    count = even(rng, 4, max(4, size // 2))
    angle = 2 * np.pi * (np.arange(count) + rng.uniform(0.1, 0.8, count)) / count
    outer = polar(rng.uniform(3.4, 6.0, count), angle)
    if not shapely.Polygon(outer).contains(shapely.box(-2.0, -2.0, 2.0, 2.0)):
        outer = np.array([(-2.4, -2.4), (2.4, -2.4), (2.4, 2.4), (-2.4, 2.4)])
    corners = [
        polar(rng.uniform(0.1, 0.9, k), 2 * np.pi * np.arange(k) / k) + centre
        for k, centre in zip(rng.integers(3, 7, holes), [(-1, -1), (1, 1), (-1, 1), (1, -1)], strict=False)
    ]
    domain = from_rings(outer, corners, fix_parity=True)
    return domain.points, domain.ring


FAMILIES: tuple[Callable[[np.random.Generator, int], Ring], ...] = (
    star, gear, comb, spiral, wedge, lattice, walk, needle, plate,
)  # fmt: skip


def drawn(seed: int, size: int = 24) -> Ring:
    """A ring of one of the families, turned, scaled and moved; the seed decides."""
    rng = np.random.default_rng(seed)
    points, ring = FAMILIES[seed % len(FAMILIES)](rng, int(rng.integers(4, size + 1)))
    turn = rng.uniform(0.0, 2 * np.pi) if rng.random() < 0.7 else 0.0
    c, s = np.cos(turn), np.sin(turn)
    turned = points @ np.array([[c, s], [-s, c]])
    scale, shift = ((1.0, 0.0), (1e-6, 0.0), (1e6, 0.0), (1.0, 1e6), (1e-6, 1.0))[int(rng.integers(5))]
    return scale * turned + shift, np.roll(ring, int(rng.integers(len(ring))))
