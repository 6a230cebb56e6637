"""Kinds of element: how many nodes they have, where these lie in the element, and which of them are on which side.

An element of order k has its nodes at whole numbers from 0 to k in each direction. In the plane: the corners,
counter-clockwise; then the nodes inside its sides, walking around; then those inside the element, row by row::

    3  9  8  2      order 3
    10 14 15 7
    11 12 13 6
    0  4  5  1

A hexahedron has the corners of its bottom, then those of its top, and of order 2 the middles of the edges of the
bottom, of the top and between the two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from envs.types import Ints

#: Where a node lies, in steps between nodes.
Place = tuple[int, ...]

#: The nodes of a quadrilateral -> its order.
ORDERS = {4: 1, 8: 2, 9: 2, 16: 3, 25: 4}

#: The outer faces of a hexahedron, counter-clockwise from outside: below, above and the four around.
FACES = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))

#: The edges of a hexahedron in the order of the nodes in their middles.
EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))


@dataclass(frozen=True)
class Kind:
    """A kind of element.

    Attributes:
        dimension: 2 for quadrilaterals, 3 for hexahedra.
        order: of its polynomials, 1 to 4.
        corners: 4 or 8; they are the first nodes.
        places: of its nodes.
        sides: the nodes of every side: corners, then those inside it, from the first corner on.
    """

    dimension: int
    order: int
    corners: int
    places: tuple[Place, ...]
    sides: tuple[tuple[int, ...], ...]

    @property
    def nodes(self) -> int:
        """How many it has."""
        return len(self.places)

    @property
    def serendipity(self) -> bool:
        """Whether it has no nodes inside though its order would have some."""
        return len(self.places) < (self.order + 1) ** self.dimension

    @property
    def side_nodes(self) -> Ints:
        """(sides, nodes of a side) int64."""
        return np.array(self.sides, dtype=np.int64)

    def numbers(self, places: Sequence[Place]) -> list[int]:
        """Which node lies at each place."""
        return [self.places.index(place) for place in places]


@cache
def quadrilateral(nodes: int) -> Kind:
    """The kind of 4, 8, 9, 16 or 25 nodes."""
    k = ORDERS[nodes]
    inner = range(1, k)
    around = [
        (0, 0), (k, 0), (k, k), (0, k),
        *((i, 0) for i in inner), *((k, i) for i in inner), *((k - i, k) for i in inner), *((0, k - i) for i in inner),
    ]  # fmt: skip
    inside = [(i, j) for j in inner for i in inner]
    sides = tuple((s, (s + 1) % 4, *(4 + s * (k - 1) + i for i in range(k - 1))) for s in range(4))
    return Kind(2, k, 4, (*around, *inside)[:nodes], sides)


@cache
def hexahedron(nodes: int) -> Kind:
    """The kind of 8 or 20 nodes."""
    k = 1 if nodes == 8 else 2
    corners = [(x * k, y * k, z * k) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    if k == 1:
        return Kind(3, 1, 8, tuple(corners), FACES)
    middle = {frozenset(edge): 8 + i for i, edge in enumerate(EDGES)}
    middles = [tuple((p + q) // 2 for p, q in zip(corners[a], corners[b], strict=True)) for a, b in EDGES]
    sides = tuple(
        (*face, *(middle[frozenset((a, b))] for a, b in zip(face, (*face[1:], face[0]), strict=True))) for face in FACES
    )
    return Kind(3, 2, 8, (*corners, *middles), sides)


def rows(order: int) -> list[Place]:
    """All places of a quadrilateral, row by row."""
    return [(i, j) for j in range(order + 1) for i in range(order + 1)]
