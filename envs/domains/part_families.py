"""Families of machine parts: each draws a polygon of about unit size, with or without holes, from a generator.

They are for measuring: none repeats a family of :mod:`envs.domains.outline_families`, which are for training.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely
from shapely import affinity

from envs.types import Floats

Family = Callable[[np.random.Generator], shapely.Polygon]

#: Chords in a quarter of a circle; the outline must be much finer than the vertices wanted from it.
QUARTER = 32


def star(rng: np.random.Generator) -> shapely.Polygon:
    """A regular star of 4 to 10 tips, its tips and valleys sharp or rounded, sometimes with a bore."""
    tips = int(rng.integers(4, 11))
    valley = rng.uniform(0.5, 0.82) * np.cos(np.pi / tips)  # 1 would be a convex polygon
    radii = np.where(np.arange(2 * tips) % 2, valley, 1.0)
    polygon = shapely.Polygon(polar(radii, np.pi * np.arange(2 * tips) / tips))
    if rng.random() < 0.4:
        polygon = rounded(polygon, rng.uniform(0.03, 0.06))
    return polygon.difference(disc(0.5 * valley)) if rng.random() < 0.35 else polygon


def comb(rng: np.random.Generator) -> shapely.Polygon:
    """A bar with 3 to 8 teeth, straight or tapered: a comb, a rack, a heat sink."""
    teeth = int(rng.integers(3, 9))
    base, reach = rng.uniform(0.15, 0.4), rng.uniform(0.3, 0.9)
    foot = rng.uniform(0.4, 0.65)  # of the pitch
    tip = foot * rng.choice([1.0, rng.uniform(0.5, 1.0)])
    pitch = 2.0 / teeth
    corners = [(0.0, 0.0), (2.0, 0.0)]
    for k in range(teeth - 1, -1, -1):
        middle = (k + 0.5) * pitch
        for half, height in ((foot, 0.0), (tip, reach), (-tip, reach), (-foot, 0.0)):
            corners.append((middle + 0.5 * half * pitch, base + height))
    left, right = corners[-1][0], corners[2][0]
    corners[0], corners[1] = (left, 0.0), (right, 0.0)
    return shapely.Polygon(corners)


def gear(rng: np.random.Generator) -> shapely.Polygon:
    """A spur gear of 8 to 16 trapezoidal teeth, solid or with a round, square or hexagonal bore."""
    teeth = int(rng.integers(8, 17))
    root = 1.0 - rng.uniform(2.0, 2.8) / teeth
    pitch = 2 * np.pi / teeth
    foot, tip = rng.uniform(0.26, 0.3), rng.uniform(0.13, 0.18)
    corners = []
    for k in range(teeth):
        for radius, low, high in ((1.0, -tip, tip), (root, foot, 1.0 - foot)):
            angles = pitch * (k + np.linspace(low, high, QUARTER // 4))
            corners.append(polar(np.full(len(angles), radius), angles))
    polygon = shapely.Polygon(np.concatenate(corners))
    if rng.random() < 0.5:
        return polygon
    sides = int(rng.choice([4, 6, 4 * QUARTER]))
    return polygon.difference(affinity.scale(regular(sides), *2 * [root * rng.uniform(0.25, 0.5)]))


def spiral(rng: np.random.Generator) -> shapely.Polygon:
    """A flat spring: a strip along an Archimedean spiral of 1.2 to 2.4 turns, its ends flat or round."""
    turns = rng.uniform(1.2, 2.4)
    start = rng.uniform(0.5, 1.0)  # radius at the inner end, over the pitch
    angles = np.linspace(0.0, 2 * np.pi * turns, round(160 * turns))
    radii = start + angles / (2 * np.pi)
    line = shapely.LineString(polar(radii, angles) / radii.max())
    width = rng.uniform(0.4, 0.6) / radii.max()
    return line.buffer(0.5 * width, quad_segs=QUARTER, cap_style=str(rng.choice(["flat", "round"])))


def panel(rng: np.random.Generator) -> shapely.Polygon:
    """A rectangle, its corners sharp, rounded or cut, with bolt holes at the corners, a row of slots or a window."""
    width, height = 2.0, rng.uniform(0.8, 1.6)
    polygon = framed(rng, width, height)
    choice = int(rng.integers(3))
    if choice == 0:
        inset, radius = 0.3, rng.uniform(0.07, 0.12)
        for x in (inset, width - inset):
            for y in (inset, height - inset):
                polygon = polygon.difference(disc(radius, x, y))
        if height > 1.2:
            polygon = polygon.difference(disc(rng.uniform(0.15, 0.25), width / 2, height / 2))
    elif choice == 1:
        count = int(rng.integers(2, 4))
        long, wide = 0.5 * height, rng.uniform(0.1, 0.16)
        for k in range(count):
            x = width * (k + 0.5) / count
            slot = shapely.LineString([(x, 0.5 * (height - long) + wide), (x, 0.5 * (height + long) - wide)])
            polygon = polygon.difference(slot.buffer(wide, quad_segs=QUARTER))
    else:
        rim = rng.uniform(0.2, 0.3)
        window = framed(rng, width - 2 * rim, height - 2 * rim)
        polygon = polygon.difference(affinity.translate(window, rim, rim))
    return polygon


def wedge(rng: np.random.Generator) -> shapely.Polygon:
    """A sector of a disc or of a ring, 35 to 290 degrees wide, sometimes with holes along its middle arc."""
    span, inner = np.radians(rng.uniform(35.0, 290.0)), rng.choice([0.0, rng.uniform(0.35, 0.7)])
    angles = np.linspace(0.0, span, max(24, round(4 * QUARTER * span / 6)))
    arc = polar(np.ones(len(angles)), angles)
    inside = inner * arc[::-1] if inner > 0 else np.zeros((1, 2))
    polygon = shapely.Polygon(np.concatenate([arc, inside]))
    if inner > 0 and rng.random() < 0.35:
        radius, middle = 0.5 * (1 - inner) * rng.uniform(0.35, 0.5), 0.5 * (1 + inner)
        count = min(4, int(span * middle / (5 * radius)))
        for k in range(count):
            angle = span * (k + 0.5) / count
            polygon = polygon.difference(disc(radius, middle * np.cos(angle), middle * np.sin(angle)))
    return polygon


def bracket(rng: np.random.Generator) -> shapely.Polygon:
    """An L, T, U, Z, I or cross of flat bars with fillets, sometimes with a bolt hole in each leg's end."""
    t = rng.uniform(0.3, 0.5)
    w, h = 2.0, rng.uniform(1.4, 2.2)
    left, right = 0.5 * (w - t), 0.5 * (w + t)  # of a bar in the middle
    low, high = 0.5 * (h - t), 0.5 * (h + t)
    bars: dict[str, list[tuple[float, float, float, float]]] = {
        "L": [(0, 0, w, t), (0, 0, t, h)],
        "T": [(0, h - t, w, h), (left, 0, right, h)],
        "U": [(0, 0, w, t), (0, 0, t, h), (w - t, 0, w, h)],
        "Z": [(0, 0, right, t), (left, 0, right, h), (left, h - t, w, h)],
        "I": [(0, 0, w, t), (left, 0, right, h), (0, h - t, w, h)],
        "+": [(left, 0, right, h), (0, low, w, high)],
    }
    # Where bolts go: half a bar's width and a little in from the legs' ends.
    d = 0.6 * t
    bolts: dict[str, list[tuple[float, float]]] = {
        "L": [(w - d, t / 2), (t / 2, h - d)],
        "T": [(d, h - t / 2), (w - d, h - t / 2), (w / 2, d)],
        "U": [(t / 2, h - d), (w - t / 2, h - d)],
        "Z": [(d, t / 2), (w - d, h - t / 2)],
        "I": [],
        "+": [(w / 2, d), (w / 2, h - d), (d, h / 2), (w - d, h / 2)],
    }
    letter = str(rng.choice(list(bars)))
    polygon = shapely.union_all([shapely.box(*bar) for bar in bars[letter]])
    fillet = t * rng.uniform(0.3, 0.6)
    polygon = polygon.buffer(fillet, join_style="mitre").buffer(-fillet, quad_segs=QUARTER)  # inner corners
    if rng.random() < 0.4:
        polygon = polygon.buffer(-0.3 * t, join_style="mitre").buffer(0.3 * t, quad_segs=QUARTER)  # outer corners
    if rng.random() < 0.35:
        radius = t * rng.uniform(0.2, 0.25)
        polygon = polygon.difference(shapely.union_all([disc(radius, x, y) for x, y in bolts[letter]]))
    return polygon


def flange(rng: np.random.Generator) -> shapely.Polygon:
    """A round or an eared flange, with a bore, or with a bolt circle."""
    bolts = int(rng.integers(3, 7))
    angles = 2 * np.pi * np.arange(bolts) / bolts
    polygon = disc(1.0)
    if rng.random() < 0.6:
        ears = [disc(0.22, x, y) for x, y in polar(np.full(bolts, 0.98), angles)]
        polygon = rounded(shapely.union_all([disc(0.85), *ears]), 0.08)
    choice = int(rng.integers(3))
    if choice > 0:
        polygon = polygon.difference(disc(rng.uniform(0.3, 0.5)))
    if choice > 1:
        for x, y in polar(np.full(bolts, 0.8), angles):
            polygon = polygon.difference(disc(rng.uniform(0.09, 0.12), x, y))
    return polygon


def link(rng: np.random.Generator) -> shapely.Polygon:
    """A connecting rod: two eyes, solid or bored, and a waist between them, or the hull of both: a cam."""
    big, small, length = rng.uniform(0.4, 0.55), rng.uniform(0.22, 0.4), rng.uniform(1.4, 2.2)
    eyes = shapely.union_all([disc(big), disc(small, length)])
    if rng.random() < 0.4:
        polygon = eyes.convex_hull
    else:
        waist = small * rng.uniform(0.5, 0.8)
        polygon = rounded(eyes.union(shapely.box(0.0, -waist, length, waist)), 0.12)
    if rng.random() < 0.35:
        bore = rng.uniform(0.4, 0.6)
        polygon = polygon.difference(disc(bore * big)).difference(disc(bore * small, length))
    return polygon


def shaft(rng: np.random.Generator) -> shapely.Polygon:
    """A stepped shaft of 3 to 6 lengths of other diameters, its ends cut square or chamfered."""
    steps = int(rng.integers(3, 7))
    lengths = rng.uniform(0.3, 0.8, steps)
    radii = rng.uniform(0.18, 0.5, steps)
    x = np.concatenate([[0.0], np.cumsum(lengths)])
    polygon = shapely.union_all([shapely.box(a, -r, b, r) for a, b, r in zip(x[:-1], x[1:], radii, strict=True)])
    if rng.random() < 0.5:
        for end, radius, inwards in ((x[0], radii[0], 1.0), (x[-1], radii[-1], -1.0)):
            cut = 0.3 * radius
            for side in (-1.0, 1.0):
                y = side * radius
                chamfer = [(end, y), (end + inwards * cut, y), (end, y - side * cut)]
                polygon = polygon.difference(shapely.Polygon(chamfer))
    return polygon


def disc(radius: float, x: float = 0.0, y: float = 0.0) -> shapely.Polygon:
    """A round disc."""
    return shapely.Point(x, y).buffer(radius, quad_segs=QUARTER)


def regular(sides: int) -> shapely.Polygon:
    """A regular polygon in the unit circle."""
    return shapely.Polygon(polar(np.ones(sides), 2 * np.pi * np.arange(sides) / sides))


def polar(radii: Floats, angles: Floats) -> Floats:
    """Points of polar coordinates (m,), radians, as (m, 2)."""
    return radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def rounded(polygon: shapely.Polygon, radius: float) -> shapely.Polygon:
    """The polygon with all its corners, inner and outer, turned into arcs."""
    return (
        polygon.buffer(-radius, quad_segs=QUARTER)
        .buffer(2 * radius, quad_segs=QUARTER)
        .buffer(-radius, quad_segs=QUARTER)
    )


def framed(rng: np.random.Generator, width: float, height: float) -> shapely.Polygon:
    """A rectangle from the origin, its corners sharp, rounded or cut."""
    box, size = shapely.box(0.0, 0.0, width, height), 0.18 * min(width, height)
    choice = int(rng.integers(3))
    if choice == 0:
        return box
    join = "round" if choice == 1 else "bevel"
    return box.buffer(-size, join_style="mitre").buffer(size, quad_segs=QUARTER, join_style=join)


FAMILIES: tuple[Family, ...] = (star, comb, gear, spiral, panel, wedge, bracket, flange, link, shaft)
