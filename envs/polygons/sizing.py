"""Edge lengths along a boundary: even, or growing smoothly away from short features and sharp corners.

Along a chain of length L the wanted size is h(s) = min(e, h_a + k s, h_b + k (L - s)), with e the edge length, h_a and
h_b the sizes at its ends and k the growth. Vertices split the integral of ds / h evenly: on a slope that makes each
segment exp(k) times as long as the one before.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from envs.polygons.boundary import Boundary, Chain
from envs.polygons.rings import EDGE_LENGTH
from envs.types import DomainError, Floats

#: A graded segment is about this times as long as its smaller neighbour.
GROWTH = 1.25
SLOPE = float(np.log(GROWTH))

#: At a corner with a smaller inner angle the sizes shrink, in proportion to the angle (radians).
SHARP = np.radians(60.0)

#: A segment stands for a turn of the outline by at most this (radians).
MOST_TURN = np.pi / 2

#: Largest ratio of the largest to the smallest size.
MOST_GRADING = 1e3


@dataclass(frozen=True)
class Sizes:
    """The wanted sizes along one chain.

    Attributes:
        length: L, the chain's length.
        largest: e, the edge length.
        ends: h_a and h_b, at most e, and no further apart than SLOPE * L.
    """

    length: float
    largest: float
    ends: tuple[float, float]

    @property
    def slopes(self) -> tuple[float, float]:
        """Where the slope up from the start ends, and where the slope down to the end begins: 0 <= s1 <= s2 <= L."""
        (a, b), e = self.ends, self.largest
        s1, s2 = (e - a) / SLOPE, self.length - (e - b) / SLOPE
        if s1 > s2:
            s1 = s2 = min(max(0.5 * (self.length + (b - a) / SLOPE), 0.0), self.length)
        return s1, s2

    @property
    def measures(self) -> Floats:
        """(4,) the integral of ds / h from the start to 0, s1, s2 and L."""
        s1, s2 = self.slopes
        pieces = [
            0.0,
            np.log1p(SLOPE * s1 / self.ends[0]) / SLOPE,
            (s2 - s1) / self.largest,
            np.log1p(SLOPE * (self.length - s2) / self.ends[1]) / SLOPE,
        ]
        return np.cumsum(pieces)

    def split(self, pieces: int) -> Floats:
        """(pieces - 1,) distances from the start that split the integral evenly."""
        s1, _ = self.slopes
        total = self.measures
        at = total[3] * np.arange(1, pieces) / pieces
        up = self.ends[0] * np.expm1(SLOPE * np.minimum(at, total[1])) / SLOPE
        level = s1 + (at - total[1]) * self.largest
        down = self.length - self.ends[1] * np.expm1(SLOPE * (total[3] - np.maximum(at, total[2]))) / SLOPE
        return np.where(at < total[1], up, np.where(at <= total[2], level, down))


def least_pieces(chain: Chain) -> int:
    """Segments that a chain needs so that none stands for more than ``MOST_TURN``."""
    return max(1, int(np.ceil(chain.turn / MOST_TURN - 1e-9)))


def sizes(graph: Boundary, edge_length: float, grading: float) -> list[Sizes]:
    """The wanted sizes along each chain of a boundary.

    Args:
        graph: the boundary.
        edge_length: the largest size, in the polygon's units.
        grading: the largest size over the smallest, 1 (even) to ``MOST_GRADING``.
    """
    lengths = [chain.length for chain in graph.chains]
    at = node_sizes(graph, lengths, edge_length, grading)
    return [
        Sizes(length, edge_length, (at[chain.nodes[0]], at[chain.nodes[1]]))
        for chain, length in zip(graph.chains, lengths, strict=True)
    ]


def node_sizes(graph: Boundary, lengths: Sequence[float], edge_length: float, grading: float) -> dict[int, float]:
    """The size at each node: that of the features there, or of those nearby plus the growth along the boundary."""
    smallest = edge_length / grading
    wanted: dict[int, float] = {}
    for chain, length in zip(graph.chains, lengths, strict=True):
        for node in chain.nodes:
            corner = edge_length * min(1.0, graph.sharpest[node] / SHARP)
            feature = min(edge_length, length / least_pieces(chain), corner)
            wanted[node] = min(wanted.get(node, edge_length), max(feature, smallest))
    if grading == 1.0:
        return wanted
    neighbours: dict[int, list[tuple[float, int]]] = {}
    for chain, length in zip(graph.chains, lengths, strict=True):
        a, b = chain.nodes
        neighbours.setdefault(a, []).append((SLOPE * length, b))
        neighbours.setdefault(b, []).append((SLOPE * length, a))
    queue = [(size, node) for node, size in wanted.items()]
    heapq.heapify(queue)
    while queue:
        size, node = heapq.heappop(queue)
        if size > wanted[node]:
            continue
        for growth, other in neighbours[node]:
            if size + growth < wanted[other]:
                wanted[other] = size + growth
                heapq.heappush(queue, (size + growth, other))
    return wanted


def check_sizes(edge_length: float | None, grading: float, source: str) -> None:
    """Refuse sizes that are no sizes.

    Raises:
        DomainError: an edge length that is not positive, a grading out of its range or without an edge length.
    """
    if edge_length is not None and not 0.0 < edge_length < np.inf:
        raise DomainError(
            f"{source}: edge length {edge_length!r}; give --edge-length a positive number in the polygon's units"
        )
    if not 1.0 <= grading <= MOST_GRADING:
        raise DomainError(f"{source}: grading {grading!r}; give --grading a ratio from 1 (even) to {MOST_GRADING:g}")
    if edge_length is None and grading != 1.0:
        raise DomainError(f"{source}: grading {grading:g} without an edge length; give {EDGE_LENGTH} too")
