"""Families of random outlines: each draws a closed polyline, (m, 2), of about unit size from a generator.

``spikiness`` in [0, 1] runs from convex or smooth to sharp and deeply notched; ``detail`` >= 2 bounds the number of
features, so that the vertices wanted can follow them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely
from shapely import affinity

from envs.polygons.outline import spline
from envs.types import Floats

Family = Callable[[np.random.Generator, float, int], Floats]


def blob(rng: np.random.Generator, spikiness: float, detail: int) -> Floats:
    """A smooth star-shaped outline: the logarithm of the radius is a short Fourier series."""
    theta = np.linspace(0.0, 2 * np.pi, 720, endpoint=False)
    orders = np.arange(1, 2 + min(detail, 7))
    size = 0.75 * spikiness * rng.uniform(0.3, 1.0, len(orders)) / np.sqrt(orders)
    phase = rng.uniform(0.0, 2 * np.pi, len(orders))
    radius = np.exp(0.5 * (size[:, None] * np.cos(orders[:, None] * theta + phase[:, None])).sum(axis=0))
    return radius[:, None] * np.stack([np.cos(theta), rng.uniform(0.5, 1.0) * np.sin(theta)], axis=1)


def burst(rng: np.random.Generator, spikiness: float, detail: int) -> Floats:
    """Spikes round a centre: tips are corners, valleys are corners or smooth, sides straight or curved."""
    spikes = int(rng.integers(3, 4 + min(detail, 9)))
    step = 2 * np.pi / spikes
    tips = step * (np.arange(spikes) + rng.uniform(-0.2, 0.2, spikes))
    valleys = 0.5 * (tips + np.append(tips[1:], tips[0] + 2 * np.pi)) + step * rng.uniform(-0.12, 0.12, spikes)
    # A convex polygon's valleys are the middles of its sides; the spikier, the deeper below them.
    depth = np.cos(0.5 * step) * (1.0 - spikiness * rng.uniform(0.35, 0.65, spikes))
    reach = rng.uniform(1.0 - 0.3 * spikiness, 1.0, spikes)
    corner = bool(rng.random() < 0.5)
    controls = []
    for k in range(spikes):
        controls.append((reach[k] * np.cos(tips[k]), reach[k] * np.sin(tips[k]), 1))
        controls.append((depth[k] * np.cos(valleys[k]), depth[k] * np.sin(valleys[k]), int(corner)))
    return spline(controls)


def convex(rng: np.random.Generator, spikiness: float, detail: int) -> Floats:
    """The hull of points on an ellipse, its corners kept: the fewer points, the sharper."""
    count = int(rng.integers(3, 5 + round((1.0 - spikiness) * min(detail + 2, 6))))
    angles = 2 * np.pi * (np.arange(count) + rng.uniform(0.0, 0.6, count)) / count
    across = rng.uniform(0.45, 1.0)
    return spline([(np.cos(a), across * np.sin(a), 1) for a in angles])


def plate(rng: np.random.Generator, spikiness: float, detail: int) -> Floats:
    """A union of rectangles, most of them aligned: a machined plate, its corners sharp or rounded."""
    pieces = []
    for _ in range(int(rng.integers(1, 2 + min(detail, 4)))):
        width, height = rng.uniform(0.5, 1.5), rng.uniform(0.3, 0.8)
        x, y = rng.uniform(-0.4, 0.4, 2)
        tilt = rng.choice([0.0, 90.0]) + (rng.uniform(-40.0, 40.0) if rng.random() < 0.5 * spikiness else 0.0)
        pieces.append(affinity.rotate(shapely.box(x - width / 2, y - height / 2, x + width / 2, y + height / 2), tilt))
    polygon = shapely.union_all(pieces)
    if rng.random() < 0.6 * (1.0 - spikiness):
        r = rng.uniform(0.05, 0.12)
        # Opened and closed by a disc: every corner becomes an arc.
        polygon = polygon.buffer(-r, quad_segs=24).buffer(2 * r, quad_segs=24).buffer(-r, quad_segs=24)
    return exterior(polygon)


def notched(rng: np.random.Generator, spikiness: float, detail: int) -> Floats:
    """A disc or a rectangle with wedges and slots cut in from outside."""
    height = rng.uniform(0.6, 1.0)
    disc = affinity.scale(shapely.Point(0.0, 0.0).buffer(1.0, quad_segs=90), 1.0, height)
    polygon = disc if rng.random() < 0.5 else shapely.box(-1.0, -height, 1.0, height)
    cuts = int(rng.integers(1, 2 + min(detail, 4)))
    for angle in 2 * np.pi * (np.arange(cuts) + rng.uniform(-0.2, 0.2, cuts)) / cuts:
        depth = height * rng.uniform(0.3, 0.4 + 0.4 * spikiness)
        mouth = rng.uniform(0.25, 0.45) * (1.3 - 0.6 * spikiness)
        floor = mouth * rng.uniform(0.0, 1.0) * (rng.random() < 0.5)
        wedge = shapely.Polygon(
            [(1.6, -1.6 * mouth), (1.6, 1.6 * mouth), (1.0 - depth, floor / 2), (1.0 - depth, -floor / 2)]
        )
        placed = affinity.rotate(wedge if wedge.is_valid else wedge.convex_hull, np.degrees(angle), origin=(0.0, 0.0))
        polygon = polygon.difference(affinity.scale(placed, 1.0, height, origin=(0.0, 0.0)))
    return exterior(polygon)


def strip(rng: np.random.Generator, spikiness: float, detail: int) -> Floats:
    """A bent strip of varying width: an arc, a hook or an S; its ends are cut square or, when spiky, pointed."""
    t = np.linspace(0.0, 1.0, 400)
    turn = rng.uniform(0.5, 1.5) * np.pi * rng.choice([-1.0, 1.0])
    other = turn * rng.choice([1.0, -1.0, 0.2])
    heading = turn * t + 0.5 * (other - turn) * t**2
    along = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    line = np.concatenate([[[0.0, 0.0]], np.cumsum(0.5 * (along[1:] + along[:-1]), axis=0) / (len(t) - 1)])
    width = rng.uniform(0.06, 0.13) * (
        1.0 + 0.45 * spikiness * np.sin(2 * np.pi * rng.integers(1, 3) * t + rng.uniform(0, 6))
    )
    if rng.random() < spikiness:
        width = width * np.minimum(1.0, (1.0 - t) / rng.uniform(0.2, 0.5))
    across = width[:, None] * np.stack([-along[:, 1], along[:, 0]], axis=1)
    ends = 2.0 * np.concatenate([line - across, (line + across)[::-1]])
    return exterior(shapely.Polygon(ends))


def chain(rng: np.random.Generator, spikiness: float, detail: int) -> Floats:
    """Discs and regular polygons in a row, joined by bars: the spikier, the narrower these bottlenecks."""
    links = int(rng.integers(2, 3 + min(detail // 2, 3)))
    heading = np.cumsum(rng.uniform(-0.8, 0.8, links))
    centres = np.cumsum(
        rng.uniform(0.8, 1.2, links)[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0
    )
    radii = rng.uniform(0.3, 0.5, links)
    pieces = []
    for centre, radius in zip(centres, radii, strict=True):
        sides = int(rng.integers(3, 7)) if rng.random() < 0.2 + 0.5 * spikiness else 120
        angles = 2 * np.pi * (np.arange(sides) + rng.random()) / sides
        pieces.append(shapely.Polygon(centre + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)))
    bar = float(radii.min()) * (0.65 - 0.4 * spikiness) * rng.uniform(0.7, 1.0)
    pieces.append(shapely.LineString(centres).buffer(bar, cap_style="flat", join_style="mitre"))
    return exterior(shapely.union_all(pieces))


def exterior(geometry: shapely.Geometry) -> Floats:
    """The outer ring of the largest polygon of a geometry as a fine counter-clockwise polyline, (m, 2).

    A ring that crosses itself has no such outline; it comes back as it is, and the domain's checks refuse it.
    """
    largest = max(getattr(geometry, "geoms", [geometry]), key=lambda polygon: polygon.area)
    ring = shapely.get_coordinates(shapely.orient_polygons(largest).exterior)[:-1]
    gaps = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
    ring = ring[gaps > 1e-7]
    ahead = np.roll(ring, -1, axis=0)
    t = np.arange(16) / 16
    return (ring[:, None] * (1.0 - t)[:, None] + ahead[:, None] * t[:, None]).reshape(-1, 2)


FAMILIES: tuple[Family, ...] = (blob, burst, convex, plate, notched, strip, chain)
