"""The inside of a solid of revolution whose plane mesh touches the axis: grids around the axis in place of wedges.

::

    c-----------c        Elements with a side on the axis would sweep wedges. They are a column; each of its levels, an
    | \\       / |        edge from the axis to the circle that its other end sweeps, becomes a disc of quadrilaterals
    |   o---o   |        around the axis, or a sector, and hexahedra are stacked between two discs. A sector of about 90
    |   | + |   |        degrees is a grid around the axis (+) and one row of elements to the circle (c).
    |   o---o   |
    | /       \\ |
    c-----------c
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from envs.errors import UserError
from envs.mesh import Mesh, sides
from envs.polygons.rings import place
from envs.types import Floats, Ints

#: How much further than the ends of its sides the outer corner of a sector's grid is from the axis.
CORNER = 1.15


@dataclass(frozen=True)
class Disc:
    """The quadrilaterals of a disc, or of a sector of one.

    Attributes:
        radius: (t,) share of the circle's radius of each node but those on the circle; node 0 is the centre.
        turn: (t,) share of the whole turn.
        quads: (q, 4) int64 nodes, counter-clockwise; ``t + i`` is the circle's node i.
        first, last: nodes along the first and the last radius, from the centre to the circle.
    """

    radius: Floats
    turn: Floats
    quads: Ints
    first: Ints
    last: Ints


def disc(sectors: int, pieces: int, closed: bool, angle: float) -> Disc:
    """A disc.

    Args:
        sectors: grids around the centre.
        pieces: of the circle in each sector, even.
        closed: the last sector ends at the first one.
        angle: of the whole turn, radians.
    """
    j = pieces // 2
    rings = max(1, round(j / 2))
    circle = sectors * pieces + (0 if closed else 1)
    gridded = 1 + sectors * j * (j + 1) + (0 if closed else j)
    inner = gridded + (rings - 1) * circle
    opening = angle / sectors
    # Of a sector's grid the other corners: along its first side, furthest, and along its second side.
    reach = j / (j + rings)
    tips = reach * np.exp(1j * opening * np.array([0.0, 0.5, 1.0])) * [1.0, CORNER, 1.0]
    number = np.zeros((sectors, j + 1, j + 1), dtype=np.int64)
    own = np.arange(sectors * j * (j + 1)).reshape(sectors, j, j + 1) + 1
    number[:, 1:, :] = own
    number[:-1, 0, 1:] = own[1:, :, 0]
    number[-1, 0, 1:] = own[0, :, 0] if closed else gridded - j + np.arange(j)
    a, b = np.meshgrid(np.arange(j + 1) / j, np.arange(j + 1) / j, indexing="ij")
    grid = a * (1 - b) * tips[0] + a * b * tips[1] + (1 - a) * b * tips[2]
    places, turn, blocks = np.zeros(inner, dtype=np.complex128), np.zeros(inner), []
    rim = np.zeros(circle, dtype=np.int64)
    for s in range(sectors - 1, -1, -1):
        places[number[s]] = grid
        turn[number[s]] = (s + np.angle(grid) / opening) / sectors
        blocks.append(_grid(number[s]))
        rim[(s * pieces + np.arange(pieces + 1)) % circle] = [*number[s, j, :j], *number[s, j::-1, j]]
    outwards = np.stack(
        [rim, *(gridded + np.arange((rings - 1) * circle).reshape(-1, circle)), inner + np.arange(circle)]
    )
    radius, last = np.abs(places), np.concatenate([number[-1, 0], outwards[1:, sectors * pieces % circle]])
    for i in range(1, rings):
        share, on = i / rings, np.arange(circle) / (sectors * pieces)
        radius[outwards[i]] = (1 - share) * radius[rim] + share
        turn[outwards[i]] = (1 - share) * turn[rim] + share * on
    blocks.append(_grid(np.hstack([outwards, outwards[:, :1]]) if closed else outwards))
    first = np.concatenate([number[0, :, 0], outwards[1:, 0]])
    return Disc(radius, turn, np.concatenate(blocks), first, last)


def _grid(number: Ints) -> Ints:
    """(a, b) numbers -> the quadrilaterals between them, (k, 4)."""
    corners = (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    return np.stack([corner.ravel() for corner in corners], axis=1)


@dataclass(frozen=True)
class Column:
    """The elements of a plane mesh with a side on the axis.

    Attributes:
        quads: (k,) int64 elements.
        axis: (k, 2) int64 vertices of each on the axis, the mesh on their left.
        levels: (l,) int64 vertices on the axis, ascending.
        rims: (l,) int64 the vertex at the other end of the edge that leaves the axis at each of them.
    """

    quads: Ints
    axis: Ints
    levels: Ints
    rims: Ints

    def radial(self, segments: Ints) -> np.ndarray:
        """(k,) bool: which of (k, 2) segments are edges from the axis to a rim."""
        touching = np.isin(segments, self.levels)
        return np.asarray(touching.any(axis=1) & ~touching.all(axis=1))

    def along(self, segments: Ints) -> np.ndarray:
        """(k,) bool: which of (k, 2) segments lie on the axis."""
        return np.asarray(np.isin(segments, self.levels).all(axis=1))


def column_of(mesh: Mesh, touching: np.ndarray) -> Column:
    """The column of a mesh.

    Args:
        mesh: complete.
        touching: (n,) bool, the vertices on the axis; some.

    Raises:
        UserError: an element that touches the axis in a point, or with more than one side.
    """
    on = touching[mesh.quads]
    for q in np.flatnonzero(
        (on.sum(axis=1) == 1) | (on.sum(axis=1) > 2) | (on[:, 0] & on[:, 2]) | (on[:, 1] & on[:, 3])
    )[:1]:
        where = mesh.vertices[mesh.quads[q][on[q]][0]]
        raise UserError(
            f"{mesh.name}: at {place(where)} an element touches the axis of revolution with other than one side, and "
            "would sweep hexahedra without volume; put one boundary layer along the axis, or keep the polygon apart "
            "from it"
        )
    quads = np.flatnonzero(on.any(axis=1))
    ends = sides(mesh.quads[quads])
    axis = ends[touching[ends].all(axis=2)]
    walked = ends[touching[ends].sum(axis=2) == 1]
    inside = touching[walked[:, 0]]
    pairs = np.unique(np.concatenate([walked[inside], walked[~inside][:, ::-1]]), axis=0)
    for i in np.flatnonzero(np.diff(pairs[:, 0]) == 0)[:1]:
        raise UserError(
            f"{mesh.name}: at {place(mesh.vertices[pairs[i, 0]])} two parts of the mesh touch the axis of revolution "
            "in one point; keep them apart"
        )
    return Column(quads, axis, pairs[:, 0], pairs[:, 1])


@dataclass(frozen=True)
class Core:
    """The hexahedra of a column.

    Attributes:
        column: what is swept.
        disc: each level's.
        vertices: of the plane mesh; the circle's node i at rim v is the solid's node i * vertices + v.
        first: number of the core's first node.
    """

    column: Column
    disc: Disc
    vertices: int
    first: int

    @property
    def hexes_each(self) -> int:
        """Hexahedra for each element of the column."""
        return len(self.disc.quads)

    def hexes(self) -> Ints:
        """(k hexes_each, 8) int64, element by element of the column."""
        quads, pairs = self.disc.quads, self.column.axis.tolist()
        return np.concatenate([np.hstack([self._at(quads, a), self._at(quads, b)]) for a, b in pairs])

    def faces(self, segments: Ints) -> Ints:
        """(k, 2) segments from the axis to a rim or back -> (k hexes_each, 4), seen from their right."""
        outwards = np.isin(segments[:, 0], self.column.levels)
        return np.concatenate([
            np.zeros((0, 4), dtype=np.int64),
            *(
                self._at(self.disc.quads if out else self.disc.quads[:, ::-1], a if out else b)
                for (a, b), out in zip(segments.tolist(), outwards.tolist(), strict=True)
            ),
        ])  # fmt: skip

    def strip(self, radius: Ints) -> Ints:
        """(k, 4) faces over the column's elements along a radius of the disc, in the elements' orientation."""
        found = []
        for a, b in self.column.axis.tolist():
            low, high = self._at(radius, a), self._at(radius, b)
            found.append(np.stack([low[:-1], high[:-1], high[1:], low[1:]], axis=1))
        return np.concatenate(found)

    def node(self, vertex: int) -> int:
        """The node of a vertex on the axis."""
        return int(self._at(np.zeros(1, dtype=np.int64), vertex)[0])

    def _at(self, nodes: Ints, vertex: int) -> Ints:
        """Nodes of the disc -> nodes of the solid, at the level of a vertex on the axis."""
        level = int(np.searchsorted(self.column.levels, vertex))
        inner = len(self.disc.radius)
        own = self.first + level * inner + nodes
        return np.asarray(np.where(nodes < inner, own, (nodes - inner) * self.vertices + self.column.rims[level]))
