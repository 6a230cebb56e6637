"""Cracks: lines of a mesh whose two sides are apart, with nodes of their own that lie upon each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from envs.mesh import CurvedEdges, Groups, Mesh, sides
from envs.types import DomainError, Ints
from freemesh_ray.mesh_geometry.opening import opened

#: What the names of a crack's sides end in: left and right as seen along it.
LEFT, RIGHT = "_left", "_right"


def cracked(mesh: Mesh, cracks: Mapping[str, Ints]) -> Mesh:
    """A mesh that is open along cracks.

    A crack's nodes come twice, those where cracks cross or branch once for each part around; at a tip inside there is
    one. The copies come after all other vertices. Elements stay in their order.

    Args:
        mesh: complete; its lines, sides and points keep their names.
        cracks: by name, (k, 2) int64 edges inside, in the crack's direction.

    Returns:
        The mesh, its new boundary segments at the end; of each crack ``NAME_left`` and ``NAME_right`` are sides, and
        it is no line any more. Of a point on a crack that has several nodes the first one has the name.

    Raises:
        DomainError: an edge that cannot open, since both of its ends are tips.
    """
    edges = np.concatenate(list(cracks.values()))
    n = len(mesh.vertices)
    opening = opened(mesh.quads, n, edges)
    before, after = sides(mesh.quads).reshape(-1, 2), sides(opening.quads).reshape(-1, 2)
    keys = before @ [n, 1]
    on_both = np.isin(after @ [len(opening.origin), 1], after[:, ::-1] @ [len(opening.origin), 1])
    stuck = on_both & np.isin(np.sort(before, axis=1) @ [n, 1], np.sort(edges, axis=1) @ [n, 1])
    for a, b in before[stuck][:1]:
        x, y = mesh.vertices[[a, b]].mean(axis=0)
        raise DomainError(
            f"{mesh.name}: a crack at ({x:g}, {y:g}) has one edge, which cannot open between its tips; use a smaller "
            "edge length"
        )
    order = np.argsort(keys)

    def renumbered(wanted: Ints) -> Ints:
        """Edges as the element on their left has them, or where there is none the one on their right."""
        at = np.minimum(np.searchsorted(keys[order], wanted @ [n, 1]), len(keys) - 1)
        back = np.minimum(np.searchsorted(keys[order], wanted[:, ::-1] @ [n, 1]), len(keys) - 1)
        on_left = keys[order[at]] == wanted @ [n, 1]
        return np.where(on_left[:, None], after[order[at]], after[order[back]][:, ::-1])

    named = {name + LEFT: renumbered(line) for name, line in cracks.items()}
    named |= {name + RIGHT: renumbered(line[:, ::-1]) for name, line in cracks.items()}
    groups = Groups(
        sides={name: renumbered(members) for name, members in mesh.groups.sides.items()} | named,
        lines={name: renumbered(members) for name, members in mesh.groups.lines.items() if name not in cracks},
        regions=mesh.groups.regions,
        points=mesh.groups.points,
    )
    on_crack = np.isin(np.sort(mesh.curved.edges, axis=1) @ [n, 1], np.sort(edges, axis=1) @ [n, 1])
    curved = CurvedEdges(
        np.concatenate([renumbered(mesh.curved.edges), renumbered(mesh.curved.edges[on_crack, ::-1])]),
        np.concatenate([mesh.curved.curve_of, mesh.curved.curve_of[on_crack]]),
        mesh.curved.curves,
    )
    return replace(
        mesh,
        vertices=mesh.vertices[opening.origin],
        quads=opening.quads,
        segments=np.concatenate([renumbered(mesh.segments), *named.values()]),
        groups=groups,
        curved=curved,
    )
