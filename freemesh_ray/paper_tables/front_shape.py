"""The front's shape as a mesh is cut: the paper sees it turn into an oval, whatever the domain."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from envs.mesh import Mesh, sides
from envs.types import Floats, Ints

#: Shares of the elements that are cut when the front is looked at.
SHARES = (0.0, 0.25, 0.5, 0.75, 0.9)


class FrontShape(NamedTuple):
    """Of the region that is left, each of its pieces by itself.

    Attributes:
        roundness: 4 pi area / perimeter^2, in [0, 1]; 1 for a disc, .84 for an ellipse of 2 by 1.
        convexity: area / area of the convex hull, in [0, 1].
        pieces: that hang together by edges.
    """

    roundness: float
    convexity: float
    pieces: int


def front_shape(mesh: Mesh, share: float) -> FrontShape:
    """The shape of what is left when a share of the elements is cut.

    Args:
        mesh: complete, its elements in the order in which they were cut.
        share: in [0, 1).
    """
    left = mesh.quads[int(share * len(mesh.quads)) :]
    areas = mesh.areas[len(mesh.quads) - len(left) :]
    piece, count = _pieces(left)
    area = np.bincount(piece, weights=areas, minlength=count).astype(np.float64)
    perimeter = _perimeters(mesh.vertices, left, piece, count)
    hulls = np.array([ConvexHull(mesh.vertices[np.unique(left[piece == i])]).volume for i in range(count)])
    weights = area / area.sum()
    return FrontShape(float(weights @ (4 * np.pi * area / perimeter**2)), float(weights @ (area / hulls)), count)


def _pieces(quads: Ints) -> tuple[Ints, int]:
    """The piece of each element, (m,), and how many there are."""
    ends = np.sort(sides(quads).reshape(-1, 2), axis=1)
    _, edge = np.unique(ends, axis=0, return_inverse=True)
    element = np.repeat(np.arange(len(quads)), 4)
    uses = coo_array((np.ones(len(edge)), (element, edge))).tocsr()
    count, piece = connected_components(uses @ uses.T, directed=False)
    return piece, int(count)


def _perimeters(vertices: Floats, quads: Ints, piece: Ints, count: int) -> Floats:
    """(count,): lengths of the edges that one element alone has."""
    ends = np.sort(sides(quads).reshape(-1, 2), axis=1)
    _, edge, uses = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    once = uses[edge] == 1
    lengths = np.linalg.norm(vertices[ends[:, 1]] - vertices[ends[:, 0]], axis=1)
    found: Floats = np.bincount(np.repeat(piece, 4)[once], weights=lengths[once], minlength=count).astype(np.float64)
    return found
