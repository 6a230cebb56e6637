"""Ends of curves that nearly meet: joined where that is asked for, told with what would join them where not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from envs.polygons.rings import place
from envs.readers.piece_network import Network, Splits, clusters, split, touching
from envs.types import Floats, Ints

#: What messages call the option.
JOIN = "--join {} (join={} in Python)"

#: Nodes near each open end that are looked at.
NEIGHBOURS = 8

#: A gap is at most this share of the loop that it would close, ...
SHARE = 0.02

#: ... and one below this share is a slip of the pen, whatever else is closed.
SLIP = 1e-3

#: Loops that gaps would close are measured so often at most.
MOST_LOOPS = 50


@dataclass(frozen=True)
class Gap:
    """Two open ends, or an open end and a node, whose joining would close a loop.

    Attributes:
        ends: (2, 2) where they are.
        width: their distance, the largest of those that the loop needs joined.
        share: the width over the loop's length.
        outline: whether both ends are open.
    """

    ends: Floats
    width: float
    share: float
    outline: bool

    @property
    def told(self) -> tuple[str, str]:
        """The two places as messages show them."""
        return place(self.ends[0]), place(self.ends[1])


def option(width: float) -> str:
    """The option that joins ends so far apart: the next of 1, 2, 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(width))
    least = next(m for m in (1, 2, 5, 10, 20) if m * power >= 1.001 * width) * power
    return JOIN.format(f"{least:.0e}".replace("e-0", "e-").replace("e+0", "e"), f"{least:g}")


def joined(network: Network, distance: float) -> tuple[Network, list[float]]:
    """The network with open ends joined that lie within a distance of others, or else of a piece, and how far each was.

    An end meets one other, the nearest first; what is shorter than three times their distance is not joined to itself.
    """
    open_ends = np.flatnonzero(network.meeting == 1)
    if not len(open_ends):
        return network, []
    widths, used, pairs = list[float](), set[int](), list[tuple[int, int]]()
    lengths = piece_lengths(network)
    own = {node: piece for piece, ends in enumerate(network.ends.tolist()) for node in ends}
    for a, b, width in near_nodes(network, open_ends, distance):
        both_open = network.meeting[b] == 1
        itself = own[a] == own[b] and lengths[own[a]] < 3.0 * width
        if a in used or (both_open and b in used) or itself:
            continue
        used |= {a, b} if both_open else {a}
        pairs.append((a, b))
        widths.append(width)
    if pairs:
        # The node that more pieces meet at stays where it is.
        label, first = clusters(network.places, 0.0, network.source, np.array(pairs))
        steady = np.lexsort([np.arange(len(label)), -network.meeting, label])
        first = steady[np.searchsorted(label[steady], np.arange(len(first)))]
        network = Network(network.pieces, label[network.ends], network.places[first], network.tolerance, network.source)
        network = Network(network.settled(), network.ends, network.places, network.tolerance, network.source)
    open_ends = np.flatnonzero(network.meeting == 1)
    if len(open_ends):
        splits, off = touching(network, open_ends, distance)
        order = np.lexsort([off, splits.node])
        order = order[np.append(True, np.diff(splits.node[order]) != 0)[: len(order)]]
        network = split(network, Splits(splits.piece[order], splits.parameter[order], splits.node[order]))
        widths += off[order].tolist()
    return network, [width for width in widths if width > network.tolerance]


def near_nodes(network: Network, open_ends: Ints, distance: float) -> Iterator[tuple[int, int, float]]:
    """Pairs of an open end and another node within a distance, the nearest first: two nodes and how far they are."""
    alive = np.flatnonzero(network.meeting > 0)
    count = min(NEIGHBOURS, len(alive))
    off, found = cKDTree(network.places[alive]).query(
        network.places[open_ends], k=count, distance_upper_bound=distance * (1.0 + 1e-9)
    )
    off, found = off.reshape(len(open_ends), count), found.reshape(len(open_ends), count)
    row, column = np.nonzero(np.isfinite(off))
    a, b, width = open_ends[row], alive[found[row, column]], off[row, column]
    once = (a != b) & ~((network.meeting[b] == 1) & (a > b))
    for k in np.argsort(width[once], kind="stable").tolist():
        yield int(a[once][k]), int(b[once][k]), float(width[once][k])


def gaps(network: Network, reach: float) -> Iterator[Gap]:
    """Gaps whose joining would close loops, the smallest first, each of at most ``SHARE`` of its loop.

    Args:
        reach: the widest.
    """
    open_ends = np.flatnonzero(network.meeting == 1)
    if not len(open_ends):
        return
    n = len(network.places)
    lengths = piece_lengths(network)
    rows, columns, weights = network.ends[:, 0].tolist(), network.ends[:, 1].tolist(), lengths.tolist()
    parent = connected_components(coo_array((lengths + 1.0, (rows, columns)), shape=(n, n)), directed=False)[1].tolist()
    root = dict(enumerate(parent))
    loops = 0
    for a, b, width in near_nodes(network, open_ends, reach):
        one, other = find(root, parent[a]), find(root, parent[b])
        if one == other:
            loops += 1
            graph = coo_array((np.maximum(weights, 1e-300), (rows, columns)), shape=(n, n)).tocsr()
            around = float(dijkstra(graph, directed=False, indices=a)[b])
            if around > 0.0 and width <= SHARE * around:
                yield Gap(network.places[[a, b]], width, width / around, bool(network.meeting[b] == 1))
            if loops == MOST_LOOPS:
                return
        else:
            root[one] = other
        rows.append(a)
        columns.append(b)
        weights.append(width)


def find(root: dict[int, int], label: int) -> int:
    """The label that a label has become, paths halved on the way."""
    while root[label] != label:
        root[label] = root[root[label]]
        label = root[label]
    return label


def piece_lengths(network: Network) -> Floats:
    """(p,) about how long the pieces are."""
    return np.array([np.linalg.norm(np.diff(piece.rough, axis=0), axis=1).sum() for piece in network.pieces])
