"""The meshes of a geometry's regions as one conforming mesh, with a set for each region, interface, line and point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from envs.mesh import STRAIGHT, CurvedEdges, Groups, Mesh
from envs.polygons.along import edges_along
from envs.polygons.drawing import Line, Place
from envs.types import Ints
from freemesh_ray.mesh_geometry.cracks import cracked
from freemesh_ray.mesh_geometry.union import Union, first_of_each, union


@dataclass(frozen=True, eq=False)
class Part:
    """The mesh of one region.

    Attributes:
        mesh: of it alone.
        name: of the region; empty: none.
        sides: (k, 2) int64 boundary segments of each name.
        curved: its edges that lie on curves.
    """

    mesh: Mesh
    name: str = ""
    sides: Mapping[str, Ints] = field(default_factory=dict)
    curved: CurvedEdges = STRAIGHT


def assembled(parts: Sequence[Part], name: str, inside: Sequence[Line] = (), places: Sequence[Place] = ()) -> Mesh:
    """One mesh of all parts: boundary points that are equal number for number are one vertex.

    What two parts share is no boundary any more: it is a line inside, called by the name that it had as a side, or by
    the regions' names, ``steel_copper``; where neither says anything it has none. Cracks are open.

    Args:
        parts: each complete or not.
        name: the mesh's.
        inside: lines that elements follow.
        places: points that vertices sit on.
    """
    names = [part.name or f"region_{i}" for i, part in enumerate(parts, 1)]
    named = len(parts) > 1 or bool(parts[0].name)
    whole = union(
        [
            replace(
                part.mesh,
                groups=Groups(
                    sides=dict(part.sides), regions={called: np.arange(len(part.mesh.quads))} if named else {}
                ),
                curved=part.curved,
            )
            for part, called in zip(parts, names, strict=True)
        ],
        name,
    )
    mesh = whole.mesh
    lines = dict(mesh.groups.lines) | between(whole, names, [part.name for part in parts])
    cracks: dict[str, Ints] = {}
    edges = mesh.edges[0]
    for i, line in enumerate(inside, 1):
        called = line.name or (f"crack_{i}" if line.crack else f"line_{i}")
        found = cracks if line.crack else lines
        along = edges_along(mesh.vertices, edges, line.points)
        both = np.concatenate([found[called], along]) if called in found else along
        found[called] = both[first_of_each(both)]
    taken = {tuple(edge) for rows in cracks.values() for edge in np.sort(rows, axis=1).tolist()}
    lines = {
        key: rows[[tuple(edge) not in taken for edge in np.sort(rows, axis=1).tolist()]] for key, rows in lines.items()
    }
    groups = replace(
        mesh.groups,
        lines={key: rows for key, rows in lines.items() if len(rows)},
        points=points_of(mesh, places),
    )
    mesh = replace(mesh, groups=groups)
    return cracked(mesh, cracks) if cracks else mesh


def between(whole: Union, names: Sequence[str], given: Sequence[str]) -> dict[str, Ints]:
    """The edges between regions that no side names, by the names of the two; none where neither has one of its own."""
    named = {tuple(edge) for rows in whole.mesh.groups.lines.values() for edge in np.sort(rows, axis=1).tolist()}
    free = [edge for edge in map(tuple, np.sort(whole.seams, axis=1).tolist()) if edge not in named]
    if not free or not any(given):
        return {}
    part_of = np.repeat(np.arange(len(names)), np.diff(whole.first))
    owners: dict[tuple[int, int], list[int]] = {edge: [] for edge in free}
    ends = np.sort(np.stack([whole.mesh.quads, np.roll(whole.mesh.quads, -1, axis=1)], axis=-1), axis=-1)
    for element, four in enumerate(ends.tolist()):
        for edge in map(tuple, four):
            if edge in owners:
                owners[edge].append(int(part_of[element]))
    found: dict[str, list[tuple[int, int]]] = {}
    for edge, two in owners.items():
        a, b = min(two), max(two)
        if names[a] != names[b]:
            found.setdefault(f"{names[a]}_{names[b]}", []).append(edge)
    return {called: np.array(rows, dtype=np.int64) for called, rows in found.items()}


def points_of(mesh: Mesh, places: Sequence[Place]) -> dict[str, int]:
    """The vertices of places, by name, or number where they have none."""
    found = {}
    for i, place in enumerate(places, 1):
        off = np.hypot(*(mesh.vertices - [place.x, place.y]).T)
        found[place.name or f"point_{i}"] = int(off.argmin())
    return found
