"""A mesh in one compiled loop: the agent looks at the reference vertex, acts, the front advances.

Where the mean action is invalid, a ladder of remedies: ``recovery``, and if nothing is valid, the last elements are
taken back, ever more of them, and the agent's actions are drawn for a while, so that the mesh grows another way. The
last ring is filled by ``lookahead``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from envs import front as fr
from envs.action import ACCEPTED, KINDS, decode_kind
from envs.front import ELEMENTS, RING, Front, close, reference_slot
from envs.kernels.compiled import compiled
from envs.mesh import Mesh
from envs.transition import Numbers, numbers
from envs.types import Domain, Ints
from freemesh_ray.mesher.agent import Agent, agent, look, mean_action
from freemesh_ray.mesher.choice import Choice, begin, choice, found
from freemesh_ray.mesher.detour import elements_back, is_near, mark
from freemesh_ray.mesher.lookahead import RING_LIMIT, Tree, fill, tree
from freemesh_ray.mesher.recovery import STUCK, recover, sample, scatter
from freemesh_ray.mesher.trail import LAST, POLICY, SAMPLED, SOURCES, WIDE, Trail, cut_action, cut_off, element, take_back, trail
from freemesh_ray.policy import Policy

#: Times the mesh is taken back: so often with each number of elements, which doubles from 2.
TRIES, DOUBLINGS, PATIENCE, WANDER, SLACK, WORK = 4, 7, 40, 32, 20000, 4
#: Draws, of which the best is taken, at a vertex while the mesh grows another way.
DETOUR_DRAWS = 3
#: Entries of a tally: times the mesh was taken back, and elements taken back in all.
BACKTRACKS, TAKEN_BACK = range(2)


@dataclass(frozen=True)
class Grown:
    """What the engine made of a domain.

    Attributes:
        mesh: complete or not.
        ring: (r,) int64, mesh vertices of the ring that is left, counter-clockwise; empty when complete.
        kinds: elements of each kind, by name.
        sources: elements by where they came from, by name (trail.SOURCES).
        backtracks: times that elements were taken back.
        taken_back: elements taken back in all.
    """

    mesh: Mesh
    ring: Ints
    kinds: dict[str, int]
    sources: dict[str, int]
    backtracks: int
    taken_back: int


@compiled
def run(
    front: Front, trail: Trail, agent: Agent, choice: Choice, tree: Tree, numbers: Numbers, cap: int, patience: int,
    random: np.random.Generator, tally: Ints,
) -> None:  # fmt: skip
    """Mesh a front until it is closed, has ``cap`` elements, or nothing helps."""
    place = np.zeros(3)
    detour_end = 0  # elements up to which actions are drawn
    farthest = stuck = wander_end = 0
    while front.counts[RING] > 4 and front.counts[ELEMENTS] < cap:
        if front.counts[RING] <= RING_LIMIT and fill(tree, front, trail, agent, numbers.type2, numbers):
            break
        elements = front.counts[ELEMENTS]
        slot = reference_slot(front)
        look(agent, front, slot, numbers)
        source = POLICY
        begin(choice)
        if elements < detour_end and is_near(front, slot, place):
            if stuck % 2:
                sample(choice, front, slot, agent, DETOUR_DRAWS, numbers.type2, numbers, random)
                source = SAMPLED
            else:
                scatter(choice, front, slot, agent, 2 * DETOUR_DRAWS, False, numbers, random)
                source = WIDE
        if not found(choice):
            mean_action(agent, choice.action)
            cut = element(front, slot, choice.action, numbers.type2, numbers)
            if cut.rejection == ACCEPTED:
                cut_off(front, trail, cut, decode_kind(choice.action[0], numbers.type2), POLICY, numbers.n_rv)
                continue
            source = recover(choice, front, agent, numbers.type2, elements < wander_end, numbers, random)
        if source != STUCK:
            type2 = numbers.type2 or source == WIDE
            cut_action(front, trail, choice.slot[0], choice.action, type2, source, numbers)
            continue
        if tally[TAKEN_BACK] > SLACK + WORK * elements:
            break
        if elements > farthest:
            farthest, stuck = elements, 0
        stuck += 1
        if (stuck > TRIES * DOUBLINGS or elements == 0) and elements >= wander_end:
            wander_end = elements + WANDER
            continue
        if stuck > patience:
            break
        mark(front, slot, place)
        back = elements_back(front, elements, 1 << ((stuck - 1) // TRIES), place)
        detour_end = elements
        tally[BACKTRACKS] += 1
        tally[TAKEN_BACK] += back
        take_back(front, trail, back, numbers.n_rv)
    if front.counts[RING] == 4:
        trail.source[front.counts[ELEMENTS]] = LAST
        close(front)


def grow(policy: Policy, domain: Domain, seed: int, *, patience: int = PATIENCE) -> Grown:
    """Mesh a domain.

    Args:
        policy: its mean action is taken wherever that is valid.
        domain: a ring of at least 6 vertices.
        seed: of the remedies' draws; the same arguments give the same mesh.
    """
    parameters = policy.parameters
    # Type 2 is among the remedies whatever the policy does.
    slots = 2 * fr.capacity(domain, parameters)
    cap = fr.element_cap(domain, parameters)
    template = fr.template(domain, parameters, slots)
    elements = cap + 2 * RING_LIMIT
    points = np.zeros((len(domain.points) + 2 * elements, 2))
    points[: len(domain.points)] = domain.points
    front = template._replace(points=points, quads=np.zeros((elements, 4), dtype=np.int64))
    log, tally = trail(elements), np.zeros(2, dtype=np.int64)
    run(
        front, log, agent(policy), choice(), tree(), numbers(parameters), cap, patience, np.random.default_rng(seed), tally
    )  # fmt: skip
    count = int(front.counts[ELEMENTS])
    mesh = Mesh(
        name=domain.name,
        vertices=front.points[: front.counts[fr.POINTS]].copy(),
        quads=front.quads[:count].copy(),
        segments=domain.segments,
        complete=bool(front.counts[RING] == 0),
    )
    cut = count - int(mesh.complete)
    return Grown(
        mesh=mesh,
        ring=front.vid[fr.ring_slots(front)],
        kinds=dict(zip(KINDS, np.bincount(log.kind[:cut], minlength=len(KINDS)).tolist(), strict=True)),
        sources=dict(zip(SOURCES, np.bincount(log.source[:count], minlength=len(SOURCES)).tolist(), strict=True)),
        backtracks=int(tally[0]),
        taken_back=int(tally[1]),
    )
