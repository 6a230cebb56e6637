"""Sides of elements: which elements have a given edge or face, and as which of their sides."""

from __future__ import annotations

import numpy as np

from envs.types import Ints
from freemesh_ray.export.element_kinds import Kind


def sides_of(elements: Ints, kind: Kind) -> Ints:
    """(m, nodes) -> (m, sides, nodes of a side) int64."""
    return elements[:, kind.side_nodes]


def behind(elements: Ints, kind: Kind, wanted: Ints) -> tuple[Ints, Ints, Ints]:
    """Where given edges or faces are found among the sides of elements.

    Args:
        elements: (m, nodes) int64.
        kind: theirs.
        wanted: (k, 2 or more) edges, or (k, 4 or more) faces; their corners first.

    Returns:
        Each (s,) int64, s <= k, ascending by element: the rows of ``wanted`` that were found, the element that has each
        as a side, and which of its sides that is. Of two elements it is the one that the edge has on its left, or that
        the face points away from, if the side is given in a direction that one of the two has.
    """
    corners = 2 if kind.dimension == 2 else 4
    all_sides = sides_of(elements, kind)[..., :corners].reshape(-1, corners)
    number, _ = numbered(np.concatenate([all_sides, wanted[:, :corners]]))
    keys, sought = number[: len(all_sides)], number[len(all_sides) :]
    order = np.argsort(keys, kind="stable")
    low = np.searchsorted(keys[order], sought, side="left")
    high = np.searchsorted(keys[order], sought, side="right")
    found = np.flatnonzero(high > low)
    first, last = order[low[found]], order[high[found] - 1]
    ways = _ways(all_sides)
    same = ways[first] == _ways(wanted[found, :corners])
    chosen = np.where(same, first, last)
    order = np.argsort(chosen, kind="stable")
    element, side = np.divmod(chosen[order], len(kind.sides))
    return found[order], element, side


def matched(known: Ints, wanted: Ints) -> tuple[Ints, np.ndarray]:
    """Which of the known sides, (k, corners) and all different, each wanted one is that is among them.

    Returns:
        (w,) int64 rows of ``known``, and whether each has the direction of the wanted one, (w,) bool.
    """
    number, _ = numbered(np.concatenate([known, wanted]))
    row_of = np.full(len(number), -1)
    row_of[number[: len(known)]] = np.arange(len(known))
    rows = row_of[number[len(known) :]]
    found = rows >= 0
    return rows[found], _ways(known[rows[found]]) == _ways(wanted[found])


def numbered(corners: Ints) -> tuple[Ints, Ints]:
    """(k, corners) -> (k,) int64, equal numbers for sides of the same corners; and how many have each number."""
    _, number, count = np.unique(np.sort(corners, axis=1), axis=0, return_inverse=True, return_counts=True)
    return number.reshape(-1), count


def _ways(corners: Ints) -> Ints:
    """(k,) int64: which way each side is walked: the node after its least one."""
    least = corners.argmin(axis=1)
    if corners.shape[1] == 2:
        return corners[:, 0]
    return corners[np.arange(len(corners)), (least + 1) % corners.shape[1]]
