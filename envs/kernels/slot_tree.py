r"""Two complete binary trees over the slots of a front: a minimum, and bounding boxes of the front's edges.

Both lie in heap order: node 1 is the root, node k has children 2k and 2k + 1, slot i is leaf C + i. A change of one
slot costs log2(C) node updates; a query visits the nodes it cannot prune, without a stack:

            1              after node k and all below it comes ``following(k)``: the right sibling of the nearest
          /   \            ancestor (k included) that is a left child; 0 when the walk is over.
         2     3
        / \   / \
       4   5 6   7         following(5) = 3, following(4) = 5, following(7) = 0
"""

from __future__ import annotations

import numpy as np

from envs.kernels.jit import inlined, inner
from envs.types import Floats, Ints


@inlined
def following(node: int) -> int:
    """The next node of a depth-first walk that does not descend below ``node``; 0 at the end."""
    while node & 1:
        node >>= 1
    return node + 1 if node else 0


@inlined
def set_key(key: Floats, slot: int, value: float) -> None:
    """Give a slot its key; ``key``: (2 C,) float64, a tree of minima."""
    node = (len(key) >> 1) + slot
    key[node] = value
    node >>= 1
    while node:
        least = min(key[2 * node], key[2 * node + 1])
        if key[node] == least:
            break
        key[node] = least
        node >>= 1


@inlined
def least_slot(key: Floats) -> int:
    """The slot of the least key, the first of equals."""
    capacity = len(key) >> 1
    node = 1
    while node < capacity:
        node = 2 * node if key[2 * node] <= key[2 * node + 1] else 2 * node + 1
    return node - capacity


@inner
def least_slots(key: Floats, slots: Ints, keys: Floats) -> int:
    """Write the slots of the least keys, in order, and these keys, into ``slots`` and ``keys``.

    Args:
        key: changed while this runs.
        slots: (m,) int64.
        keys: (m,) float64.

    Returns:
        How many there are, at most m.
    """
    count = 0
    while count < len(slots) and key[1] < np.inf:
        slot = least_slot(key)
        slots[count], keys[count] = slot, key[1]
        set_key(key, slot, np.inf)
        count += 1
    for i in range(count):
        set_key(key, slots[i], keys[i])
    return count


@inlined
def set_box(box: Floats, slot: int, low_x: float, low_y: float, high_x: float, high_y: float) -> None:
    """Give a slot its edge's box; ``box``: (2 C, 4) float64 of [low x, low y, high x, high y]."""
    node = (len(box) >> 1) + slot
    box[node, 0], box[node, 1], box[node, 2], box[node, 3] = low_x, low_y, high_x, high_y
    node >>= 1
    while node:
        left, right = 2 * node, 2 * node + 1
        x0, y0 = min(box[left, 0], box[right, 0]), min(box[left, 1], box[right, 1])
        x1, y1 = max(box[left, 2], box[right, 2]), max(box[left, 3], box[right, 3])
        if box[node, 0] == x0 and box[node, 1] == y0 and box[node, 2] == x1 and box[node, 3] == y1:
            break
        box[node, 0], box[node, 1], box[node, 2], box[node, 3] = x0, y0, x1, y1
        node >>= 1


@inlined
def clear_box(box: Floats, slot: int) -> None:
    """Take a slot out of every query: an inside-out box meets nothing."""
    set_box(box, slot, np.inf, np.inf, -np.inf, -np.inf)


@inlined
def box_meets(box: Floats, node: int, low_x: float, low_y: float, high_x: float, high_y: float) -> bool:
    """Whether a node's box and the given one share a point."""
    return box[node, 0] <= high_x and box[node, 2] >= low_x and box[node, 1] <= high_y and box[node, 3] >= low_y


@inlined
def box_distance2(box: Floats, node: int, x: float, y: float) -> float:
    """Squared distance from (x, y) to a node's box, infinite for an empty one."""
    dx = max(0.0, max(box[node, 0] - x, x - box[node, 2]))
    dy = max(0.0, max(box[node, 1] - y, y - box[node, 3]))
    return dx * dx + dy * dy


@inner
def build(key: Floats, box: Floats) -> None:
    """Fill the inner nodes of both trees from their leaves."""
    for node in range((len(key) >> 1) - 1, 0, -1):
        left, right = 2 * node, 2 * node + 1
        key[node] = min(key[left], key[right])
        box[node, 0], box[node, 1] = min(box[left, 0], box[right, 0]), min(box[left, 1], box[right, 1])
        box[node, 2], box[node, 3] = max(box[left, 2], box[right, 2]), max(box[left, 3], box[right, 3])
