"""Meshes of regions that share boundary as one conforming mesh, with a set for each region and each interface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from envs.mesh import Groups, Mesh
from envs.types import Floats, Ints


@dataclass(frozen=True, eq=False)
class Part:
    """The mesh of one region.

    Attributes:
        mesh: of it alone.
        name: of the region; empty: none.
        sides: (k, 2) int64 boundary segments of each name.
    """

    mesh: Mesh
    name: str = ""
    sides: Mapping[str, Ints] = field(default_factory=dict)


def assembled(parts: Sequence[Part], name: str) -> Mesh:
    """One mesh of all parts: points that are equal number for number are one vertex.

    What two parts share is no boundary any more: it is a line inside, called by the name that it had as a side, or by
    the regions' names, ``steel_copper``. Vertices keep the order in which parts first have them.

    Args:
        parts: each complete or not.
        name: the mesh's.
    """
    vertices, number = merged(parts)
    quads = np.concatenate([ids[part.mesh.quads] for part, ids in zip(parts, number, strict=True)])
    segments = np.concatenate([ids[part.mesh.segments] for part, ids in zip(parts, number, strict=True)])
    part_of = np.repeat(np.arange(len(parts)), [len(part.mesh.segments) for part in parts])
    shared = partners(segments)
    regions = region_names([part.name for part in parts])
    called = np.concatenate([names_of(part) for part in parts])
    sides: dict[str, list[Ints]] = {}
    lines: dict[str, list[Ints]] = {}
    for i, (segment, partner) in enumerate(zip(segments, shared.tolist(), strict=True)):
        if partner < 0:
            if called[i]:
                sides.setdefault(called[i], []).append(segment)
        elif i < partner:
            between = f"{regions[part_of[i]]}_{regions[part_of[partner]]}"
            lines.setdefault(called[i] or called[partner] or between, []).append(segment)
    counts = np.cumsum([0, *(len(part.mesh.quads) for part in parts)])
    elements: dict[str, list[Ints]] = {}
    if len(parts) > 1 or parts[0].name:
        for region, low, high in zip(regions, counts[:-1], counts[1:], strict=True):
            elements.setdefault(region, []).append(np.arange(low, high))
    return Mesh(
        name,
        vertices,
        quads,
        segments[shared < 0],
        all(part.mesh.complete for part in parts),
        groups=Groups(
            sides={key: np.array(rows) for key, rows in sides.items()},
            lines={key: np.array(rows) for key, rows in lines.items()},
            regions={key: np.concatenate(rows) for key, rows in elements.items()},
        ),
    )


def merged(parts: Sequence[Part]) -> tuple[Floats, list[Ints]]:
    """The vertices of all parts, boundary points that are equal once, and for each part its vertices' numbers."""
    known: dict[tuple[float, float], int] = {}
    vertices: list[Floats] = []
    count = 0
    numbers = []
    for part in parts:
        on_boundary = np.flatnonzero(part.mesh.on_boundary)
        ids = np.full(len(part.mesh.vertices), -1)
        places = [tuple(point) for point in part.mesh.vertices[on_boundary].tolist()]
        ids[on_boundary] = [known.get(point, -1) for point in places]
        new = np.flatnonzero(ids < 0)
        ids[new] = count + np.arange(len(new))
        vertices.append(part.mesh.vertices[new])
        count += len(new)
        for point, vertex in zip(places, ids[on_boundary].tolist(), strict=True):
            known.setdefault(point, vertex)
        numbers.append(ids)
    return np.concatenate(vertices), numbers


def partners(segments: Ints) -> Ints:
    """(s,) int64: for each directed segment the one that runs the other way, -1 where there is none."""
    where = {(a, b): i for i, (a, b) in enumerate(segments.tolist())}
    return np.array([where.get((b, a), -1) for a, b in segments.tolist()], dtype=np.int64)


def region_names(given: Sequence[str]) -> list[str]:
    """A name for each region: its own, or its number."""
    return [name or f"region_{i}" for i, name in enumerate(given, 1)]


def names_of(part: Part) -> np.ndarray:
    """(s,) object: the name of each boundary segment of a part; empty: none."""
    named = {tuple(segment): name for name, rows in part.sides.items() for segment in rows.tolist()}
    return np.array([named.get(tuple(segment), "") for segment in part.mesh.segments.tolist()], dtype=object)
