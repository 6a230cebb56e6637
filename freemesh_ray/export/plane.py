"""A plane mesh as finite elements of 4, 8, 9, 16 or 25 nodes."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from envs.mesh import Mesh
from envs.quality import element_quality
from envs.types import Floats, Ints
from freemesh_ray.export.element_kinds import Kind, quadrilateral, rows
from freemesh_ray.export.facets import behind, sides_of
from freemesh_ray.export.finite_elements import Facets, FiniteElements, NodeSet
from freemesh_ray.export.names import free
from freemesh_ray.export.regions import partition
from freemesh_ray.mesh_geometry.high_order import high_order

#: What is called so when nothing says otherwise.
BOUNDARY, OUTER, HOLE = "boundary", "outer", "hole"


def plane_elements(mesh: Mesh, nodes: int = 4) -> FiniteElements:
    """The elements of a mesh and its parts.

    Boundary segments without a name are ``boundary``; where the boundary has several loops, they are ``outer``, or
    ``outer_1`` and so on of several outer ones, and ``hole_1``, ``hole_2``, ... in the order of the loops' first
    vertices. Elements without a name are ``domain``. A name of these that is taken gets a number.

    Args:
        mesh: complete or not.
        nodes: of an element: 4, 8, 9, 16 or 25.
    """
    kind = quadrilateral(nodes)
    places, elements = _elements(mesh, kind)
    found = {name: wanted for name, wanted in mesh.groups.lines.items() if len(wanted)}
    return FiniteElements(
        name=mesh.name,
        nodes=places,
        elements=elements,
        kind=kind,
        eta=element_quality(mesh.vertices, mesh.quads),
        sides=tuple(_facets(name, wanted, elements, kind) for name, wanted in _sides(mesh).items()),
        lines=tuple(_facets(name, wanted, elements, kind) for name, wanted in found.items()),
        regions=partition(mesh.groups.regions, len(elements)),
        points=tuple(NodeSet(name, np.array([[vertex]])) for name, vertex in mesh.groups.points.items()),
    )


def _elements(mesh: Mesh, kind: Kind) -> tuple[Floats, Ints]:
    if kind.order == 1:
        return mesh.vertices, mesh.quads.astype(np.int64)
    found = high_order(mesh, kind.order)
    lattice = rows(kind.order)
    elements = np.asarray(found.elements)[:, [lattice.index(place) for place in kind.places]]
    # Nodes inside elements are the last ones.
    count = int(elements.max()) + 1 if kind.serendipity else len(found.nodes)
    return found.nodes[:count], elements


def _facets(name: str, wanted: Ints, elements: Ints, kind: Kind) -> Facets:
    _, element, side = behind(elements, kind, wanted)
    facets = sides_of(elements, kind)[element, side]
    return Facets(name, np.union1d(wanted, facets), element, side, facets)


def _sides(mesh: Mesh) -> dict[str, Ints]:
    """The boundary segments by name, each in one part, parts in the order of their names' mention."""
    segments = mesh.segments
    left = {tuple(sorted(segment)): i for i, segment in enumerate(segments.tolist())}
    parts: dict[str, list[int]] = {}
    for name, given in mesh.groups.sides.items():
        mine = [left.pop(tuple(sorted(pair)), None) for pair in np.asarray(given).tolist()]
        parts[name] = [i for i in mine if i is not None]
    loop_of, names = _loops(mesh)
    taken = {name for name, some in parts.items() if some}
    for i in sorted(left.values(), key=lambda i: (loop_of[i], i)):
        name = names[loop_of[i]]
        parts.setdefault(free(name, taken), []).append(i)
    return {name: segments[sorted(some)] for name, some in parts.items() if some}


def _loops(mesh: Mesh) -> tuple[list[int], list[str]]:
    """Which loop every segment belongs to, and what these are called, outer ones first."""
    segments, n = mesh.segments, len(mesh.vertices)
    ones = np.ones(len(segments), dtype=np.int8)
    _, of_vertex = connected_components(coo_matrix((ones, tuple(segments.T)), shape=(n, n)), directed=False)
    labels, first, loop_of = np.unique(of_vertex[segments[:, 0]], return_index=True, return_inverse=True)
    start = mesh.vertices[segments[first, 0]][loop_of]
    a, b = (mesh.vertices[ends] - start for ends in segments.T)
    area = np.bincount(loop_of, a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], len(labels))
    least = [int(segments[loop_of == i].min()) for i in range(len(labels))]
    inside = area <= 0.0
    order = sorted(range(len(labels)), key=lambda i: (bool(inside[i]), least[i]))
    rank = {label: i for i, label in enumerate(order)}
    outer = int((~inside).sum())
    if len(labels) == 1:
        names = [BOUNDARY]
    else:
        names = [OUTER] if outer == 1 else [f"{OUTER}_{i}" for i in range(1, outer + 1)]
        names += [f"{HOLE}_{i}" for i in range(1, len(labels) - outer + 1)]
    return [rank[int(i)] for i in loop_of], names
