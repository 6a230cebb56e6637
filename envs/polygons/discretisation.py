"""Bare outlines become boundary vertices an edge length apart; the total of every polygon is even.

Every corner and every vertex between long segments stays where it is, bit for bit. Segments between them are split
evenly; where an outline is finer than the edge length and turns gently, new vertices are set along it. A stretch that
several polygons share is split once, so that their points are equal number for number.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from envs.polygons.boundary import Boundary, Chain, boundary
from envs.polygons.deviation import bulges
from envs.polygons.outline import CORNER
from envs.polygons.parity import made_even
from envs.polygons.periodic import (
    PeriodicSides,
    Twins,
    common_nodes,
    equal_counts,
    tied,
    twins_of,
    with_equal_sizes,
    with_twins,
)
from envs.polygons.rings import EDGE_LENGTH, HOLE_LEAST, OUTER_LEAST, check_count, extent
from envs.polygons.size_cells import Size
from envs.polygons.sizing import CURVATURE, Sizes, least_pieces, sizes
from envs.types import RELATIVE_TOLERANCE, DomainError, Floats, Ints

Polygon = Sequence[Floats]

#: How much more one vertex on a chain that has a twin distorts, which breaks a symmetry, as the logarithm of a ratio.
TWIN = 0.1

#: No places.
NOWHERE: Floats = np.zeros((0, 2))

#: Chains are twins when their integrals of ds / h differ by less than this share.
ALIKE = 1e-6


def discretised(
    polygons: Sequence[Polygon],
    source: str,
    *,
    edge_length: float | None,
    grading: float = 1.0,
    curvature: float = CURVATURE,
    wanted: Floats | None = None,
    size: Size | None = None,
    keep: Floats = NOWHERE,
    periodic: Sequence[PeriodicSides] = (),
) -> list[list[Floats]]:
    """The rings of polygons with vertices an edge length apart, an even number in each polygon.

    Args:
        polygons: for each its valid rings, each (n, 2), the outer one first.
        source: the name that messages begin with.
        edge_length: length of a segment, in the polygons' units: a side of length l gets round(l / edge_length) >= 1
            segments. None: the given vertices alone, and where a total is odd one more at the middle of a segment,
            the longest one that makes it even.
        grading: largest size over the smallest; above 1 the sizes shrink near short sides, sharp and re-entrant corners
            and in narrow places.
        curvature: segments for a full turn of an arc, 4 to 180; a vertex that turns by more than one of them is a
            corner. No segment is further from the outline than tan(pi / curvature) / 2 of its length.
        wanted: (m, 3) float64, x, y and a size wanted there, from which sizes grow.
        size: what is wanted at places on the outlines, as a function.
        keep: (k, 2) places on the outlines that become vertices and stay: where names begin and end.
        periodic: pairs of sides that get the same points; without an edge length they have them already.

    Returns:
        For each polygon its rings in the same orientation.

    Raises:
        DomainError: more vertices than a boundary may have, or periodic sides of which one has a stretch that the other
            has not.
    """
    twins: list[Twins] = []
    if edge_length is None:
        graph = boundary(polygons, coarse=0.0)
        longest = max(chain.length for chain in graph.chains)
        along = [Sizes.even(chain.length, longest) for chain in graph.chains]
        counts = np.ones(len(graph.chains), dtype=np.int64)
    else:
        # Sizes above the edge length do not occur, so this is the least that is possible.
        perimeter = sum(np.linalg.norm(np.roll(r, -1, axis=0) - r, axis=1).sum() for rings in polygons for r in rings)
        check_count(perimeter / edge_length, source, f"use a larger {EDGE_LENGTH}")
        whole = conforming(polygons, keep)
        # By less, so that a polygon of as many vertices as a full turn has segments keeps them.
        corner = min(CORNER, 2.0 * np.pi / curvature * (1.0 - 1e-9))
        graph = boundary(whole, coarse=edge_length, corner=corner, keep=keep)
        if periodic:
            keep = np.concatenate([keep, common_nodes(graph, periodic)])
            whole = conforming(polygons, keep)
            graph = boundary(whole, coarse=edge_length, corner=corner, keep=keep)
            twins = twins_of(graph, periodic, source)
        along = sizes(
            graph,
            whole,
            source,
            edge_length=edge_length,
            grading=grading,
            curvature=curvature,
            wanted=wanted,
            size=size,
        )
        along = with_equal_sizes(along, twins)
        counts = counts_of(graph, along, source, bulge=0.5 * float(np.tan(np.pi / curvature)))
        equal_counts(counts, twins)
    even_counts(graph, along, counts, source, twins)
    for polygon in graph.rings:
        total = int(sum(counts[use.chain] for ring in polygon for use in ring))
        check_count(total, source, f"use a larger {EDGE_LENGTH}", holes=len(polygon) > 1)
    vertices = [placed(chain, size, int(count)) for chain, size, count in zip(graph.chains, along, counts, strict=True)]
    return [
        [
            np.concatenate([vertices[use.chain][:0:-1] if use.backward else vertices[use.chain][:-1] for use in ring])
            for ring in polygon
        ]
        for polygon in graph.rings
    ]


def conforming(polygons: Sequence[Polygon], keep: Floats = NOWHERE) -> list[list[Floats]]:
    """The polygons with the vertices of their neighbours, and the places to keep, that lie on their segments.

    Each such vertex is one more in the ring, where the neighbour has it, so that the stretch between is shared.
    """
    rings = [ring for polygon in polygons for ring in polygon]
    if len(polygons) > 1 or len(keep):
        points = np.concatenate([*rings, keep])
        tolerance = RELATIVE_TOLERANCE * extent(points)
        sides = np.concatenate([np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings])
        side, point = shapely.STRtree(shapely.points(points)).query(
            shapely.linestrings(sides), predicate="dwithin", distance=tolerance
        )
        a, b, p = sides[side, 0], sides[side, 1], points[point]
        inner = np.minimum(np.linalg.norm(p - a, axis=1), np.linalg.norm(p - b, axis=1)) > tolerance
        side, p, a = side[inner], p[inner], a[inner]
        order = np.lexsort([np.linalg.norm(p - a, axis=1), side])
        bounds = np.cumsum([0, *(len(ring) for ring in rings)])
        for r in range(len(rings)):
            mine = order[(side[order] >= bounds[r]) & (side[order] < bounds[r + 1])]
            if len(mine):
                grown = np.insert(rings[r], side[mine] - bounds[r] + 1, p[mine], axis=0)
                rings[r] = grown[np.any(grown != np.roll(grown, 1, axis=0), axis=1)]
    starts = np.cumsum([0, *(len(polygon) for polygon in polygons)])
    return [rings[a:b] for a, b in zip(starts[:-1], starts[1:], strict=True)]


def counts_of(graph: Boundary, wanted: Sequence[Sizes], source: str, bulge: float = np.inf) -> Ints:
    """(chains,) segments of each chain: its integral of ds / h, rounded, but enough for its shape and for its rings.

    Args:
        graph: the boundary.
        wanted: for each chain.
        source: the name that messages begin with.
        bulge: how far a chain may lie off a segment, over its length.
    """
    measures = np.array([size.measure for size in wanted])
    used = np.bincount([use.chain for polygon in graph.rings for ring in polygon for use in ring])
    check_count(float(measures @ used), source, f"use a larger {EDGE_LENGTH}")
    counts = np.maximum(np.round(measures).astype(np.int64), [least_pieces(chain) for chain in graph.chains])
    for i, (chain, size) in enumerate(zip(graph.chains, wanted, strict=True)):
        # No piece has more than a bend once it is shorter than the given segments, so this ends.
        while chain.turn > 0.0 and bulges(chain.points, chain.along, stations(size, int(counts[i]))).max() > bulge:
            counts[i] += max(1, counts[i] // 8)
            check_count(float(counts @ used), source, f"use a larger {EDGE_LENGTH}")
    for polygon in graph.rings:
        for r, ring in enumerate(polygon):
            chains = [use.chain for use in ring]
            while counts[chains].sum() < (HOLE_LEAST if r else OUTER_LEAST):
                # A bent chain first: a straight one split cannot give a ring of two chains any area.
                counts[max(chains, key=lambda i: (graph.chains[i].turn / counts[i], measures[i] / counts[i]))] += 1
    return counts


def even_counts(
    graph: Boundary, wanted: Sequence[Sizes], counts: Ints, source: str, twins: Sequence[Twins] = ()
) -> None:
    """Add one segment where that distorts the sizes least, in place, until every polygon has an even total.

    Of two chains that are twins both get one, or none.
    """
    users: list[list[int]] = [[] for _ in graph.chains]
    for p, polygon in enumerate(graph.rings):
        for ring in polygon:
            for use in ring:
                users[use.chain].append(p)
    totals = [sum(int(counts[use.chain]) for ring in polygon for use in ring) for polygon in graph.rings]
    odd = [p for p, total in enumerate(totals) if total % 2]
    measures = np.array([size.measure for size in wanted])
    # How far, as a ratio, the segments' size then is from the wanted one.
    costs = np.abs(np.log(measures / (counts + 1))) + TWIN * have_twins(measures)
    chosen = made_even(*tied(users, costs, twins), odd)
    if chosen is None:
        raise DomainError(
            f"{source}: polygon {odd[0]} has {totals[odd[0]]} boundary vertices, an odd number, and shares all of its "
            "boundary with two others; remove copies of polygons"
        )
    counts[list(with_twins(set(chosen), twins))] += 1


def have_twins(measures: Floats) -> np.ndarray:
    """(chains,) bool, which chains are as long, by their integrals of ds / h, as another one."""
    order = np.argsort(measures)
    close = np.diff(measures[order]) <= ALIKE * measures[order][:-1]
    found = np.zeros(len(measures), dtype=np.bool_)
    found[order] = np.append(close, False) | np.append(False, close)
    return found


def stations(size: Sizes, count: int) -> Floats:
    """(count + 1,) distances along a chain from which pieces begin, and its length."""
    return np.concatenate([[0.0], size.split(count), size.at[-1:]])


def placed(chain: Chain, size: Sizes, count: int) -> Floats:
    """(count + 1, 2) vertices along a chain, its ends exactly as given."""
    return np.concatenate([chain.points[:1], chain.at(size.split(count)), chain.points[-1:]])
