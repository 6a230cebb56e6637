"""Polygons of one source become domains, one each, with common points where they share their boundary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from numpy.typing import ArrayLike

from envs.polygons.discretisation import discretised
from envs.polygons.polygon import from_ring_list, outlines
from envs.polygons.sizing import check_sizes
from envs.types import Domain, DomainError


def domains_of(
    polygons: Sequence[Sequence[ArrayLike]],
    name: str,
    source: str,
    *,
    fix_parity: bool = False,
    edge_length: float | None = None,
    grading: float = 1.0,
) -> list[Domain]:
    """The domain of each polygon.

    Args:
        polygons: for each its rings, the outer one first; nothing is checked yet.
        name: the domain's name; several are called ``name[0]``, ``name[1]``, ...
        source: what messages begin with.
        fix_parity: split the longest segment when a polygon's total of vertices is odd.
        edge_length: discretise the outlines by this length; their totals are then even.
        grading: largest size over the smallest, 1 to 1000; needs an edge length.

    Raises:
        DomainError: the first polygon that cannot be meshed, with its number when there are several.
    """
    check_sizes(edge_length, grading, source)
    several = len(polygons) > 1
    names = [f"{name}[{i}]" for i in range(len(polygons))] if several else [name] * len(polygons)
    sources = [f"{source}: polygon {i}" for i in range(len(polygons))] if several else [source] * len(polygons)
    if edge_length is None and not (fix_parity and several):
        domains = [
            from_ring_list(rings, where, fix_parity=fix_parity) for rings, where in zip(polygons, sources, strict=True)
        ]
    else:
        # What is wrong with an outline is said in terms of its own vertices, before it gets others.
        checked = [outlines(rings, where) for rings, where in zip(polygons, sources, strict=True)]
        split = discretised(checked, source, edge_length=edge_length, grading=grading) if checked else []
        domains = [finished(rings, where, edge_length) for rings, where in zip(split, sources, strict=True)]
    return [replace(domain, name=named) for domain, named in zip(domains, names, strict=True)]


def finished(rings: Sequence[ArrayLike], source: str, edge_length: float | None) -> Domain:
    """The domain of discretised rings, which a coarse edge length may have let touch."""
    if edge_length is None:
        return from_ring_list(rings, source)
    try:
        return from_ring_list(rings, source)
    except DomainError as error:
        told = str(error).removeprefix(f"{source}: ").partition(";")[0]
        raise DomainError(
            f"{source}: with edge length {edge_length:g} the boundary is too coarse: {told}; use a smaller edge length"
        ) from None
