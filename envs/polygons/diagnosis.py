"""Everything that is wrong with rings as they were given, each with its place and the fix.

The checks of `validation` end with the first thing that is wrong; here they all are found, for a picture.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from envs.polygons.overlaps import gaps_between
from envs.polygons.rings import extent, pairs_of
from envs.types import RELATIVE_TOLERANCE, Floats

#: A corner of less than this (degrees) is a spike.
SPIKE = 5.0

#: Polygons that are apart by less than this share of the extent were to touch.
SLIT = 1e-3

#: Of each kind so many are told at most.
MOST = 200


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong.

    Attributes:
        kind: ``crossing``, ``repeated point``, ``spike``, ``overlap``, ``gap``, ``too coarse``, ``outline``.
        x, y: where.
        told: what it is, in words.
        fix: what helps.
        lines: (k, 2, 2) float64, segments to show with it.
    """

    kind: str
    x: float
    y: float
    told: str
    fix: str
    lines: Floats

    @property
    def place(self) -> str:
        """``(x, y)``, to six digits of the larger."""
        most = max(abs(self.x), abs(self.y), 1e-300)
        return f"({', '.join(f'{0.0 if abs(value) < 1e-9 * most else value:.6g}' for value in (self.x, self.y))})"


def readable(polygons: Sequence[Sequence[Any]]) -> list[list[Floats]]:
    """The rings that are pairs of finite numbers, without the closing point, for each polygon."""
    found = []
    for rings in polygons:
        kept = []
        for ring in rings:
            try:
                points = np.asarray(ring, dtype=np.float64)
            except (TypeError, ValueError, OverflowError):
                continue
            if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
                continue
            points = points[np.isfinite(points).all(axis=1)]
            if len(points) > 2 and np.array_equal(points[0], points[-1]):
                points = points[:-1]
            if len(points) > 1:
                kept.append(points)
        found.append(kept)
    return found


def problems(polygons: Sequence[Sequence[Floats]]) -> list[Problem]:
    """What is wrong with rings, by kind, at most ``MOST`` of each.

    Args:
        polygons: see `readable`.
    """
    rings = [ring for polygon in polygons for ring in polygon]
    if not rings:
        return []
    size = extent(np.concatenate(rings))
    near = RELATIVE_TOLERANCE * size
    found: list[Problem] = []
    for kind in (repeated, spikes):
        some = [problem for ring in rings for problem in kind(ring, near)]
        found += some[:MOST]
    crossed = [list(crossings(polygon, near)) for polygon in polygons]
    found += [problem for some in crossed for problem in some][:MOST]
    sound = [p for p, polygon in enumerate(polygons) if polygon and not crossed[p] and len(polygon[0]) > 2]
    return found + list(between(polygons, sound, SLIT * size))[:MOST]


def at(point: Floats) -> tuple[float, float]:
    """The coordinates of a (2,) point."""
    x, y = point.tolist()
    return x, y


def repeated(ring: Floats, near: float) -> Iterator[Problem]:
    """Vertices that are where the one before is."""
    after = np.roll(ring, -1, axis=0)
    for i in np.flatnonzero(np.linalg.norm(after - ring, axis=1) <= near).tolist():
        j = (i + 1) % len(ring)
        yield Problem("repeated point", *at(ring[i]), f"vertex {j} repeats vertex {i}", "remove one of the two",
                      np.zeros((0, 2, 2)))  # fmt: skip


def spikes(ring: Floats, near: float) -> Iterator[Problem]:
    """Corners of less than ``SPIKE`` degrees, on whichever side."""
    kept = ring[np.linalg.norm(np.roll(ring, 1, axis=0) - ring, axis=1) > near]
    if len(kept) < 3:
        return
    back, ahead = np.roll(kept, 1, axis=0) - kept, np.roll(kept, -1, axis=0) - kept
    turn = np.arctan2(back[:, 0] * ahead[:, 1] - back[:, 1] * ahead[:, 0], (back * ahead).sum(axis=1))
    angle = np.degrees(np.abs(turn))
    for i in np.flatnonzero(angle < SPIKE).tolist():
        yield Problem(
            "spike", *at(kept[i]), f"a corner of {angle[i]:.2g} degrees", "remove the vertex at its tip",
            np.stack([np.stack([kept[i], kept[i] + way[i]]) for way in (back, ahead)]),
        )  # fmt: skip


def crossings(rings: Sequence[Floats], near: float) -> Iterator[Problem]:
    """Segments of one polygon that meet anywhere but at their common end; spikes fold back, and are told as such."""
    if not rings:
        return
    ends = np.concatenate([np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings])
    ends = ends[np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > near]
    sides = shapely.linestrings(ends)
    count, shown = 0, set[tuple[float, float]]()
    for i, j in pairs_of(shapely.STRtree(sides), sides, "dwithin", near):
        i, j = i[i < j], j[i < j]
        common = (np.linalg.norm(ends[i][:, :, None] - ends[j][:, None, :], axis=-1) <= near).any(axis=(1, 2))
        for a, b in zip(i[~common].tolist(), j[~common].tolist(), strict=True):
            x, y = shapely.get_coordinates(shapely.shortest_line(sides[a], sides[b]))[0].tolist()
            spot = (round(x / (1e3 * near)), round(y / (1e3 * near))) if near else (x, y)
            if spot in shown:
                continue
            shown.add(spot)
            yield Problem("crossing", x, y, "two segments cross, or touch", "move a vertex so that they do not meet",
                          ends[[a, b]])  # fmt: skip
            count += 1
            if count == MOST:
                return
    yield from pinches(rings, near)


def pinches(rings: Sequence[Floats], near: float) -> Iterator[Problem]:
    """Vertices of one place that are no neighbours: where rings touch, or one touches itself, unless it walks seams."""
    points = np.concatenate(rings)
    ring_of = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    places = shapely.points(points)
    walked = [np.concatenate([ring, np.roll(ring, -1, axis=0)], axis=1).tolist() for ring in rings]
    edges = {(x, y, u, v) for ring in walked for x, y, u, v in ring}
    seams = {(x, y) for x, y, u, v in edges if (u, v, x, y) in edges}
    for i, j in pairs_of(shapely.STRtree(places), places, "dwithin", near):
        for a, b in zip(i.tolist(), j.tolist(), strict=True):
            neighbours = ring_of[a] == ring_of[b] and (abs(a - b) == 1 or abs(a - b) == len(rings[ring_of[a]]) - 1)
            if a < b and not neighbours and tuple(points[a].tolist()) not in seams:
                yield Problem("crossing", *at(points[a]), "the boundary touches itself in a vertex",
                              "move one of the two vertices", np.zeros((0, 2, 2)))  # fmt: skip


def between(polygons: Sequence[Sequence[Floats]], sound: Sequence[int], slit: float) -> Iterator[Problem]:
    """Overlaps of polygons, and slits between neighbours; by those that do not cross themselves."""
    solid = [shapely.make_valid(shapely.Polygon(polygons[p][0], [h for h in polygons[p][1:] if len(h) > 2]))
             for p in sound]  # fmt: skip
    if len(solid) < 2:
        return
    near = 1e-6 * slit
    for i, j in pairs_of(shapely.STRtree(solid), np.array(solid, dtype=object), "intersects"):
        for a, b in zip(i.tolist(), j.tolist(), strict=True):
            if a >= b:
                continue
            parts = [part for part in shapely.get_parts(shapely.intersection(solid[a], solid[b]))
                     if 2.0 * part.area > max(near, 1e-9 * slit) * part.length]  # fmt: skip
            for part in sorted(parts, key=lambda one: -one.area)[:1]:
                x, y = part.point_on_surface().coords[0]
                ring = np.asarray(part.exterior.coords)
                told = f"polygons {sound[a]} and {sound[b]} overlap, by an area of {part.area:.4g}"
                around = np.stack([ring[:-1], ring[1:]], axis=1)
                yield Problem("overlap", x, y, told, "cut it off one of the two", around)
    for gap in gaps_between([polygons[p] for p in sound], slit):
        told = f"a slit of {gap.width:.3g} between polygons {sound[gap.first]} and {sound[gap.second]}"
        yield Problem("gap", gap.x, gap.y, told, "move one of the two so that they touch", np.zeros((0, 2, 2)))
