"""Given boundaries with lines inside: lines get vertices as far apart as the boundary's, and totals are made even.

Where an edge length splits the boundary, it splits the lines in the same way, once polygons are divided by them:
`faces.divided`, `discretisation.discretised`, `slits.slit_domain`. Here the boundary's vertices are given; it gets
others only where a line ends on a segment, and one more where that makes a total odd.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from envs.polygons.cones import Cones
from envs.polygons.faces import Face, divided
from envs.polygons.linework import Linework, linework
from envs.polygons.outline import CORNER
from envs.polygons.parity import made_even
from envs.polygons.sizing import CURVATURE, SLOPE, Sizes
from envs.polygons.slits import slit_domain
from envs.polygons.turning import bends
from envs.types import Domain, DomainError, Floats

#: How much more it counts to split a segment of the boundary than one of a line, as the logarithm of a ratio.
GIVEN = 10.0

#: Samples of the size along a line: so many for each segment, at most.
SAMPLES, MOST_SAMPLES = 4, 100_000


def domains_with_lines(
    polygons: Sequence[Sequence[Floats]],
    lines: Sequence[Floats],
    places: Floats,
    name: str,
    source: str,
) -> list[Domain]:
    """The domains that lines divide polygons into, with the lines and places inside; see `slits.slit_domain`.

    Args:
        polygons: for each its valid rings, each (n, 2), the outer one first; their vertices are the boundary's.
        lines: each (k, 2), k >= 2; closed when its ends are equal. Corners stay, and where they meet others or sides.
        places: (m, 2), m >= 0, points that a node is to sit on.
        name: the domain's name; several are called ``name[0]``, ``name[1]``, ...
        source: what messages begin with.

    Raises:
        DomainError: lines that cannot be followed: the source, the place and the fix.
    """
    faces = faces_with_lines(polygons, lines, places, source)
    names = [name] if len(faces) == 1 else [f"{name}[{i}]" for i in range(len(faces))]
    return [slit_domain(called, face.rings, face.places, source) for called, face in zip(names, faces, strict=True)]


def faces_with_lines(
    polygons: Sequence[Sequence[Floats]], lines: Sequence[Floats], places: Floats, source: str
) -> list[Face]:
    """The faces that lines divide polygons into, the lines split, each of an even number of vertices.

    Args:
        polygons, lines, places, source: see `domains_with_lines`.

    Raises:
        DomainError: as of `domains_with_lines`.
    """
    size = boundary_size(polygons)
    drawing = linework(polygons, lines, places, source)
    split = [
        discretised_line(drawing.points[line], size, stays)
        for line, stays in zip(drawing.lines, _staying(drawing), strict=True)
    ]
    return even(divided(polygons, split, places, source), source)


def boundary_size(polygons: Sequence[Sequence[Floats]]) -> Cones:
    """The edge length wanted inside polygons by what their boundaries have: see `cones`."""
    rows = []
    for ring in (ring for rings in polygons for ring in rings):
        ahead = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
        rows.append(np.column_stack([ring, 0.5 * (ahead + np.roll(ahead, 1))]))
    return Cones(np.concatenate(rows), SLOPE)


def discretised_line(points: Floats, size: Cones, stays: np.ndarray | None = None) -> Floats:
    """A polyline with vertices as far apart as is wanted there; its ends and corners are exactly as given.

    Args:
        points: (k, 2) float64, k >= 2; closed when its ends are equal.
        size: the edge length wanted at places.
        stays: (k,) bool, further points that stay.

    Returns:
        (m, 2) float64, each stretch between points that stay in round(integral of ds / h) >= 1 pieces; a line that
        floats in two at least.
    """
    kept = np.zeros(len(points), dtype=np.bool_) if stays is None else stays.copy()
    kept[[0, -1]] = True
    kept[1:-1] |= np.abs(bends(points)) > CORNER
    bounds = np.flatnonzero(kept)
    parts = [_pieces(points[a : b + 1], size)[:-1] for a, b in zip(bounds[:-1], bounds[1:], strict=True)]
    vertices = np.concatenate([*parts, points[-1:]])
    if len(vertices) == 2 and not (stays is not None and stays[[0, -1]].any()):
        # A crack of a single edge could not open.
        return np.insert(vertices, 1, vertices.mean(axis=0), axis=0)
    return vertices


def _pieces(points: Floats, size: Cones) -> Floats:
    """(m, 2) vertices along a stretch of a line, its ends exactly as given."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    rough = size(points, np.full(len(points), np.inf)).min()
    at = np.union1d(along, np.linspace(0.0, along[-1], min(MOST_SAMPLES, 2 + int(SAMPLES * along[-1] / rough))))
    places = np.stack([np.interp(at, along, points[:, axis]) for axis in (0, 1)], axis=1)
    wanted = Sizes(at, size(places, np.full(len(at), np.inf)))
    closed = bool((points[0] == points[-1]).all())
    turn = float(np.abs(bends(points)).sum())
    # A closed line is a ring of three pieces at least.
    least = max(3 if closed else 1, int(np.ceil(turn * CURVATURE / (2.0 * np.pi) - 1e-9)))
    inner = wanted.split(max(least, round(wanted.measure)))
    middle = np.stack([np.interp(inner, along, points[:, axis]) for axis in (0, 1)], axis=1)
    return np.concatenate([points[:1], middle, points[-1:]])


def _staying(drawing: Linework) -> list[np.ndarray]:
    """For each line which of its points stay: those of a ring, of another line, of itself a second time, places."""
    visits = np.zeros(len(drawing.points), dtype=np.int64)
    for ring in (ring for polygon in drawing.rings for ring in polygon):
        visits[ring] += 2
    for line in drawing.lines:
        np.add.at(visits, line, 1)
    visits[drawing.places] += 2
    return [visits[line] > 1 for line in drawing.lines]


def even(faces: Sequence[Face], source: str) -> list[Face]:
    """Faces with an even number of vertices each: some edges get their middle as one more vertex, lines' first."""
    edges: dict[tuple[float, ...], list[int]] = {}
    for f, face in enumerate(faces):
        for ring in face.rings:
            for a, b in zip(ring.tolist(), np.roll(ring, -1, axis=0).tolist(), strict=True):
                edges.setdefault(tuple(min(a, b) + max(a, b)), []).append(f)
    keys, users = list(edges), list(edges.values())
    odd = [f for f, face in enumerate(faces) if sum(len(ring) for ring in face.rings) % 2]
    if not odd:
        return list(faces)
    ends = np.array(keys)
    length = np.linalg.norm(ends[:, 2:] - ends[:, :2], axis=1)
    costs = np.log(2.0 * length.max() / length) + GIVEN * np.array([len(use) == 1 for use in users])
    chosen = made_even(users, costs, odd)
    if chosen is None:
        raise DomainError(f"{source}: polygons that share all of their boundary with two others; remove copies of them")
    middles = {keys[i]: 0.5 * (ends[i, :2] + ends[i, 2:]) for i in chosen}
    return [replace(face, rings=[_with_middles(ring, middles) for ring in face.rings]) for face in faces]


def _with_middles(ring: Floats, middles: dict[tuple[float, ...], Floats]) -> Floats:
    """A ring with the middles of some of its edges as vertices."""
    at, new = [], []
    for i, (a, b) in enumerate(zip(ring.tolist(), np.roll(ring, -1, axis=0).tolist(), strict=True)):
        middle = middles.get(tuple(min(a, b) + max(a, b)))
        if middle is not None:
            at.append(i + 1)
            new.append(middle)
    return np.insert(ring, at, np.array(new).reshape(-1, 2), axis=0) if at else ring
