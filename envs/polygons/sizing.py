"""Edge lengths along a boundary: even, or growing smoothly away from arcs, corners, gaps and what a user says.

At a place x of a chain the wanted size is h(x) = min(e, a(x), min_i (h_i + k |x - x_i|)): e is the edge length, a(x)
what the arc there allows, and h_i the size of a source at x_i, which may lie on another chain: sizes grow by k along
the boundary and across the domain alike. Between samples, no further apart than half the size there, h is linear.
Vertices split the integral of ds / h evenly: on a slope k that makes each segment exp(k) times as long as the one
before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from envs.polygons.arcs import Arcs, arcs
from envs.polygons.boundary import Boundary, Chain
from envs.polygons.cones import Cones
from envs.polygons.gaps import gaps
from envs.polygons.rings import EDGE_LENGTH, check_count
from envs.polygons.size_cells import Size
from envs.types import DomainError, Floats, Ints

#: A graded segment is about this times as long as its smaller neighbour.
GROWTH = 1.25
SLOPE = float(np.log(GROWTH))

#: At a corner with a smaller inner angle the sizes shrink, in proportion to the angle (radians).
SHARP = np.radians(60.0)

#: At a re-entrant corner of this inner angle and above the sizes shrink all the way; down to pi less and less.
REENTRANT = np.radians(270.0)

#: A segment stands for a turn of the outline by at most this (radians).
MOST_TURN = np.pi / 2

#: Largest ratio of the largest to the smallest size.
MOST_GRADING = 1e3

#: Segments for a full turn of an arc: by default, at least, at most (curves come as chords that turn by two degrees).
CURVATURE, LEAST_CURVATURE, MOST_CURVATURE = 16.0, 4.0, 180.0

#: Sizes between samples are known where these are at most this share of the size apart.
SAMPLED = 0.5


@dataclass(frozen=True)
class Sizes:
    """The wanted sizes along one chain, linear between samples.

    Attributes:
        at: (m,) float64, m >= 2, distances along the chain, from 0 to its length.
        h: (m,) float64, the sizes there.
    """

    at: Floats
    h: Floats

    @classmethod
    def even(cls, length: float, size: float) -> Sizes:
        """The same size all along."""
        return cls(np.array([0.0, length]), np.array([size, size]))

    @cached_property
    def measures(self) -> Floats:
        """(m,) the integral of ds / h from the start to each sample."""
        steps, ratio = np.diff(self.at), np.diff(self.h) / self.h[:-1]
        # log(1 + r) / r, which is 1 for r = 0.
        share = np.where(np.abs(ratio) < 1e-12, 1.0, np.log1p(ratio) / np.where(ratio == 0.0, 1.0, ratio))
        return np.concatenate([[0.0], np.cumsum(steps / self.h[:-1] * share)])

    @property
    def measure(self) -> float:
        """The whole integral: how many segments the chain should have."""
        return float(self.measures[-1])

    def split(self, pieces: int) -> Floats:
        """(pieces - 1,) distances from the start that split the integral evenly."""
        wanted = self.measure * np.arange(1, pieces) / pieces
        i = np.clip(np.searchsorted(self.measures, wanted, side="right") - 1, 0, len(self.at) - 2)
        more = wanted - self.measures[i]
        steps = np.diff(self.at)[i]
        slope = np.diff(self.h)[i] / np.where(steps > 0.0, steps, 1.0)
        grown = slope * more
        share = np.where(np.abs(grown) < 1e-12, 1.0, np.expm1(grown) / np.where(grown == 0.0, 1.0, grown))
        return np.clip(self.at[i] + self.h[i] * more * share, self.at[i], self.at[i + 1])


def least_pieces(chain: Chain) -> int:
    """Segments that a chain needs so that none stands for more than ``MOST_TURN``."""
    return max(1, int(np.ceil(chain.turn / MOST_TURN - 1e-9)))


def sizes(
    graph: Boundary,
    polygons: Sequence[Sequence[Floats]],
    source: str,
    *,
    edge_length: float,
    grading: float = 1.0,
    curvature: float = CURVATURE,
    wanted: Floats | None = None,
    size: Size | None = None,
) -> list[Sizes]:
    """The wanted sizes along each chain of a boundary.

    Args:
        graph: the boundary.
        polygons: what it is of: for each its rings, the outer one first.
        source: the name that messages begin with.
        edge_length: the largest size, in the polygons' units.
        grading: the largest size over the smallest, 1 (even) to ``MOST_GRADING``: above 1 sizes shrink at sharp and
            re-entrant corners, short sides and narrow places.
        curvature: segments for a full turn of an arc.
        wanted: (m, 3) float64, x, y and a size that is wanted there.
        size: what is wanted at places on the boundary.

    Raises:
        DomainError: sizes so small that there would be too many segments.
    """
    curved = [arcs(chain, 2.0 * np.pi / curvature) for chain in graph.chains]
    sources = [_arc_sources(chain, parts, edge_length) for chain, parts in zip(graph.chains, curved, strict=True)]
    if grading > 1.0:
        smallest = edge_length / grading
        featured = np.concatenate([_node_sources(graph, edge_length), gaps(polygons, edge_length, smallest)])
        featured[:, 2] = np.maximum(featured[:, 2], smallest)
        if (reentrant := _reentrant_sources(graph, edge_length, grading)) is not None:
            featured = np.concatenate([featured, reentrant])
        sources.append(featured)
    if wanted is not None:
        sources.append(wanted)
    growing = np.concatenate([np.zeros((0, 3)), *sources])
    return _sampled(graph.chains, curved, Cones(growing[growing[:, 2] < edge_length], SLOPE), edge_length, source, size)


def _arc_sources(chain: Chain, parts: Arcs, edge_length: float) -> Floats:
    """(m, 3) the sizes that arcs ask for, at the ends and the middle of each part that asks for any."""
    small = np.flatnonzero(parts.sizes < edge_length)
    low, high = parts.bounds[small], parts.bounds[small + 1]
    at = np.concatenate([low, 0.5 * (low + high), high])
    return np.column_stack([chain.at(at), np.tile(parts.sizes[small], 3)])


def _node_sources(graph: Boundary, edge_length: float) -> Floats:
    """(m, 3) the sizes of short sides and of sharp corners, at the ends of chains."""
    rows = []
    for chain in graph.chains:
        short = chain.length / least_pieces(chain)
        for node, point in zip(chain.nodes, chain.points[[0, -1]], strict=True):
            corner = edge_length * min(1.0, graph.sharpest[node] / SHARP)
            rows.append((*point, min(edge_length, short, corner)))
    return np.array(rows)


def _reentrant_sources(graph: Boundary, edge_length: float, grading: float) -> Floats | None:
    """(m, 3) the sizes at re-entrant corners: e / r at three right angles and more, up to e at none."""
    share = np.clip((graph.widest - np.pi) / (REENTRANT - np.pi), 0.0, 1.0)
    rows = [
        (*point, edge_length * grading ** -share[node])
        for chain in graph.chains
        for node, point in zip(chain.nodes, chain.points[[0, -1]], strict=True)
        if share[node] > 0.0
    ]
    return np.array(rows) if rows else None


def _sampled(
    chains: Sequence[Chain],
    curved: Sequence[Arcs],
    cones: Cones,
    edge_length: float,
    source: str,
    size: Size | None,
) -> list[Sizes]:
    """The sizes of all chains, sampled as finely as they change."""
    starts = [np.minimum(parts.sizes, edge_length) for parts in curved]
    everywhere = bool(cones.groups) or size is not None
    sampled = [everywhere or bool((own < edge_length).any()) for own in starts]
    owner = np.concatenate([np.full(len(own), i) for i, own in enumerate(starts)])
    low = np.concatenate([parts.bounds[:-1] for parts in curved])
    high = np.concatenate([parts.bounds[1:] for parts in curved])
    most = np.concatenate(starts)
    chosen = np.array(sampled)[owner]
    owner, low, high, most = owner[chosen], low[chosen], high[chosen], most[chosen]
    walk = _Walk(chains)

    def sizes_there(owner: Ints, along: Floats, most: Floats) -> Floats:
        places = walk.places(owner, along)
        return cones(places, most if size is None or not len(places) else np.minimum(most, size(places)))

    at_low, at_high = (sizes_there(owner, at, most) for at in (low, high))
    done: list[tuple[Ints, Floats, Floats, Floats, Floats]] = []
    total = 0
    while len(low):
        kept = high - low <= SAMPLED * np.minimum(at_low, at_high)
        done.append((owner[kept], low[kept], high[kept], at_low[kept], at_high[kept]))
        total += int(kept.sum())
        owner, low, high, most, at_low, at_high = (
            column[~kept] for column in (owner, low, high, most, at_low, at_high)
        )
        # Samples are at most half a size apart and hardly less than a quarter.
        check_count((total + len(low)) * SAMPLED / 4.0, source, f"use a larger {EDGE_LENGTH}, or larger sizes")
        middle = 0.5 * (low + high)
        at_middle = sizes_there(owner, middle, most)
        owner, most = np.tile(owner, 2), np.tile(most, 2)
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
        at_low, at_high = np.concatenate([at_low, at_middle]), np.concatenate([at_middle, at_high])
    found = [Sizes.even(chain.length, edge_length) for chain in chains]
    if done:
        whose, low, high, at_low, at_high = (np.concatenate(column) for column in zip(*done, strict=True))
        order = np.lexsort([low, whose])
        whose, low, high, at_low, at_high = (column[order] for column in (whose, low, high, at_low, at_high))
        for i, rows in zip(
            np.unique(whose), np.split(np.arange(len(whose)), np.flatnonzero(np.diff(whose)) + 1), strict=True
        ):
            if (at_low[rows] == edge_length).all() and (at_high[rows] == edge_length).all():
                continue
            # Two samples at each place: where arcs meet, the size may jump.
            at = np.column_stack([low[rows], high[rows]]).ravel()
            found[i] = Sizes(at, np.column_stack([at_low[rows], at_high[rows]]).ravel())
    return found


class _Walk:
    """Places along many chains at once."""

    def __init__(self, chains: Sequence[Chain]) -> None:
        lengths = np.array([chain.length for chain in chains])
        self.offset = np.concatenate([[0.0], np.cumsum(2.0 * lengths)])[:-1]
        self.along = np.concatenate([chain.along + offset for chain, offset in zip(chains, self.offset, strict=True)])
        self.points = np.concatenate([chain.points for chain in chains])

    def places(self, owner: Ints, at: Floats) -> Floats:
        """(m, 2) places at distances along chains."""
        along = self.offset[owner] + at
        return np.stack([np.interp(along, self.along, self.points[:, axis]) for axis in (0, 1)], axis=1)


def check_sizes(edge_length: float | None, grading: float, curvature: float, source: str, *, sized: bool) -> None:
    """Refuse sizes that are no sizes.

    Args:
        edge_length, grading, curvature: as given.
        source: what the message begins with.
        sized: whether sizes are said in another way, too.

    Raises:
        DomainError: an edge length that is not positive, a grading or a curvature out of its range or without an edge
            length.
    """
    if edge_length is not None and not 0.0 < edge_length < np.inf:
        raise DomainError(
            f"{source}: edge length {edge_length!r}; give {EDGE_LENGTH} a positive number in the polygon's units"
        )
    if not 1.0 <= grading <= MOST_GRADING:
        raise DomainError(
            f"{source}: grading {grading!r}; give --grading (grading= in Python) a ratio from 1 (even) to "
            f"{MOST_GRADING:g}"
        )
    if not LEAST_CURVATURE <= curvature <= MOST_CURVATURE:
        raise DomainError(
            f"{source}: curvature {curvature!r}; give --curvature (curvature= in Python) the segments of a full turn, "
            f"{LEAST_CURVATURE:g} to {MOST_CURVATURE:g}"
        )
    if edge_length is None and grading != 1.0 and not sized:
        raise DomainError(f"{source}: grading {grading:g} without an edge length; give {EDGE_LENGTH} too")
