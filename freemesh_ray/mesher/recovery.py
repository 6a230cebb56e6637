"""What is tried where the policy's mean action is invalid: its draws, well-shaped elements, anything that is valid."""

from __future__ import annotations

import math

import numpy as np

from envs.kernels import slot_tree
from envs.kernels.jit import inner
from envs.mdp.front import Front, interior_angle
from envs.mdp.transition import Numbers
from freemesh_ray.mesher.agent import Agent, look, mean_action, sampled_action
from freemesh_ray.mesher.candidates import Candidates, begin, consider, found
from freemesh_ray.mesher.ideal_elements import HEIGHTS, SHAPES, shape
from freemesh_ray.mesher.undo_log import NEXT, SAMPLED, WIDE

#: Draws from the policy at a vertex, and uniform draws at a vertex.
SAMPLES, DRAWS = 16, 32
#: Interior angle from which an element with two new vertices is fit for the reference vertex, in radians: a smooth
#: boundary can be begun with no other.
FLAT = 2.0 * math.pi / 3.0
#: Nothing found.
STUCK = -1


@inner
def sample(
    candidates: Candidates, front: Front, slot: int, agent: Agent, draws: int, type2: bool, numbers: Numbers,
    random: np.random.Generator,
) -> None:  # fmt: skip
    """Consider draws from the policy at the slot that the agent looks at."""
    for _ in range(draws):
        sampled_action(agent, random, candidates.draft)
        consider(candidates, front, slot, agent, True, type2, numbers)


@inner
def scatter(
    candidates: Candidates, front: Front, slot: int, agent: Agent, draws: int, two: bool, numbers: Numbers,
    random: np.random.Generator,
) -> None:  # fmt: skip
    """Consider uniform draws of all actions at a slot, ``two``: those with two new vertices among them."""
    share = 1.0 if two else 0.75
    for _ in range(draws):
        for entry in range(5):
            candidates.draft[entry] = 2.0 * random.random() - 1.0
        candidates.draft[0] = share * (candidates.draft[0] + 1.0) - 1.0
        consider(candidates, front, slot, agent, False, True, numbers)


@inner
def any_shape(
    candidates: Candidates,
    front: Front,
    slot: int,
    agent: Agent,
    two: bool,
    numbers: Numbers,
    random: np.random.Generator,
) -> None:
    """Consider well-shaped elements and uniform draws at a slot, ``two``: those with two new vertices among them."""
    for index in range(SHAPES if two else SHAPES - len(HEIGHTS)):
        if shape(front, slot, index, numbers, candidates.draft):
            consider(candidates, front, slot, agent, False, True, numbers)
    scatter(candidates, front, slot, agent, DRAWS, two, numbers, random)


@inner
def here(
    candidates: Candidates,
    front: Front,
    slot: int,
    agent: Agent,
    type2: bool,
    numbers: Numbers,
    random: np.random.Generator,
) -> int:
    """Choose an action at the reference vertex, whose mean action is invalid.

    Args:
        choice: the chosen action, to be read with type 2 if WIDE is returned, else as the policy's.
        front: not changed.
        slot: the reference vertex.
        agent: looks at it.
        type2: whether the policy's own actions have type 2.
        numbers: the MDP's numbers.
        random: of the draws.

    Returns:
        SAMPLED, WIDE or STUCK.
    """
    begin(candidates)
    sample(candidates, front, slot, agent, SAMPLES, type2, numbers, random)
    if found(candidates):
        return SAMPLED
    any_shape(candidates, front, slot, agent, interior_angle(front, slot) >= FLAT, numbers, random)
    return WIDE if found(candidates) else STUCK


@inner
def elsewhere(
    candidates: Candidates, front: Front, agent: Agent, type2: bool, numbers: Numbers, random: np.random.Generator
) -> int:
    """Choose an action at another vertex, or any shape at any vertex tried; as ``here``.

    Returns:
        NEXT, WIDE or STUCK.
    """
    begin(candidates)
    slots = candidates.slots
    count = slot_tree.least_slots(front.key, slots, candidates.keys)
    for i in range(1, count):
        look(agent, front, slots[i], numbers)
        mean_action(agent, candidates.draft)
        consider(candidates, front, slots[i], agent, True, type2, numbers)
        if not found(candidates):
            sample(candidates, front, slots[i], agent, SAMPLES, type2, numbers, random)
        if found(candidates):
            return NEXT
    for i in range(count):
        any_shape(candidates, front, slots[i], agent, True, numbers, random)
        if found(candidates):
            return WIDE
    return STUCK
