"""The boundaries of several polygons as one graph: nodes that stay, and the chains between them.

::

    o----------o----------o        o   node: a corner, a coarse outline's vertex, or where boundaries part
    |          |          |
    |    A     c    B     |        c   one chain, used by A upwards and by B downwards: whatever is put on it,
    |          |          |            both have the same points there
    o----------o----------o
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from envs.polygons.outline import CORNER
from envs.polygons.turning import bends, turns
from envs.types import Floats, Ints


@dataclass(frozen=True)
class Chain:
    """A stretch of boundary between two nodes, which may be one.

    Attributes:
        points: (k, 2) float64, k >= 2, the given vertices from the first node to the last.
        nodes: the first and the last node.
        turn: how far its heading swings, radians: largest less smallest heading; 0 when straight.
    """

    points: Floats
    nodes: tuple[int, int]
    turn: float

    @cached_property
    def along(self) -> Floats:
        """(k,) distance of each point from the first one, along the chain."""
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))])

    @property
    def length(self) -> float:
        """Length along the chain."""
        return float(self.along[-1])

    def at(self, distances: Floats) -> Floats:
        """(m, 2) places at (m,) distances from the first point along the chain."""
        return np.stack([np.interp(distances, self.along, self.points[:, axis]) for axis in (0, 1)], axis=1)


@dataclass(frozen=True)
class Use:
    """A chain as part of a ring: its index, and whether the ring walks it from its last node to its first."""

    chain: int
    backward: bool


@dataclass(frozen=True)
class Boundary:
    """Rings of several polygons over common chains.

    Attributes:
        chains: each stretch once, however many rings it is part of.
        rings: for each polygon, for each of its rings, the chains in order.
        sharpest: (nodes,) smallest inner angle at each vertex, radians.
        widest: (nodes,) largest inner angle at each vertex, radians.
    """

    chains: list[Chain]
    rings: list[list[list[Use]]]
    sharpest: Floats
    widest: Floats


def boundary(
    polygons: Sequence[Sequence[Floats]], coarse: float, corner: float = CORNER, keep: Floats | None = None
) -> Boundary:
    """The graph of polygons.

    A vertex stays a node where the outline turns by more than ``corner``, where one of its segments is at least
    ``coarse`` long, or where more or fewer than two segments meet. A ring without any keeps its first vertex.

    Args:
        polygons: for each its rings, each (n, 2), the outer one first; shared vertices are equal number for number.
        coarse: the length from which a segment is a side in its own right; 0 keeps every vertex.
        corner: the turn from which a vertex is a corner, radians.
        keep: (k, 2) vertices that stay nodes, equal number for number.
    """
    rings = [ring for polygon in polygons for ring in polygon]
    outer = np.array([r == 0 for polygon in polygons for r in range(len(polygon))])
    everything = np.concatenate(rings)
    _, ids = np.unique(everything[:, 0] + 1j * everything[:, 1], return_inverse=True)
    walks = np.split(ids.astype(np.int64), np.cumsum([len(ring) for ring in rings])[:-1])
    stays = degree(walks, int(ids.max()) + 1) != 2
    if keep is not None and len(keep):
        stays[ids[np.isin(everything[:, 0] + 1j * everything[:, 1], keep[:, 0] + 1j * keep[:, 1])]] = True
    sharpest, widest = np.full(len(stays), 2 * np.pi), np.zeros(len(stays))
    for ring, walk, is_outer in zip(rings, walks, outer, strict=True):
        turn, length = turns(ring), np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
        stays[walk[(np.abs(turn) > corner) | (np.maximum(length, np.roll(length, 1)) >= coarse)]] = True
        # Walked with the inside to the left, a turn to the left leaves less than pi inside.
        inside = np.pi - turn * (1.0 if (turn.sum() > 0) == is_outer else -1.0)
        np.minimum.at(sharpest, walk, inside)
        np.maximum.at(widest, walk, inside)
    chains: list[Chain] = []
    known: dict[tuple[int, int, int], int] = {}
    used = [uses(ring, walk, stays, chains, known) for ring, walk in zip(rings, walks, strict=True)]
    bounds = np.cumsum([0, *(len(polygon) for polygon in polygons)])
    return Boundary(chains, [used[a:b] for a, b in zip(bounds[:-1], bounds[1:], strict=True)], sharpest, widest)


def degree(walks: Sequence[Ints], nodes: int) -> Ints:
    """(nodes,) how many different segments meet at each node."""
    ahead = np.concatenate([np.roll(walk, -1) for walk in walks])
    here = np.concatenate(walks)
    segments = np.unique(np.minimum(here, ahead) * nodes + np.maximum(here, ahead))
    return np.bincount(np.concatenate([segments // nodes, segments % nodes]), minlength=nodes)


def uses(
    ring: Floats, walk: Ints, stays: np.ndarray, chains: list[Chain], known: dict[tuple[int, int, int], int]
) -> list[Use]:
    """The chains of a ring in order, new ones appended to those known."""
    if not stays[walk].any():
        stays[walk[0]] = True
    starts = np.flatnonzero(stays[walk])
    walk, ring = np.roll(walk, -starts[0]), np.roll(ring, -starts[0], axis=0)
    walk, ring = np.append(walk, walk[0]), np.concatenate([ring, ring[:1]])
    bounds = np.append(starts - starts[0], len(walk) - 1).tolist()
    used = []
    for a, b in zip(bounds[:-1], bounds[1:], strict=True):
        # From the lower end to the higher one, or of a closed chain towards its lower neighbour: the same for all.
        first, second, before, last = (int(walk[i]) for i in (a, a + 1, b - 1, b))
        backward = (last, before) < (first, second)
        key = (last, before, first) if backward else (first, second, last)
        if key not in known:
            known[key] = len(chains)
            points = ring[a : b + 1][:: -1 if backward else 1]
            chains.append(Chain(points, (key[0], key[2]), swing(points)))
        used.append(Use(known[key], backward))
    return used


def swing(points: Floats) -> float:
    """Largest less smallest heading along (k, 2) points, radians."""
    heading = np.cumsum(bends(points))
    return float(heading.max(initial=0.0) - heading.min(initial=0.0))
