"""The best of several actions: each is tried on the front, the valid one of the highest merit is kept."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from envs.kernels.jit import inlined, inner
from envs.mdp.action import ACCEPTED
from envs.mdp.front import Front
from envs.mdp.transition import Numbers
from envs.types import Floats, Ints
from freemesh_ray.mesher.agent import Agent, immediate_reward, value
from freemesh_ray.mesher.undo_log import element

#: Vertices tried besides the reference vertex, in the order of their mean angles.
VERTICES = 8


class Candidates(NamedTuple):
    """The best action so far.

    Attributes:
        action: (5,) float64.
        slot: (1,) int64, the vertex it is taken at.
        merit: (1,) float64, -inf when there is none.
        draft: (5,) float64, memory for the next action to be tried.
        slots, keys: (1 + VERTICES,) int64 and float64, memory for the vertices to be tried and their mean angles.
    """

    action: Floats
    slot: Ints
    merit: Floats
    draft: Floats
    slots: Ints
    keys: Floats


def candidates() -> Candidates:
    """No action yet."""
    return Candidates(
        action=np.zeros(5),
        slot=np.zeros(1, dtype=np.int64),
        merit=np.full(1, -np.inf),
        draft=np.zeros(5),
        slots=np.zeros(1 + VERTICES, dtype=np.int64),
        keys=np.zeros(1 + VERTICES),
    )


@inlined
def keep(action: Floats, place: Floats) -> None:
    """Copy an action, (5,), to where it is kept."""
    for i in range(5):
        place[i] = action[i]


@inlined
def begin(candidates: Candidates) -> None:
    """Forget the best action."""
    candidates.merit[0] = -np.inf


@inlined
def found(candidates: Candidates) -> bool:
    """Whether any action was valid."""
    return candidates.merit[0] > -np.inf


@inner
def consider(
    candidates: Candidates, front: Front, slot: int, agent: Agent, judged: bool, type2: bool, numbers: Numbers
) -> None:
    """Try the draft at a slot.

    Args:
        choice: the draft is kept if it is valid and better than the best.
        front: not changed.
        slot: where; with ``judged``, the one the agent looks at.
        agent: whose critics rank the actions.
        judged: whether they do (if there are critics); the immediate reward does otherwise.
        type2: how the draft is to be read.
        numbers: the MDP's numbers.
    """
    cut = element(front, slot, candidates.draft, type2, numbers)
    if cut.rejection != ACCEPTED:
        return
    merit = value(agent, candidates.draft) if judged and agent.judges else immediate_reward(front, cut, numbers)
    if merit > candidates.merit[0]:
        candidates.merit[0], candidates.slot[0] = merit, slot
        keep(candidates.draft, candidates.action)
