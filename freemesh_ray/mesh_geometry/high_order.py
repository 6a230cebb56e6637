"""Elements of order 2 and more: nodes along the sides, on the curves where there are any, and inside.

Node (i, j) of an element of order k, its row j and its place i in it::

    d . . c       j = k        a row runs along the first side, ab
    . . . .
    a . . b       j = 0

Nodes on a curve are as far apart along it. Those inside follow from the sides by transfinite interpolation (Gordon,
Hall: Construction of curvilinear co-ordinate systems, Int. J. Numer. Methods Eng. 7, 1973), which keeps the order of
the error: derivatives of the map along a direction are no larger than those of the sides.

Where a curved side turns its element over, the bend is first carried into the nodes inside, then into the elements
behind. That does not help where the angle between two curved sides is a straight one, as at a smooth curve's vertex of
one element: there the nodes of the two sides leave the curve towards their chords, by as little as makes the
determinant positive. It takes about as much as the polynomials are off the curve anyway, so the order of the error
stays. What no such step rights is told, so that the curve gets more vertices there.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from envs.mesh import Mesh, sides
from envs.types import Floats, Ints
from freemesh_ray.mesh_geometry import lagrange
from freemesh_ray.mesh_geometry.jacobian import least_jacobian
from freemesh_ray.mesh_geometry.lifting import lifted

#: Rows of elements around one that is turned over that the bend may be carried into, tried one after the other.
ROWS = (0, 1, 2, 4, 8, 16)

#: How far nodes may leave a curve, as shares of their way to the chord, tried one after the other.
EASING = tuple(2.0**-i for i in range(40, 3, -1))

#: A determinant counts as positive from this share of its mean on: what is less is rounding.
POSITIVE = 1e-9

NONE = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class HighOrder:
    """A mesh with nodes for elements of an order.

    Attributes:
        order: k >= 1.
        nodes: (n, 2) float64: the mesh's vertices in their order, then those on the edges, then those inside.
        elements: (m, (k + 1)^2) int64 in tensor-product order, row by row along an element's first side.
        stations: (k + 1,) float64, places of the nodes along a side, from 0 to 1.
        spoiled: (s,) int64: elements whose Jacobian determinant is not positive everywhere.
        bent: (b,) int64: elements behind a curve whose straight sides were bent so that fewer are.
        eased: (c,) int64: elements whose curved sides left the curve so that they are not.
        off_curve: how far a node is from its curve at most, in the mesh's units; 0 unless sides were eased.
    """

    order: int
    nodes: Floats
    elements: Ints
    stations: Floats
    spoiled: Ints = field(default_factory=NONE.copy)
    bent: Ints = field(default_factory=NONE.copy)
    eased: Ints = field(default_factory=NONE.copy)
    off_curve: float = 0.0

    @property
    def grid(self) -> Ints:
        """(m, k + 1, k + 1) int64: the elements' nodes, [:, j, i]."""
        return self.elements.reshape(-1, self.order + 1, self.order + 1)

    @property
    def around(self) -> Ints:
        """(m, 4 k) int64: the nodes of every element's sides: the corners, then those inside each side, ab to da.

        Of order 2 this is the element of eight nodes. A side's nodes are in the order of the walk round the element.
        """
        g, k = self.grid, self.order
        corners = np.stack([g[:, 0, 0], g[:, 0, k], g[:, k, k], g[:, k, 0]], axis=1)
        inner = slice(1, k)
        walked = [g[:, 0, inner], g[:, inner, k], g[:, k, inner][:, ::-1], g[:, inner, 0][:, ::-1]]
        return np.concatenate([corners, *walked], axis=1)

    @property
    def serendipity(self) -> tuple[Floats, Ints]:
        """The nodes without those inside elements, and the elements of 4 k nodes, see ``around``; k = 2 or 3.

        Their map is the one of (k + 1)^2 nodes whose inner ones follow from the sides by transfinite interpolation.
        """
        return self.nodes[: len(self.nodes) - len(self.elements) * (self.order - 1) ** 2], self.around


def high_order(mesh: Mesh, order: int, stations: Floats | None = None, *, serendipity: bool = False) -> HighOrder:
    """The nodes and elements of an order.

    Args:
        mesh: complete or not.
        order: at least 1.
        stations: (order + 1,) places of the nodes along a side, ascending from 0 to 1 and symmetric; by default as far
            apart as each other.
        serendipity: the nodes of the sides alone are used (see ``HighOrder.serendipity``): those inside follow from
            them, and that is what is looked at.
    """
    at = lagrange.equal(order) if stations is None else np.asarray(stations, dtype=np.float64)
    edges, edge_of = distinct_edges(mesh.quads)
    on_curve = curve_of(mesh, edges)
    elements = numbered(mesh, order, edge_of, len(edges))
    inner = at[1:-1]
    ends = mesh.vertices[edges]
    along = ends[:, :1] * (1.0 - inner)[:, None] + ends[:, 1:] * inner[:, None]
    for c, curve in enumerate(mesh.curved.curves):
        mine = on_curve == c
        if mine.any():
            along[mine] = curve.between(ends[mine, 0], ends[mine, 1], inner)
    nodes = np.concatenate([mesh.vertices, along.reshape(-1, 2), np.empty((len(elements) * (order - 1) ** 2, 2))])
    fill(nodes, elements, at)
    if order == 1:
        return HighOrder(order, nodes, elements, at)
    touched = np.flatnonzero((on_curve >= 0)[edge_of].any(axis=1))
    spoiled = touched[least_jacobian(nodes, elements[touched], at) < POSITIVE]
    if not len(spoiled):
        return HighOrder(order, nodes, elements, at)
    found = HighOrder(order, nodes, elements, at, spoiled)
    found = lifted_where_spoiled(found, mesh.quads, edge_of, fixed_edges(mesh, edges, on_curve), serendipity)
    return eased_where_spoiled(found, mesh, edges, edge_of, on_curve >= 0)


def spoiled(mesh: Mesh, order: int) -> Ints:
    """(s,) int64: elements whose curved sides turn them over somewhere, whatever is done with the nodes inside.

    The curve is to have more vertices there.
    """
    return high_order(mesh, order).spoiled


def distinct_edges(quads: Ints) -> tuple[Ints, Ints]:
    """Distinct edges (e, 2) int64, the lower vertex first and ascending, and those of every element's sides, (m, 4)."""
    ends = np.sort(sides(quads).reshape(-1, 2), axis=1).astype(np.int64)
    base = int(ends.max(initial=0)) + 1
    keys, which = np.unique(ends[:, 0] * base + ends[:, 1], return_inverse=True)
    return np.stack(np.divmod(keys, base), axis=1), which.reshape(-1, 4)


def curve_of(mesh: Mesh, edges: Ints) -> Ints:
    """(e,) int64: which curve each of the edges, lower vertex first and ascending, lies on; -1: none."""
    found = np.full(len(edges), -1, dtype=np.int64)
    at, known = positions(np.sort(mesh.curved.edges, axis=1), edges)
    found[at[known]] = mesh.curved.curve_of[known]
    return found


def positions(wanted: Ints, edges: Ints) -> tuple[Ints, np.ndarray]:
    """(w,) where wanted edges are among ascending ones, lower vertices first, and whether they are, (w,) bool."""
    if not len(edges) or not len(wanted):
        return np.zeros(len(wanted), dtype=np.int64), np.zeros(len(wanted), dtype=bool)
    base = int(max(edges.max(), wanted.max())) + 1
    keys, mine = edges[:, 0] * base + edges[:, 1], wanted[:, 0] * base + wanted[:, 1]
    at = np.minimum(np.searchsorted(keys, mine), len(keys) - 1)
    return at, keys[at] == mine


def fixed_edges(mesh: Mesh, edges: Ints, on_curve: Ints) -> np.ndarray:
    """(e,) bool: edges that keep their shape: those of the boundary, of curves and of lines inside."""
    counts = np.bincount(positions(np.sort(sides(mesh.quads).reshape(-1, 2), axis=1), edges)[0], minlength=len(edges))
    fixed = (counts == 1) | (on_curve >= 0)
    for line in mesh.groups.lines.values():
        at, known = positions(np.sort(line, axis=1), edges)
        fixed[at[known]] = True
    return fixed


def numbered(mesh: Mesh, order: int, edge_of: Ints, edges: int) -> Ints:
    """(m, (k + 1)^2) int64: the numbers of every element's nodes."""
    m, k, first = len(mesh.quads), order, len(mesh.vertices)
    grid = np.empty((m, k + 1, k + 1), dtype=np.int64)
    a, b, c, d = mesh.quads.T
    grid[:, 0, 0], grid[:, 0, k], grid[:, k, k], grid[:, k, 0] = a, b, c, d
    along = first + edge_of[:, :, None] * (k - 1) + np.arange(k - 1)
    # An edge's nodes begin at its lower vertex.
    ends = sides(mesh.quads)
    along = np.where((ends[..., 0] > ends[..., 1])[..., None], along[..., ::-1], along)
    grid[:, 0, 1:k], grid[:, 1:k, k] = along[:, 0], along[:, 1]
    grid[:, k, 1:k], grid[:, 1:k, 0] = along[:, 2, ::-1], along[:, 3, ::-1]
    inside = first + edges * (k - 1) + np.arange(m * (k - 1) ** 2)
    grid[:, 1:k, 1:k] = inside.reshape(m, k - 1, k - 1)
    return grid.reshape(m, -1)


def fill(nodes: Floats, elements: Ints, stations: Floats) -> None:
    """Put the nodes inside elements where the sides say, in place."""
    k = len(stations) - 1
    grid = elements.reshape(-1, k + 1, k + 1)
    p = nodes[grid]
    x, y = stations[1:-1, None], stations[1:-1, None, None]
    south, north, west, east = p[:, :1, 1:k], p[:, k:, 1:k], p[:, 1:k, :1], p[:, 1:k, k:]
    corners = (1 - y) * ((1 - x) * p[:, :1, :1] + x * p[:, :1, k:]) + y * ((1 - x) * p[:, k:, :1] + x * p[:, k:, k:])
    nodes[grid[:, 1:k, 1:k]] = (1 - y) * south + y * north + (1 - x) * west + x * east - corners


def lifted_where_spoiled(
    found: HighOrder, quads: Ints, edge_of: Ints, fixed: np.ndarray, serendipity: bool
) -> HighOrder:
    """The nodes with bends carried into the elements around those that are turned over, where that rights them.

    Args:
        found: with elements that are spoiled.
        quads: (m, 4) their corners.
        edge_of: (m, 4) the edges of their sides.
        fixed: (e,) bool, edges whose nodes stay.
        serendipity: whether the nodes inside follow from the sides.
    """
    nodes, bent, left = found.nodes, found.bent, found.spoiled
    used = np.bincount(edge_of.ravel(), minlength=len(fixed))
    for rows in ROWS:
        patch = grown(quads, left, rows)
        within = np.bincount(edge_of[patch].ravel(), minlength=len(fixed))
        free = (within == used) & ~fixed
        moved = lifted(nodes, found.elements, quads, patch, edge_of, free, found.stations)
        if serendipity:
            fill(moved, found.elements[patch], found.stations)
        still = patch[least_jacobian(moved, found.elements[patch], found.stations) < POSITIVE]
        if len(still) < len(left):
            nodes, bent, left = moved, np.union1d(bent, patch), still
        if not len(left):
            break
    return replace(found, nodes=nodes, spoiled=left, bent=bent)


def eased_where_spoiled(found: HighOrder, mesh: Mesh, edges: Ints, edge_of: Ints, curved: np.ndarray) -> HighOrder:
    """The nodes of curved sides closer to the chords, of elements that are turned over and that this rights.

    Args:
        found: where bends were carried on already.
        mesh: whose elements they are.
        edges: (e, 2) distinct edges.
        edge_of: (m, 4) those of the elements' sides.
        curved: (e,) bool, those on curves.
    """
    k, inner = found.order, found.stations[1:-1, None]
    nodes, left, shares = found.nodes.copy(), found.spoiled, np.zeros(len(edges))

    def lay(those: Ints) -> Ints:
        """Put the nodes of some edges where their shares say; the elements that see it."""
        numbers = len(mesh.vertices) + those[:, None] * (k - 1) + np.arange(k - 1)
        chord = (1.0 - inner) * mesh.vertices[edges[those, 0], None] + inner * mesh.vertices[edges[those, 1], None]
        share = shares[those, None, None]
        nodes[numbers] = (1.0 - share) * found.nodes[numbers] + share * chord
        seen = np.flatnonzero(np.isin(edge_of, those).any(axis=1))
        fill(nodes, found.elements[seen], found.stations)
        off[those] = np.linalg.norm(nodes[numbers] - found.nodes[numbers], axis=2).max(axis=1)
        return seen

    off = np.zeros(len(edges))
    for share in EASING:
        if not len(left):
            break
        those = np.unique(edge_of[left])
        those = those[curved[those]]
        shares[those] = share
        seen = lay(those)
        left = seen[least_jacobian(nodes, found.elements[seen], found.stations) < POSITIVE]
    kept = np.unique(edge_of[left])
    kept = kept[shares[kept] > 0.0]
    shares[kept] = 0.0
    lay(kept)
    eased = np.flatnonzero((shares[edge_of] > 0.0).any(axis=1))
    return replace(found, nodes=nodes, spoiled=left, eased=eased, off_curve=float(off.max(initial=0.0)))


def grown(quads: Ints, elements: Ints, rows: int) -> Ints:
    """(p,) int64, ascending: elements and as many rows of those that touch them."""
    vertices = np.zeros(int(quads.max()) + 1, dtype=bool)
    chosen = np.zeros(len(quads), dtype=bool)
    chosen[elements] = True
    for _ in range(rows):
        vertices[quads[chosen].ravel()] = True
        chosen |= vertices[quads].any(axis=1)
    return np.flatnonzero(chosen)
