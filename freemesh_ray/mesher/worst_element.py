"""What a user is told of the worst element of a mesh: where it is, why, and what helps."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely

from envs.mesh import Mesh
from envs.quality import element_quality
from envs.types import RELATIVE_TOLERANCE, Floats, Ints
from freemesh_ray.mesher.coarse_outline import shown

#: An element of less quality is told.
BAD = 0.05

#: A corner of the outline of less than this (degrees) leaves no good element.
SHARP = 20.0

#: Where the outline is narrower than the longest segment there by this factor, that is the cause.
NARROW = 2.0


def worst_note(mesh: Mesh, known: str = "", but: np.ndarray | None = None) -> str:
    """A line on the worst element, if its quality is below ``BAD``: its place, the cause, and the fix; else empty.

    Args:
        mesh: finished.
        known: the fix, where it was told before.
        but: (m,) bool, elements that are thin on purpose, of boundary layers; None: none are.
    """
    if not len(mesh.quads):
        return ""
    eta = element_quality(mesh.vertices, mesh.quads)
    if but is not None:
        eta[but] = 1.0
    worst = int(eta.argmin())
    if not eta[worst] < BAD:
        return ""
    corners = mesh.vertices[mesh.quads[worst]]
    x, y = corners.mean(axis=0).tolist()
    told = f"the worst element, at {shown(x, y, diameter(mesh))}, has quality {eta[worst]:.3g}"
    return f"{told}: {known or cause(mesh, worst)}"


def cause(mesh: Mesh, element: int) -> str:
    """Why an element is bad, and the fix: a sharp corner, a narrow place, or segments that are too coarse."""
    angle = least_corner(mesh, element)
    if angle < SHARP:
        return f"a corner of the outline has {angle:.2g} degrees there; blunt it, or accept the element"
    near = near_segments(mesh, element)
    longest = float(lengths(mesh, near).max())
    width = narrowest(mesh, near)
    if width < longest / NARROW:
        return (
            f"the outline is {width:.3g} wide there, narrower than its segments of {longest:.3g}; give --edge-length "
            f"{width / 2:.2g}, or --grading for finer segments there alone"
        )
    return f"segments of up to {longest:.3g} are near; give a finer --edge-length there, {longest / 2:.2g} at most"


def diameter(mesh: Mesh) -> float:
    """Diagonal of the bounding box."""
    return float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))


def lengths(mesh: Mesh, segments: Ints) -> Floats:
    """(k,) of boundary segments by number."""
    ends = mesh.vertices[mesh.segments[segments]]
    return np.asarray(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))


def least_corner(mesh: Mesh, element: int) -> float:
    """The least inner angle, in degrees, of the boundary's at the element's own vertices; 360 where there is none."""
    found = 360.0
    follows: dict[int, list[int]] = {}
    for a, b in mesh.segments.tolist():
        follows.setdefault(a, []).append(b)
        follows.setdefault(b, []).append(a)
    for vertex in mesh.quads[element].tolist():
        ways = mesh.vertices[follows.get(vertex, [])] - mesh.vertices[vertex]
        turns = np.sort(np.arctan2(ways[:, 1], ways[:, 0]))
        touching = mesh.quads[(mesh.quads == vertex).any(axis=1)]
        # Of two segments that meet the sector with the elements in it is inside.
        for start, end in pairwise([*turns, turns[0] + 2.0 * np.pi] if len(turns) > 1 else []):
            to = mesh.vertices[touching].mean(axis=1) - mesh.vertices[vertex]
            if (np.mod(np.arctan2(to[:, 1], to[:, 0]) - start, 2.0 * np.pi) < end - start).any():
                found = min(found, float(np.degrees(end - start)))
    return found


def near_segments(mesh: Mesh, element: int) -> Ints:
    """Numbers of the boundary segments that are no further from an element than it is long; the nearest at least."""
    corners = mesh.vertices[mesh.quads[element]]
    sides = shapely.linestrings(mesh.vertices[mesh.segments])
    away = shapely.distance(sides, shapely.Polygon(corners))
    reach = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1).max()
    return np.flatnonzero(away <= max(reach, away.min()))


def narrowest(mesh: Mesh, segments: Ints) -> float:
    """The least distance, across elements, of two of the segments without a common end; infinite: there is none."""
    ends = mesh.vertices[mesh.segments[segments]]
    sides = shapely.linestrings(ends)
    i, j = np.triu_indices(len(segments), 1)
    given = mesh.segments[segments]
    apart = ~(given[i][:, :, None] == given[j][:, None, :]).any(axis=(1, 2))
    i, j = i[apart], j[apart]
    away = shapely.distance(sides[i], sides[j])
    order = np.argsort(away)[:200]
    middles = shapely.get_coordinates(shapely.shortest_line(sides[i[order]], sides[j[order]])).reshape(-1, 2, 2)
    near = mesh.quads[np.isin(mesh.quads, mesh.quads[np.isin(mesh.quads, given).any(axis=1)]).any(axis=1)]
    covered = shapely.union_all(shapely.polygons(mesh.vertices[near])) if len(near) else shapely.Polygon()
    middles, near_zero = middles.mean(axis=1), RELATIVE_TOLERANCE * diameter(mesh)
    # Between two neighbours of one segment the way leads along this, not across.
    off = shapely.distance(shapely.points(middles), shapely.multilinestrings(sides)) > near_zero
    across = shapely.contains_xy(covered, middles) & off & (away[order] > near_zero)
    return float(away[order][across].min(initial=np.inf))
