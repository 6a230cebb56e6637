"""A mesh as solvers take it: nodes, elements of four or eight of them, and the loops that bound the domain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from envs.mesh import Mesh, sides
from envs.polygons.rings import loops, signed_area
from envs.quality import element_quality
from envs.types import Floats, Ints


@dataclass(frozen=True)
class Curve:
    """A part of the boundary: all of it, or one loop.

    Attributes:
        name: ``boundary``, ``outer``, or ``hole_1``, ``hole_2``, ...
        nodes: (k,) int64, ascending; those of segments that no element reaches yet, too.
        elements: (s,) int64, ascending: the element behind each element side on the curve.
        sides: (s,) int64 in [0, 3]: which side of that element; side i runs from corner i to the next.
        lines: (s, 2 or 3) int64: the side's ends, the domain on their left, and its mid-side node.
    """

    name: str
    nodes: Ints
    elements: Ints
    sides: Ints
    lines: Ints


@dataclass(frozen=True)
class FiniteElements:
    """What the formats write.

    Attributes:
        name: the domain's.
        nodes: (n, 2) float64: the mesh's vertices, then the mid-side nodes, in the order of their edges' ends.
        elements: (m, 4 or 8) int64: counter-clockwise corners; the fifth node halfway along the first side, and so on.
        eta: (m,) float64 in [0, 1]: the quality of each element.
        boundary: all of it.
        loops: its closed curves, the outer one first, then the holes in the order of their first vertices.
    """

    name: str
    nodes: Floats
    elements: Ints
    eta: Floats
    boundary: Curve
    loops: tuple[Curve, ...]

    @property
    def quadratic(self) -> bool:
        """Whether the elements have mid-side nodes."""
        return self.elements.shape[1] == 8

    @property
    def curves(self) -> tuple[Curve, ...]:
        """The boundary, and where it has several loops, these."""
        return (self.boundary, *self.loops) if len(self.loops) > 1 else (self.boundary,)

    @property
    def title(self) -> str:
        """One line of printable ASCII, no longer than the formats' comments may be."""
        text = f"{len(self.elements)} quadrilaterals of {self.name}"
        return "".join(c if c.isascii() and c.isprintable() else "?" for c in text)[:70]


def finite_elements(mesh: Mesh, quadratic: bool) -> FiniteElements:
    """The elements and boundary loops of a mesh.

    Args:
        mesh: complete or not.
        quadratic: put a node, shared by the elements on both sides, halfway along every edge.
    """
    nodes, elements = (_with_middles if quadratic else _corners)(mesh)
    loop_of = _loop_of(mesh)
    names = ["outer", *(f"hole_{i}" for i in range(1, loop_of.max(initial=0) + 1))]
    return FiniteElements(
        name=mesh.name,
        nodes=nodes,
        elements=elements,
        eta=element_quality(mesh.vertices, mesh.quads),
        boundary=_curve("boundary", mesh, elements, loop_of >= 0),
        loops=tuple(_curve(name, mesh, elements, loop_of == i) for i, name in enumerate(names)),
    )


def _corners(mesh: Mesh) -> tuple[Floats, Ints]:
    return mesh.vertices, mesh.quads


def _with_middles(mesh: Mesh) -> tuple[Floats, Ints]:
    ends = np.sort(sides(mesh.quads), axis=-1).reshape(-1, 2)
    edges, edge_of = np.unique(ends, axis=0, return_inverse=True)
    middles = 0.5 * (mesh.vertices[edges[:, 0]] + mesh.vertices[edges[:, 1]])
    numbers = len(mesh.vertices) + edge_of.reshape(-1, 4)
    return np.concatenate([mesh.vertices, middles]), np.hstack([mesh.quads, numbers])


def _loop_of(mesh: Mesh) -> Ints:
    """(n,) int64: the loop that a vertex belongs to, 0 for the outer one; -1 for vertices inside."""
    number = np.full(len(mesh.vertices), -1)
    order = sorted(loops(mesh.segments), key=lambda loop: (signed_area(mesh.vertices[loop]) < 0, loop.min()))
    for i, loop in enumerate(order):
        number[loop] = i
    return number


def _curve(name: str, mesh: Mesh, elements: Ints, member: np.ndarray) -> Curve:
    """The curve through the vertices that are members, (n,) bool."""
    chosen = mesh.segments[member[mesh.segments[:, 0]]]
    ends = sides(mesh.quads)
    element, side = np.nonzero(np.isin(_keys(ends), _keys(chosen)))
    lines = ends[element, side]
    if elements.shape[1] == 8:
        lines = np.column_stack([lines, elements[element, 4 + side]])
    return Curve(name, np.union1d(chosen, lines), element, side, lines)


def _keys(edges: Ints) -> Ints:
    """(..., 2) vertex pairs -> (...,) int64, one number for an edge in either direction."""
    return edges.min(axis=-1) << 32 | edges.max(axis=-1)
