"""A mesh with lines, open along them for the finish, which leaves all boundary alone, and closed again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from envs.mesh import Mesh, sides
from envs.types import Ints
from freemesh_ray.mesh_geometry.opening import opened


@dataclass(frozen=True)
class Cut:
    """A mesh that was opened along lines.

    Attributes:
        mesh: the vertices that stay first, then the copies of those on lines, then the others.
        kept: how many vertices stay.
        copied: (c,) int64, the vertices that there are copies of, in the copies' order.
    """

    mesh: Mesh
    kept: int
    copied: Ints


def given_vertices(mesh: Mesh, held: Ints) -> int:
    """How many vertices come first, up to the last one that stays where it is."""
    return int(max(mesh.segments.max(), held.max(initial=0))) + 1


def open_along(mesh: Mesh, lines: Ints, held: Ints) -> Cut:
    """Open a mesh along lines.

    Args:
        mesh: without defects.
        lines: (l, 2) int64, edges between two elements.
        held: (h,) int64, other vertices that stay.
    """
    n, kept = len(mesh.vertices), max(given_vertices(mesh, held), int(lines.max()) + 1)
    opening = opened(mesh.quads, n, lines)
    copied = opening.origin[n:]
    place = np.concatenate([np.arange(kept), len(copied) + np.arange(kept, n), kept + np.arange(len(copied))])
    quads = place[opening.quads]
    vertices = np.concatenate([mesh.vertices[:kept], mesh.vertices[copied], mesh.vertices[kept:]])
    ends = sides(quads).reshape(-1, 2)
    before = sides(mesh.quads).reshape(-1, 2)
    # Segments, in their order, by the elements that have them; then both sides of the lines.
    boundary = np.flatnonzero(np.isin(before @ [n, 1], mesh.segments @ [n, 1]))
    order = np.argsort(mesh.segments @ [n, 1])
    found = boundary[np.argsort((before @ [n, 1])[boundary])]
    segments = np.empty_like(mesh.segments)
    segments[order] = ends[found]
    on_line = np.isin(np.sort(before, axis=1) @ [n, 1], np.sort(lines, axis=1) @ [n, 1])
    cut = replace(mesh, vertices=vertices, quads=quads, segments=np.concatenate([segments, ends[on_line]]))
    return Cut(cut, kept, copied)


def closed(mesh: Mesh, cut: Cut, before: Mesh) -> Mesh:
    """The finished mesh of a cut, closed again; ``before`` is the mesh that was opened."""
    kept, copies = cut.kept, len(cut.copied)
    others = np.arange(kept, len(mesh.vertices) - copies)
    place = np.concatenate([np.arange(kept), cut.copied, others])
    vertices = np.concatenate([mesh.vertices[:kept], mesh.vertices[kept + copies :]])
    return replace(before, vertices=vertices, quads=place[mesh.quads])
