"""A mesh in one compiled loop: the agent looks at the reference vertex, acts, the front advances.

Remedies where the mean action is invalid, in this order:

    recovery     the policy's own draws; well-shaped elements and uniform draws at the reference vertex
    backtracking       what blocks the vertex is taken back and cut another way, more of it each time that does not help
    recovery     the policy, then any shape, at other vertices, for a while
    lookahead    fills the last ring, always
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from envs.kernels.jit import compiled
from envs.mdp import front as fr
from envs.mdp.action import ACCEPTED, ACTION_TYPES, decode_type
from envs.mdp.front import ELEMENTS, RING, Front, close, reference_slot
from envs.mdp.transition import Numbers, numbers
from envs.mesh import Mesh
from envs.types import NO_WISHES, Domain, Floats, Ints, WantedSizes
from freemesh_ray.mesher.agent import Agent, agent, look, mean_action
from freemesh_ray.mesher.backtracking import elements_back, is_near, mark
from freemesh_ray.mesher.candidates import Candidates, begin, candidates, found
from freemesh_ray.mesher.lookahead import DEPTH, RING_LIMIT, Tree, fill, tree
from freemesh_ray.mesher.recovery import STUCK, elsewhere, here, sample, scatter
from freemesh_ray.mesher.undo_log import (
    LAST,
    POLICY,
    SAMPLED,
    SOURCES,
    WIDE,
    UndoLog,
    cut_action,
    cut_off,
    element,
    take_back,
    undo_log,
)
from freemesh_ray.policies.policy import Policy

#: Backtracks that take back the same number of elements near the stuck vertex; the numbers, 1, 2, 4, ..; and
#: backtracks without progress after which the engine gives up.
TRIES, DOUBLINGS, PATIENCE = 4, 7, 40
#: Draws, of which the best is taken, at a vertex on a backtrack.
DRAWS = 4
#: Elements for which other vertices than the reference vertex are tried when all backtracks have failed.
WANDER = 32
#: Elements taken back in all beyond which the engine gives up: a number, and a share of the elements.
SLACK, SHARE = 10_000, 1.0
#: Entries of a tally: backtracks, and elements taken back in all.
BACKTRACKS, TAKEN_BACK = range(2)


@dataclass(frozen=True)
class Grown:
    """What the engine made of a domain.

    Attributes:
        mesh: complete or not.
        ring: (r,) int64, mesh vertices of the ring that is left, counter-clockwise; empty when complete.
        action_types: elements of each type, by name (action.ACTION_TYPES); the last one has none.
        sources: elements by where they came from, by name (undo_log.SOURCES).
        backtracks: times that elements were taken back.
        taken_back: elements taken back in all.
    """

    mesh: Mesh
    ring: Ints
    action_types: dict[str, int]
    sources: dict[str, int]
    backtracks: int
    taken_back: int


@compiled
def run(
    front: Front, undo_log: UndoLog, agent: Agent, candidates: Candidates, tree: Tree, numbers: Numbers, cap: int,
    exploration: float, patience: int, random: np.random.Generator, tally: Ints, place: Floats,
) -> None:  # fmt: skip
    """Mesh a front until it is closed, has ``cap`` elements, or nothing helps."""
    backtrack_end = wander_end = 0  # elements up to which the front is on a backtrack, or tries other vertices
    farthest = stuck = 0  # elements where it was stuck, and how often it was without getting farther
    while front.counts[RING] > 4 and front.counts[ELEMENTS] < cap:
        if front.counts[RING] <= RING_LIMIT and fill(tree, front, undo_log, agent, numbers.type2, numbers):
            break
        elements = front.counts[ELEMENTS]
        slot = reference_slot(front)
        look(agent, front, slot, numbers)
        source = STUCK
        begin(candidates)
        # Draws of the policy and of all actions by turns: where it is stuck, the policy is often sure of itself.
        backtracking = elements < backtrack_end and is_near(front, slot, place)
        if backtracking and stuck % 2 == 0:
            scatter(candidates, front, slot, agent, DRAWS, False, numbers, random)
            source = WIDE
        elif backtracking or (exploration > 0.0 and random.random() < exploration):
            sample(candidates, front, slot, agent, DRAWS, numbers.type2, numbers, random)
            source = SAMPLED
        if not found(candidates):
            mean_action(agent, candidates.action)
            cut = element(front, slot, candidates.action, numbers.type2, numbers)
            if cut.rejection == ACCEPTED:
                cut_off(front, undo_log, cut, decode_type(candidates.action[0], numbers.type2), POLICY, numbers.n_rv)
                continue
            source = here(candidates, front, slot, agent, numbers.type2, numbers, random)
            if source == STUCK and elements < wander_end:
                source = elsewhere(candidates, front, agent, numbers.type2, numbers, random)
        if source != STUCK:
            type2 = numbers.type2 or source == WIDE
            cut_action(front, undo_log, candidates.slot[0], candidates.action, type2, source, numbers)
            continue

        if elements > farthest:
            farthest, stuck = elements, 0
        stuck += 1
        if (stuck > TRIES * DOUBLINGS or elements == 0) and elements >= wander_end:
            wander_end = elements + WANDER
            continue
        if stuck > patience or tally[TAKEN_BACK] > SLACK + SHARE * elements:
            break
        mark(front, slot, place)
        back = elements_back(front, elements, 1 << ((stuck - 1) // TRIES), place)
        backtrack_end = elements
        tally[BACKTRACKS] += 1
        tally[TAKEN_BACK] += back
        take_back(front, undo_log, back, numbers.n_rv)
    if front.counts[RING] == 4:
        undo_log.source[front.counts[ELEMENTS]] = LAST
        close(front)


def grow(
    policy: Policy,
    domain: Domain,
    seed: int | tuple[int, ...],
    *,
    exploration: float = 0.0,
    patience: int = PATIENCE,
    sizes: WantedSizes = NO_WISHES,
) -> Grown:
    """Mesh a domain.

    Args:
        policy: its mean action is taken wherever that is valid.
        domain: a ring of at least 6 vertices.
        seed: of all draws, as for numpy.random.default_rng; the same arguments give the same mesh.
        exploration: share of the elements for which the policy's draws are taken in place of its mean, [0, 1].
        patience: backtracks without progress after which to give up.
        sizes: what is wanted beyond the boundary's own sizes; it tells a policy something whose scale is ``size``.
    """
    parameters = policy.parameters
    # A look-ahead may begin just below the cap, and the last action cuts two elements.
    cap = fr.element_cap(domain, parameters, sizes)
    room = cap + DEPTH + 2
    # Type 2, which lets a front grow, is among the remedies whatever the policy does.
    slots = fr.capacity(len(domain.ring), replace(parameters, type2=True))
    start = fr.template(domain, parameters, slots, sizes=sizes)
    front = fr.with_room(start, 2 * room, room)
    log, tally = undo_log(room), np.zeros(2, dtype=np.int64)
    run(
        front, log, agent(policy), candidates(), tree(), numbers(parameters), cap,
        float(exploration), patience, np.random.default_rng(seed), tally, np.zeros(3),
    )  # fmt: skip
    count = int(front.counts[ELEMENTS])
    complete = bool(front.counts[RING] == 0)
    mesh = Mesh(
        name=domain.name,
        vertices=front.points[: front.counts[fr.POINTS]].copy(),
        quads=front.quads[:count].copy(),
        segments=domain.segments,
        complete=complete,
    )
    types = np.bincount(log.action_type[: count - int(complete)], minlength=len(ACTION_TYPES))
    sources = np.bincount(log.source[:count], minlength=len(SOURCES))
    return Grown(
        mesh=mesh,
        ring=front.vid[fr.ring_slots(front)],
        action_types=dict(zip(ACTION_TYPES, types.tolist(), strict=True)),
        sources=dict(zip(SOURCES, sources.tolist(), strict=True)),
        backtracks=int(tally[BACKTRACKS]),
        taken_back=int(tally[TAKEN_BACK]),
    )
