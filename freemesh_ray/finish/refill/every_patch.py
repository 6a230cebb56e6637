"""Patches grown around irregular vertices, one after the other, each tried at every size that it passes through.

    the whole domain, if it has few reflex corners; that is all when it has the least number of irregular vertices then
    -> patches that lose irregular vertices, until nothing changes -> patches that lose none but are better
    -> the first again

Work is counted in elements that are looked at, not in seconds, so that the same mesh is always filled the same way.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from envs.kernels.jit import compiled, inner
from envs.mdp.size_field import SizeField
from freemesh_ray.finish.cleanup import LEVEL
from freemesh_ray.finish.halfedges import NONE, PINNED, QUADS, VERTICES, Halfedges
from freemesh_ray.finish.optimiser import mean_cost
from freemesh_ray.finish.refill.growth import (
    LOOP,
    MOST_ROOM,
    OUTER,
    REFLEX_CORNERS,
    SIZE,
    WORK,
    Growth,
    add,
    push_fan,
    reflex_corners,
    shrink,
    stack_around,
    stack_side,
    target,
    trace,
)
from freemesh_ray.finish.refill.ring_filling import CORNER
from freemesh_ray.finish.refill.trial import EXCHANGED, IRREGULAR, TRIED_SIZE, Trial, trial_of, try_patch


class Effort(NamedTuple):
    """How much is tried.

    Attributes:
        work: elements looked at, at most.
        share: elements looked at for each element of the mesh, at most.
        limit: elements of a patch, at most.
        whole: elements of a domain that is filled as a whole, at most.
        both: whether two meshes are made, large patches first and small ones first, and the better one is taken.
    """

    work: int
    share: int
    limit: int
    whole: int
    both: bool


#: By name; ``quick`` fills nothing anew.
EFFORTS = {
    "quick": Effort(0, 0, 0, 0, False),
    "usual": Effort(5_000_000, 15_000, 1_000, 200_000, False),
    "thorough": Effort(60_000_000, 60_000, 2_000, 1_000_000, True),
}
USUAL = "usual"
#: Elements of patches, at most, when all irregular vertices are gone over for the first and the second time; of patches
#: that lose no irregular vertex.
SMALL, MEDIUM, MOVES = 100, 300, 200
#: Times that all irregular vertices are gone over with one aim, at most.
PASSES = 4
#: Ways to grow: all round first; over the longest side first; over the shortest.
ALL_ROUND, LONGEST, SHORTEST = range(3)
#: Sides that a patch grows over, at most; with more it only grows all round.
SIDES = 16


@inner
def clear(mesh: Halfedges, trial: Trial) -> None:
    """Begin with an empty patch."""
    shrink(mesh, trial.growth, 0)
    trial.growth.counts[LOOP] = trial.growth.counts[OUTER] = 0
    trial.state[IRREGULAR], trial.state[TRIED_SIZE] = -1, 0


@inner
def fill_domain(mesh: Halfedges, trial: Trial) -> bool:
    """Fill the whole domain anew if it has one hole at most and few reflex corners around; whether that was done."""
    growth = trial.growth
    clear(mesh, trial)
    for v in range(mesh.counts[VERTICES]):
        if mesh.fixed[v] and mesh.degree[v] > 0 and (mesh.ideal[v] > MOST_ROOM or mesh.degree[v] == PINNED):
            return False
    for quad in range(mesh.counts[QUADS]):
        if mesh.quads[quad, 0] != NONE:
            growth.inside[quad] = True
            growth.members[growth.counts[SIZE]] = quad
            growth.counts[SIZE] += 1
            for c in range(4):
                growth.uses[mesh.quads[quad, c]] += 1
    if not trace(mesh, growth) or reflex_corners(mesh, growth) > REFLEX_CORNERS:
        return False
    return try_patch(mesh, trial, 1, True)


@inner
def _side(mesh: Halfedges, growth: Growth, number: int, way: int) -> tuple[int, int]:
    """Where side ``number`` of the loop begins, in the order of the way to grow, and its length; 0: there is none."""
    n, corners, first, last = growth.counts[OUTER], 0, -1, -1
    for i in range(n):
        if target(mesh, growth, growth.loop[i]) < CORNER:
            corners += 1
    if corners == 0:
        return 0, n if number == 0 else 0
    if number >= min(corners, SIDES):
        return 0, 0
    # The side that as many others come before as the number says: longer ones, or shorter ones.
    for i in range(n):
        if target(mesh, growth, growth.loop[i]) < CORNER:
            first = i
            break
    begin, length = first, 0
    last = first
    for wanted in range(corners):
        end = last + 1
        while end < first + n and not target(mesh, growth, growth.loop[end % n]) < CORNER:
            end += 1
        length, begin = end - last, last
        rank, other = 0, first
        for k in range(corners):
            stop = other + 1
            while stop < first + n and not target(mesh, growth, growth.loop[stop % n]) < CORNER:
                stop += 1
            longer = stop - other > length if way == LONGEST else stop - other < length
            rank += 1 if longer or (stop - other == length and k < wanted) else 0
            other = stop
        if rank == number:
            return begin % n, length
        last = end
    return 0, 0


@inner
def grow_on(mesh: Halfedges, growth: Growth, limit: int, way: int) -> bool:
    """Grow the patch by a row, all round or over one side; whether that was possible."""
    if way == ALL_ROUND and add(mesh, growth, stack_around(mesh, growth), limit):
        return True
    for number in range(SIDES):
        begin, length = _side(mesh, growth, number, way)
        if length == 0:
            return False
        if add(mesh, growth, stack_side(mesh, growth, begin, length), limit):
            return True
    return False


@inner
def grow_from(mesh: Halfedges, trial: Trial, seed: int, limit: int, drop: int, way: int) -> bool:
    """Grow a patch from a vertex, on trial at each stage; whether the mesh was changed."""
    growth = trial.growth
    clear(mesh, trial)
    if not add(mesh, growth, push_fan(mesh, growth, seed, 0), limit):
        return False
    while not try_patch(mesh, trial, drop, False):
        if not grow_on(mesh, growth, limit, way):
            return False
    return True


@inner
def go_over(mesh: Halfedges, trial: Trial, limit: int, drop: int, work: int, ways: int) -> bool:
    """Grow patches from all irregular vertices; whether the mesh was changed."""
    before = trial.state[EXCHANGED]
    for k in range(3):
        way = k if ways == 0 else 2 - k
        for v in range(mesh.counts[VERTICES]):
            if trial.growth.counts[WORK] >= work:
                return False
            if mesh.fixed[v] or mesh.degree[v] in (0, 4):
                continue
            grow_from(mesh, trial, v, limit, drop, way)
    return trial.state[EXCHANGED] > before


@inner
def irregular_left(mesh: Halfedges) -> tuple[int, int]:
    """The irregular vertices inside, and the least that a mesh with as many elements at the boundary has."""
    irregular = index = 0
    for v in range(mesh.counts[VERTICES]):
        if not mesh.rim[v] and mesh.degree[v] not in (0, 4):
            irregular, index = irregular + 1, index + 4 - mesh.degree[v]
    return irregular, abs(index)


@compiled
def fill_patches(mesh: Halfedges, trial: Trial, work: int, limit: int, whole: int, ways: int) -> None:
    """Fill patches anew until nothing more is better, or the work is done."""
    if work == 0 or irregular_left(mesh) == (0, 0):
        return
    if whole > 0 and fill_domain(mesh, trial):
        irregular, least = irregular_left(mesh)
        if irregular == least:
            clear(mesh, trial)
            return
    trial.growth.counts[WORK] = 0  # the whole domain had its own: patches have all of theirs
    for most in (SMALL, MEDIUM, limit):
        go_over(mesh, trial, min(most, limit), 1, work, ways)
    for _ in range(PASSES):
        if not go_over(mesh, trial, limit, 1, work, ways):
            break
    for _ in range(2):
        if not go_over(mesh, trial, min(limit, MOVES), 0, work, ways):
            break
    for _ in range(PASSES):
        if not go_over(mesh, trial, limit, 1, work, ways):
            break
    clear(mesh, trial)


def refill(mesh: Halfedges, wanted: SizeField, effort: Effort, ways: int = 0) -> int:
    """Fill patches of a mesh anew; how many were.

    Args:
        mesh: valid, with room for more elements; changed in place, and valid again.
        wanted: edge lengths.
        effort: one of ``EFFORTS``.
        ways: the order of the ways to grow: 0 large patches first, 1 small ones.
    """
    alive = mesh.quads[mesh.quads[:, 0] != NONE]
    whole = len(alive) if len(alive) <= effort.whole else 0
    mean = mean_cost(mesh.xy, alive, wanted)
    limit, work = min(effort.limit, len(alive)), min(effort.work, effort.share * len(alive))
    rim = int(np.count_nonzero(mesh.opp[: 4 * mesh.counts[QUADS]] == NONE))
    # A patch has up to twice as many vertices around it as elements, and MOST_ELEMENTS allows some more than before.
    trial = trial_of(mesh, wanted, 64 + max(4 * limit, 2 * whole + rim), LEVEL * mean)
    if math.isfinite(mean):
        fill_patches(mesh, trial, work, limit, whole, ways)
    return int(trial.state[EXCHANGED])
