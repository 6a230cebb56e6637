"""What was cut, in order, so that it can be taken back: every element cut by the mesher goes through here."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from envs.kernels.jit import inner
from envs.mdp.action import CHAIN_EDGES, Cut, decode, decode_type
from envs.mdp.front import AREA, ELEMENTS, Front, retreat
from envs.mdp.transition import Numbers, take
from envs.types import Floats

#: Where an element came from; see ``engine``.
POLICY, SAMPLED, NEXT, WIDE, LOOKAHEAD, LAST = range(6)
SOURCES = ("policy", "sampled", "next vertex", "wide", "look-ahead", "last")


class UndoLog(NamedTuple):
    """A line for each element, in the order of ``Front.quads``.

    Attributes:
        start: (E,) int64, first slot of its chain.
        action_type: (E,) int8, index into action.ACTION_TYPES.
        source: (E,) int8, index into SOURCES.
        area: (E,) float64, the area that was left before it.
    """

    start: np.ndarray
    action_type: np.ndarray
    source: np.ndarray
    area: Floats


def undo_log(elements: int) -> UndoLog:
    """Room for ``elements`` lines."""
    return UndoLog(
        start=np.zeros(elements, dtype=np.int64),
        action_type=np.zeros(elements, dtype=np.int8),
        source=np.zeros(elements, dtype=np.int8),
        area=np.zeros(elements),
    )


@inner
def element(front: Front, slot: int, action: Floats, type2: bool, numbers: Numbers) -> Cut:
    """The element that an action asks for at a slot."""
    return decode(front, slot, action, numbers.n, numbers.alpha, numbers.sized, type2)


@inner
def cut_off(front: Front, undo_log: UndoLog, cut: Cut, action_type: int, source: int, n_rv: int) -> None:
    """Cut an accepted element off the front and note it."""
    line = front.counts[ELEMENTS]
    undo_log.start[line], undo_log.action_type[line], undo_log.source[line] = cut.start, action_type, source
    undo_log.area[line] = front.measure[AREA]
    take(front, cut, n_rv)


@inner
def cut_action(
    front: Front, undo_log: UndoLog, slot: int, action: Floats, type2: bool, source: int, numbers: Numbers
) -> None:
    """Cut the element that a valid action asks for at a slot off the front."""
    cut = element(front, slot, action, type2, numbers)
    cut_off(front, undo_log, cut, decode_type(action[0], type2), source, numbers.n_rv)


@inner
def take_back(front: Front, undo_log: UndoLog, elements: int, n_rv: int) -> None:
    """Take the last elements back, exactly; at most as many as there are."""
    for _ in range(min(elements, front.counts[ELEMENTS])):
        line = front.counts[ELEMENTS] - 1
        retreat(front, undo_log.start[line], CHAIN_EDGES[undo_log.action_type[line]], undo_log.area[line], n_rv)
