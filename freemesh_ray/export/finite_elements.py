"""A mesh as solvers take it: nodes, elements, and the parts that have names."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from envs.types import Floats, Ints
from freemesh_ray.export.element_kinds import Kind


@dataclass(frozen=True, eq=False)
class Facets:
    """A part of the boundary, or a line or surface inside: edges of plane elements, faces of hexahedra.

    Attributes:
        name: of the part.
        nodes: (k,) int64, ascending; those of segments that no element reaches yet, too.
        elements: (s,) int64, ascending: the element behind each facet; inside, the one on the left of an edge.
        sides: (s,) int64: which of its sides the facet is.
        facets: (s, 2 or more) int64: its corners, the mesh on the left or the face seen from outside; then what nodes
            lie between these.
    """

    name: str
    nodes: Ints
    elements: Ints
    sides: Ints
    facets: Ints


@dataclass(frozen=True, eq=False)
class Region:
    """Elements with a name, (k,) int64, ascending."""

    name: str
    elements: Ints


@dataclass(frozen=True, eq=False)
class NodeSet:
    """A point with a name, or in space the edges that it was swept into.

    Attributes:
        name: of the part.
        cells: (k, 1) int64 nodes, or (k, 2 or 3) edges: their ends and their middles.
    """

    name: str
    cells: Ints

    @property
    def nodes(self) -> Ints:
        """(k,) int64, ascending."""
        return np.unique(self.cells)


@dataclass(frozen=True)
class Group:
    """A part's number, unlike that of every other part, how many dimensions it has, and its name."""

    number: int
    dimension: int
    name: str


@dataclass(frozen=True, eq=False)
class FiniteElements:
    """What the formats write.

    Attributes:
        name: the domain's.
        nodes: (n, 2 or 3) float64: the mesh's vertices, then those between.
        elements: (m, nodes of the kind) int64.
        kind: of the elements.
        eta: (m,) float64 in [0, 1], the quality of each element; None of hexahedra.
        sides: the parts of the boundary; every boundary facet is in one of them.
        lines: the edges, of hexahedra faces, inside that have names.
        regions: the parts of the domain; every element is in one of them.
        points: the points that have names.
    """

    name: str
    nodes: Floats
    elements: Ints
    kind: Kind
    eta: Floats | None
    sides: tuple[Facets, ...]
    lines: tuple[Facets, ...]
    regions: tuple[Region, ...]
    points: tuple[NodeSet, ...]

    @property
    def boundary(self) -> Facets:
        """All sides in one."""
        elements = np.concatenate([side.elements for side in self.sides])
        order = np.argsort(elements, kind="stable")
        return Facets(
            "boundary",
            np.unique(np.concatenate([side.nodes for side in self.sides])),
            elements[order],
            np.concatenate([side.sides for side in self.sides])[order],
            np.concatenate([side.facets for side in self.sides])[order],
        )

    @property
    def facets(self) -> tuple[Facets, ...]:
        """The sides, then the lines."""
        return (*self.sides, *self.lines)

    @property
    def node_sets(self) -> list[tuple[str, Ints]]:
        """Name and nodes, (k,) int64 ascending, of the sides, the lines and the points."""
        facets = [(part.name, part.nodes) for part in self.facets]
        return facets + [(point.name, point.nodes) for point in self.points]

    @property
    def places(self) -> Floats:
        """(n, 3) float64: the nodes; those of the plane have z = 0."""
        return np.column_stack([self.nodes, np.zeros((len(self.nodes), 3 - self.nodes.shape[1]))])

    @property
    def region_of(self) -> Ints:
        """(m,) int64: the number of every element's region, from 0."""
        numbers = np.zeros(len(self.elements), dtype=np.int64)
        for i, region in enumerate(self.regions):
            numbers[region.elements] = i
        return numbers

    def element_at(self, nodes: Ints) -> Ints:
        """(k,) int64: the first element of each of k nodes."""
        known, first = np.unique(self.elements, return_index=True)
        return first[np.minimum(np.searchsorted(known, nodes), len(known) - 1)] // self.elements.shape[1]

    def groups(self) -> Iterator[Group]:
        """Regions, sides, lines and points, numbered from 1 in this order."""
        d = self.kind.dimension
        named = [(d, region.name) for region in self.regions]
        named += [(d - 1, part.name) for part in self.facets]
        named += [(d - 2, point.name) for point in self.points]
        return (Group(i, dimension, name) for i, (dimension, name) in enumerate(named, 1))

    def cell_numbers(self) -> list[Ints]:
        """For every group, in their order, the numbers from 0 of its cells: elements keep theirs, others follow."""
        found = [region.elements for region in self.regions]
        counts = [*(len(part.facets) for part in self.facets), *(len(point.cells) for point in self.points)]
        ends = len(self.elements) + np.cumsum(counts)
        return found + [np.arange(end - count, end) for end, count in zip(ends, counts, strict=True)]

    @property
    def title(self) -> str:
        """One line of printable ASCII, no longer than the formats' comments may be."""
        what = "quadrilaterals" if self.kind.dimension == 2 else "hexahedra"
        text = f"{len(self.elements)} {what} of {self.name}"
        return "".join(c if c.isascii() and c.isprintable() else "?" for c in text)[:70]
