"""The end of a mesh: a depth-first search over the elements that can fill a small ring.

The best filling is the one with the highest sum of the least and the mean eta_e of its elements. A branch is left
when no continuation can be better than the best filling found.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from envs.kernels.jit import inlined, inner
from envs.mdp.action import ACCEPTED, decode_type
from envs.mdp.front import RING, Front, reference_slot
from envs.mdp.reward import eta_b, eta_e
from envs.mdp.transition import Numbers, ring_quality
from envs.types import Floats, Ints
from freemesh_ray.mesher.agent import Agent, look, mean_action
from freemesh_ray.mesher.candidates import keep
from freemesh_ray.mesher.ideal_elements import DISTANCES, shape
from freemesh_ray.mesher.undo_log import LOOKAHEAD, UndoLog, cut_action, cut_off, element, take_back

#: Rings of up to this many vertices are searched.
RING_LIMIT = 10
#: Elements before the last one, actions pursued in one state, states looked at.
DEPTH, BRANCHES, STATES = 8, 5, 80


class Tree(NamedTuple):
    """Memory of the search; level d holds the actions pursued after d elements, best first.

    Attributes:
        action: (DEPTH, BRANCHES, 5) float64, read with type 2.
        slot: (DEPTH, BRANCHES) int64.
        merit: (DEPTH, BRANCHES) float64.
        width, tried: (DEPTH,) int64, actions on a level, and how many of them have been pursued.
        least, total: (DEPTH + 1,) float64, least and sum of eta_e of the elements above a level.
        best_action, best_slot: (DEPTH, 5) float64 and (DEPTH,) int64, the best filling.
        draft: (5,) float64.
    """

    action: Floats
    slot: Ints
    merit: Floats
    width: Ints
    tried: Ints
    least: Floats
    total: Floats
    best_action: Floats
    best_slot: Ints
    draft: Floats


def tree() -> Tree:
    """Memory for a search."""
    return Tree(
        action=np.zeros((DEPTH, BRANCHES, 5)),
        slot=np.zeros((DEPTH, BRANCHES), dtype=np.int64),
        merit=np.zeros((DEPTH, BRANCHES)),
        width=np.zeros(DEPTH, dtype=np.int64),
        tried=np.zeros(DEPTH, dtype=np.int64),
        least=np.ones(DEPTH + 1),
        total=np.zeros(DEPTH + 1),
        best_action=np.zeros((DEPTH, 5)),
        best_slot=np.zeros(DEPTH, dtype=np.int64),
        draft=np.zeros(5),
    )


@inner
def propose(tree: Tree, level: int, front: Front, slot: int, numbers: Numbers) -> None:
    """Put the draft at a slot among the level's actions if it is valid and one of the best."""
    cut = element(front, slot, tree.draft, True, numbers)
    if cut.rejection != ACCEPTED:
        return
    merit = eta_e(cut) + eta_b(cut, numbers.M_angle)
    at = tree.width[level]
    if at == BRANCHES:
        at -= 1
        if merit <= tree.merit[level, at]:
            return
    else:
        tree.width[level] += 1
    while at > 0 and tree.merit[level, at - 1] < merit:
        tree.merit[level, at], tree.slot[level, at] = tree.merit[level, at - 1], tree.slot[level, at - 1]
        keep(tree.action[level, at - 1], tree.action[level, at])
        at -= 1
    tree.merit[level, at], tree.slot[level, at] = merit, slot
    keep(tree.draft, tree.action[level, at])


@inner
def expand(tree: Tree, level: int, front: Front, agent: Agent, policy_type2: bool, numbers: Numbers) -> None:
    """Fill a level with the best actions on the front as it is: the policy's, and shapes at every vertex."""
    tree.width[level] = tree.tried[level] = 0
    slot = reference_slot(front)
    look(agent, front, slot, numbers)
    mean_action(agent, tree.draft)
    if not policy_type2:
        # The thirds of the first entry, on the quarters that type 2 leaves to the same types.
        tree.draft[0] = -1.0 + 0.5 * (decode_type(tree.draft[0], False) + 0.5)
    propose(tree, level, front, slot, numbers)
    for _ in range(front.counts[RING]):
        # To the left of a vertex lies what is to the right of the next but one.
        for index in range(2 + len(DISTANCES)):
            if index != 1 and shape(front, slot, index, numbers, tree.draft):
                propose(tree, level, front, slot, numbers)
        slot = front.nxt[slot]


@inlined
def rating(least: float, total: float, count: int) -> float:
    """Least plus mean eta_e."""
    return least + total / count


@inner
def fill(tree: Tree, front: Front, undo_log: UndoLog, agent: Agent, policy_type2: bool, numbers: Numbers) -> bool:
    """Mesh the ring up to its last four vertices as well as can be found.

    Returns:
        Whether a filling was found; the front is unchanged otherwise.
    """
    best, length = -np.inf, 0
    level, states = 0, 1
    expand(tree, 0, front, agent, policy_type2, numbers)
    while level >= 0:
        if tree.tried[level] == tree.width[level]:
            level -= 1
            if level >= 0:
                take_back(front, undo_log, 1, numbers.n_rv)
            continue
        branch = tree.tried[level]
        tree.tried[level] += 1
        slot, action = tree.slot[level, branch], tree.action[level, branch]
        cut = element(front, slot, action, True, numbers)
        quality = eta_e(cut)
        least, total = min(tree.least[level], quality), tree.total[level] + quality
        # All that is still to come could be perfect squares, the least as many as type 0 needs.
        missing = (front.counts[RING] + 4 - 2 * cut.k - 2) // 2
        if rating(least, total + missing, level + 1 + missing) <= best:
            continue
        cut_off(front, undo_log, cut, decode_type(action[0], True), LOOKAHEAD, numbers.n_rv)
        if front.counts[RING] == 4:
            last = ring_quality(front)
            found = rating(min(least, last), total + last, level + 2)
            if found > best:
                best, length = found, level + 1
                for i in range(length):
                    keep(tree.action[i, tree.tried[i] - 1], tree.best_action[i])
                    tree.best_slot[i] = tree.slot[i, tree.tried[i] - 1]
        elif level + 1 < DEPTH and states < STATES:
            level += 1
            states += 1
            tree.least[level], tree.total[level] = least, total
            expand(tree, level, front, agent, policy_type2, numbers)
            continue
        take_back(front, undo_log, 1, numbers.n_rv)
    for i in range(length):
        cut_action(front, undo_log, tree.best_slot[i], tree.best_action[i], True, LOOKAHEAD, numbers)
    return length > 0
