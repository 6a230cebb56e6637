"""Meshes to export: grids with holes, cracks and names, drawn at random or not, and blocks of hexahedra."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from hypothesis import strategies as st

from envs.mesh import Groups, Mesh, edges_of, sides
from envs.types import Floats, Ints

#: Names that some format cannot hold as they are, and that may come out alike.
NAMES = (
    "left",
    "Left",
    "left side",
    "left_side",
    "Größe 1",
    "1st",
    "a/b",
    "domain",
    "all",
    "x" * 90,
    "→",
    "boundary",
    "top",
)


def outline(quads: Ints) -> Ints:
    """(s, 2) int64: the sides that one element alone has, it on the left."""
    walked = sides(quads).reshape(-1, 2)
    back = {tuple(side) for side in walked[:, ::-1].tolist()}
    return np.array([side for side in walked.tolist() if tuple(side) not in back])


def grid(
    columns: int = 3, rows: int = 2, scale: float = 1.0, shift: float = 0.0, without: tuple[int, ...] = (), shake=0.2
) -> Mesh:
    """A distorted grid whose coordinates have no short decimals; elements left out make holes."""
    x, y = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0))
    vertices = np.column_stack([x.ravel(), y.ravel()])
    vertices = (vertices + np.random.default_rng(3).uniform(-shake, shake, vertices.shape)) * scale + shift
    i = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    quads = np.delete(np.column_stack([i, i + 1, i + columns + 2, i + columns + 1]), without, axis=0)
    return Mesh("grid", vertices, quads, outline(quads), True)


def holed() -> Mesh:
    """A grid with two holes, one element and three."""
    return grid(6, 6, without=(8, 20, 21, 22))


def split(mesh: Mesh, path: list[int], above: Ints) -> Mesh:
    """The mesh with a crack: the vertices inside a path come twice, the elements above it have the new ones."""
    inner = path[1:-1]
    new = {vertex: len(mesh.vertices) + i for i, vertex in enumerate(inner)}
    quads = mesh.quads.copy()
    quads[above] = np.vectorize(lambda vertex: new.get(vertex, vertex))(quads[above])
    return replace(
        mesh, vertices=np.concatenate([mesh.vertices, mesh.vertices[inner]]), quads=quads, segments=outline(quads)
    )


def cracked() -> Mesh:
    """A grid of 6 by 4 elements with a crack of four edges inside and its two sides named."""
    mesh = split(grid(6, 4), [15, 16, 17, 18, 19], np.arange(12, 24))
    upper, lower = (
        mesh.segments[np.isin(mesh.segments, within).any(axis=1)] for within in ([35, 36, 37], [16, 17, 18])
    )
    return replace(mesh, groups=Groups(sides={"crack_above": upper, "crack_below": lower}))


def named() -> Mesh:
    """A grid with two holes, two named sides, two regions and the line between them, and a named point."""
    mesh = grid(6, 6, without=(8, 20, 22), shake=0.0)
    middle, centre = mesh.vertices[mesh.segments].mean(axis=1), mesh.vertices[mesh.quads].mean(axis=1)
    edges, counts = mesh.edges
    inside = edges[counts == 2]
    groups = Groups(
        sides={"left side": mesh.segments[middle[:, 0] == 0.0], "right": mesh.segments[middle[:, 0] == 6.0]},
        lines={"seam": inside[(mesh.vertices[inside][..., 0] == 3.0).all(axis=1)]},
        regions={"steel": np.flatnonzero(centre[:, 0] < 3.0), "copper": np.flatnonzero(centre[:, 0] > 3.0)},
        points={"gauge": 40},
    )
    shaken = mesh.vertices + np.random.default_rng(5).uniform(-0.2, 0.2, mesh.vertices.shape)
    return replace(mesh, vertices=shaken, groups=groups)


@st.composite
def meshes(draw: st.DrawFn) -> Mesh:
    """Grids with holes, of any scale and place, with names of all kinds, or without."""
    columns, rows = draw(st.integers(1, 4)), draw(st.integers(1, 4))
    count = columns * rows
    without = draw(st.sets(st.integers(0, count - 1), max_size=min(3, count - 1)))
    mesh = grid(columns, rows, draw(st.floats(1e-6, 1e6)), draw(st.floats(-1e3, 1e3)), tuple(sorted(without)))
    edges, counts = edges_of(mesh.quads)
    used = np.unique(mesh.quads).tolist()

    def parts(things: np.ndarray) -> dict[str, Ints]:
        """Some of the things under some names; none under two."""
        labels = draw(st.lists(st.sampled_from(range(-2, len(NAMES))), min_size=len(things), max_size=len(things)))
        chosen = np.array(labels, dtype=np.int64)
        found = {NAMES[label]: things[chosen == label] for label in sorted(set(labels) - {-1, -2})}
        return found if draw(st.booleans()) else {}

    points = draw(st.dictionaries(st.sampled_from(NAMES), st.sampled_from(used), max_size=2))
    sets = Groups(parts(mesh.segments), parts(edges[counts == 2]), parts(np.arange(len(mesh.quads))), points)
    return replace(mesh, groups=sets)


@dataclass(frozen=True)
class BlockGroups:
    """The parts of a block that have names."""

    faces: Mapping[str, Ints] = field(default_factory=dict)
    interfaces: Mapping[str, Ints] = field(default_factory=dict)
    regions: Mapping[str, Ints] = field(default_factory=dict)
    edges: Mapping[str, Ints] = field(default_factory=dict)


@dataclass(frozen=True)
class Block:
    """A mesh of hexahedra."""

    name: str
    nodes: Floats
    hexes: Ints
    groups: BlockGroups


def block(nodes: int = 8, layers: int = 2) -> Block:
    """`named` raised in layers, of hexahedra of 8 or 20 nodes; the faces of the holes and of the front have no name."""
    flat = named()
    n, m = len(flat.vertices), len(flat.quads)
    levels = np.repeat(np.arange(layers + 1.0) * 0.7, n)
    places = np.column_stack([np.tile(flat.vertices, (layers + 1, 1)), levels])
    hexes = np.concatenate([np.hstack([flat.quads + k * n, flat.quads + (k + 1) * n]) for k in range(layers)])

    def raised(edges: Ints) -> Ints:
        a, b = edges.T
        return np.concatenate([np.stack([a, b, b + n, a + n], axis=1) + k * n for k in range(layers)])

    groups = BlockGroups(
        faces={name: raised(edges) for name, edges in flat.groups.sides.items()} | {"back": flat.quads[:, ::-1]},
        interfaces={name: raised(edges) for name, edges in flat.groups.lines.items()},
        regions={
            name: np.concatenate([some + k * m for k in range(layers)]) for name, some in flat.groups.regions.items()
        },
        edges={
            name: np.array([[v + k * n, v + (k + 1) * n] for k in range(layers)])
            for name, v in flat.groups.points.items()
        },
    )
    if nodes == 8:
        return Block("block", places, hexes, groups)
    ends = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)])
    edges, edge_of = np.unique(np.sort(hexes[:, ends], axis=-1).reshape(-1, 2), axis=0, return_inverse=True)
    number = {tuple(edge): len(places) + i for i, edge in enumerate(edges.tolist())}

    def between(walks: Ints) -> Ints:
        """Walks with the middles between their nodes, (k, c) -> (k, 2 c), of two nodes (k, 3)."""
        pairs = np.sort(np.stack([walks, np.roll(walks, -1, axis=1)], axis=-1), axis=-1)
        pairs = pairs[:, :1] if walks.shape[1] == 2 else pairs
        return np.hstack([walks, np.apply_along_axis(lambda pair: number[tuple(pair)], -1, pairs)])

    return Block(
        "block",
        np.concatenate([places, places[edges].mean(axis=1)]),
        np.hstack([hexes, len(places) + edge_of.reshape(-1, 12)]),
        BlockGroups(
            {name: between(faces) for name, faces in groups.faces.items()},
            {name: between(faces) for name, faces in groups.interfaces.items()},
            groups.regions,
            {name: between(lines) for name, lines in groups.edges.items()},
        ),
    )
