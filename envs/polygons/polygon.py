"""Polygons in: rings of coordinates become a validated :class:`~envs.types.Domain`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import ArrayLike

from envs.polygons import ring_with_seams, seam
from envs.polygons.rings import (
    as_ring,
    check_count,
    check_crossings,
    check_distinct,
    check_nesting,
    outline,
    with_even_count,
)
from envs.types import Domain, DomainError, Floats


def from_rings(
    outer: ArrayLike, holes: Sequence[ArrayLike] = (), name: str = "polygon", *, fix_parity: bool = False
) -> Domain:
    """The domain inside an outer ring and outside some holes.

    Either orientation is accepted; a closing point that repeats the first is dropped; no coordinate is moved.

    Args:
        outer: n >= 4 pairs of numbers.
        holes: each n >= 3 pairs of numbers.
        name: what messages, tables and files call the domain.
        fix_parity: split the longest segment at its midpoint when the total number of vertices is odd.

    Returns:
        The domain; its points are the outer ring's in counter-clockwise order, each hole's, then the seams'.

    Raises:
        DomainError: what makes it unfit for a mesh of quadrilaterals: source, place and fix in one line.
    """
    rings = apart([as_ring(ring, name, i) for i, ring in enumerate([outer, *holes])], name)
    check_count(sum(len(ring) for ring in rings), name, holes=len(rings) > 1)
    return seam.join(name, with_even_count(rings, name, fix_parity))


def apart(rings: list[Floats], name: str) -> list[Floats]:
    """The rings, the outer one first, none of which crosses or touches itself or another, the holes side by side."""
    check_distinct(rings, name)
    check_crossings(outline(rings, name))
    check_nesting(rings, name)
    return rings


def from_polygon(polygon: shapely.Polygon, name: str = "polygon", *, fix_parity: bool = False) -> Domain:
    """The domain of a shapely polygon; see :func:`from_rings`."""
    if not isinstance(polygon, shapely.Polygon):
        raise DomainError(f"{name}: a {type(polygon).__name__} where a Polygon is needed; give one polygon")
    if polygon.is_empty:
        raise DomainError(f"{name}: an empty polygon; give at least 4 vertices")
    rings = [np.asarray(ring.coords)[:, :2] for ring in (polygon.exterior, *polygon.interiors)]
    return from_ring_list(rings, name, fix_parity=fix_parity)


def from_ring_with_seam(ring: ArrayLike, name: str = "polygon", *, fix_parity: bool = False) -> Domain:
    """The domain of one ring that may walk seams to its holes; without repeated points, as :func:`from_rings`.

    Repeated points are accepted where they form seams: every edge between them walked once in each direction, the
    inside to the left throughout. The two sides of a seam must be equal number for number.

    Raises:
        DomainError: as :func:`from_rings`; repeated points that are no seam are a pinch.
    """
    vertices = as_ring(ring, name)
    if len(np.unique(vertices, axis=0)) == len(vertices):
        return from_rings(vertices, (), name, fix_parity=fix_parity)
    return ring_with_seams.opened(name, vertices, fix_parity)


def from_ring_list(rings: Sequence[ArrayLike], name: str, *, fix_parity: bool = False) -> Domain:
    """The domain of an outer ring and its holes as files list them; a ring alone may hold its seams already."""
    if len(rings) == 1:
        return from_ring_with_seam(rings[0], name, fix_parity=fix_parity)
    return from_rings(rings[0], rings[1:], name, fix_parity=fix_parity)


def outlines(rings: Sequence[ArrayLike], name: str) -> list[Floats]:
    """Rings fit to be discretised: as :func:`from_ring_list` wants them, but of any number from 3 vertices on.

    Raises:
        DomainError: as :func:`from_ring_list`.
    """
    given = [as_ring(ring, name, i, least=3) for i, ring in enumerate(rings)]
    if len(given) == 1 and len(np.unique(given[0], axis=0)) < len(given[0]):
        ring_with_seams.opened(name, given[0], fix_parity=True)
        return given
    return apart(given, name)
