"""Several meshes as one: where they have boundary vertices that are equal number for number, they are joined."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from envs.mesh import CurvedEdges, Groups, Mesh
from envs.types import Curve, Ints


@dataclass(frozen=True)
class Union:
    """Meshes joined.

    Attributes:
        mesh: the vertices and elements of the first mesh, then those of the others. Segments that two meshes have are
            none any more; the sides named on them are lines.
        seams: (k, 2) int64, edges between two of the meshes, each once.
        first: for each mesh the number of its first element, and then how many there are.
        vertices: for each mesh the number of each of its vertices.
    """

    mesh: Mesh
    seams: Ints
    first: list[int]
    vertices: list[Ints]


def union(meshes: Sequence[Mesh], name: str) -> Union:
    """Join meshes whose domains share stretches of their boundaries, with common points there.

    Args:
        meshes: one or more, without defects; none overlaps another.
        name: of the mesh.
    """
    points = np.concatenate([mesh.vertices for mesh in meshes])
    start = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    stands = np.arange(len(points))
    rims = [np.unique(mesh.segments) + a for mesh, a in zip(meshes, start[:-1], strict=True)]
    rim = np.concatenate(rims)
    at = points[rim] + 0.0
    _, first, which = np.unique(at[:, 0] + 1j * at[:, 1], return_index=True, return_inverse=True)
    stands[rim] = rim[first[which.ravel()]]
    kept = stands == np.arange(len(points))
    number = (np.cumsum(kept) - 1)[stands]
    vertices = [number[a:b] for a, b in zip(start[:-1], start[1:], strict=True)]
    elements = [mine[mesh.quads] for mesh, mine in zip(meshes, vertices, strict=True)]
    segments = np.concatenate([mine[mesh.segments] for mesh, mine in zip(meshes, vertices, strict=True)])
    count = int(kept.sum())
    shared = np.isin(segments @ [count, 1], segments[:, ::-1] @ [count, 1])
    counts = [len(quads) for quads in elements]
    offsets = np.cumsum([0, *counts]).tolist()
    seams = np.unique(np.sort(segments[shared], axis=1), axis=0)
    joined = Mesh(
        name=name,
        vertices=points[kept],
        quads=np.concatenate(elements),
        segments=segments[~shared],
        complete=all(mesh.complete for mesh in meshes),
        groups=_groups(meshes, vertices, offsets, set(map(tuple, segments[shared].tolist()))),
        curved=_curved(meshes, vertices),
    )
    return Union(joined, seams, offsets, vertices)


def _gathered(parts: Sequence[Mapping[str, Ints]], renumbered: Callable[[int, Ints], Ints]) -> dict[str, Ints]:
    """The groups of one kind, those of one name as one."""
    found: dict[str, list[Ints]] = {}
    for i, groups in enumerate(parts):
        for name, members in groups.items():
            found.setdefault(name, []).append(renumbered(i, members))
    return {name: np.concatenate(each) for name, each in found.items()}


def _groups(meshes: Sequence[Mesh], vertices: list[Ints], offsets: list[int], shared: set[tuple[int, int]]) -> Groups:
    """The parts that have names."""

    def of_vertices(i: int, members: Ints) -> Ints:
        return vertices[i][members]

    sides = _gathered([mesh.groups.sides for mesh in meshes], of_vertices)
    lines = _gathered([mesh.groups.lines for mesh in meshes], of_vertices)
    for name, members in list(sides.items()):
        inside = np.array([edge in shared for edge in map(tuple, members.tolist())], dtype=np.bool_)
        if inside.any():
            lines[name] = np.concatenate([lines.get(name, members[:0]), members[inside]])
            sides[name] = members[~inside]
    points: dict[str, int] = {}
    for mesh, mine in zip(meshes, vertices, strict=True):
        points |= {name: int(mine[vertex]) for name, vertex in mesh.groups.points.items()}
    return Groups(
        sides={name: members for name, members in sides.items() if len(members)},
        lines={name: members[first_of_each(members)] for name, members in lines.items()},
        regions=_gathered([mesh.groups.regions for mesh in meshes], lambda i, members: members + offsets[i]),
        points=points,
    )


def first_of_each(edges: Ints) -> Ints:
    """Where each edge is met for the first time, in either direction."""
    _, first = np.unique(np.sort(edges, axis=1) @ [int(edges.max(initial=0)) + 1, 1], return_index=True)
    return np.sort(first)


def _curved(meshes: Sequence[Mesh], vertices: list[Ints]) -> CurvedEdges:
    """The edges on curves; one between two meshes once."""
    edges, curve_of = [np.zeros((0, 2), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    curves: list[Curve] = []
    for mesh, mine in zip(meshes, vertices, strict=True):
        edges.append(mine[mesh.curved.edges])
        curve_of.append(mesh.curved.curve_of + len(curves))
        curves += mesh.curved.curves
    every = np.concatenate(edges)
    first = first_of_each(every)
    return CurvedEdges(every[first], np.concatenate(curve_of)[first], tuple(curves))
