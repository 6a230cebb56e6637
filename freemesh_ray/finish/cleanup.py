"""Topological clean-up: short sequences of swaps, collapses and splits that make vertices regular.

Around each irregular vertex a depth-first search tries sequences of up to ``DEPTH`` changes, those first that leave the
least irregularity. One that adds none is tried out on a copy of the patch: its vertices are moved to where the elements
are best. It stays when they are then better on the whole than before, and the poorest is not poorer; otherwise it is
taken back.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from envs.kernels.jit import compiled, inner
from envs.mdp.size_field import SizeField
from envs.types import Floats, Ints
from freemesh_ray.finish.changes import ARGUMENT, HALFEDGE, KIND, TOTAL, irregularity, list_options, make
from freemesh_ray.finish.halfedges import LOGGED, NONE, PINNED, QUADS, SIGNATURE, VERTICES, Halfedges, commit, undo
from freemesh_ray.finish.optimiser import mean_cost
from freemesh_ray.finish.patch import (
    Patch,
    copy,
    newest,
    note,
    patch_of,
    price,
    rate,
    settle,
    size,
    spread,
    surround,
    write_back,
)

#: The poorest element of a patch may become poorer only as long as it is better than this.
FLOOR = 0.5
#: Times that all irregular vertices are gone over, at most.
PASSES = 4
#: Changes in one sequence, and those tried at each depth, at most.
DEPTH, WIDTH = 2, 20
#: Irregularity that a sequence may add on its way, and at its end; less than each.
SLACK, GOAL = 4.2, 0.2
#: Sequences tried out around one vertex, and those of them settled, at most.
TRIALS, SETTLED = 60, 10
#: Steps of the first descent, after which a patch is given up that costs too much by more than this; of the second.
STEPS, MARGIN = (3, 20), 0.4
#: A descent ends when a step lowers the cost by less than this share.
LEAST_FALL = 1e-3
#: What the cost of a patch must fall by, and the part of that for each unit of irregularity that vanishes.
GAIN, WORTH = 0.02, 0.2
#: The cost of an element that makes the mesh neither better nor worse, over the mean cost before.
LEVEL = 0.8

# Outcomes of a trial.
_GIVEN_UP, _POOR, _GOOD = range(3)
# Rows of Search.stack.
_LOGGED, _HOT, _COUNT, _AT = range(4)


class Search(NamedTuple):
    """Working memory.

    Attributes:
        patch: what is searched.
        stack: (4, DEPTH) int64, for each depth entries of the log and hot vertices before it; options there are, tried.
        options: (DEPTH, WIDTH, 4) float64, the changes to try; see changes.list_options.
        hot: (64,) int64, vertices that the next change may start from.
        seen: (1024,) int64, signatures of the connectivities met.
        kept: (1,) int64, how many sequences were kept.
        changed: (M,) int64, for each element how many had been kept when it was last in the patch of one.
        failed: (V,) int64, for each vertex how many had been kept, and 1, when the search around it found nothing.
    """

    patch: Patch
    stack: Ints
    options: Floats
    hot: Ints
    seen: Ints
    kept: Ints
    changed: Ints
    failed: Ints


@inner
def try_out(mesh: Halfedges, patch: Patch, vertices: int, quads: int, level: float, limit: float, guard: float) -> int:
    """Move the vertices of a copy of the patch to where they are best; the outcome.

    Args:
        mesh: not changed.
        patch: the copy is overwritten.
        vertices, quads: how many there were before the changes that are tried out.
        level: cost of an element that makes the mesh neither better nor worse.
        limit: what the patch may cost, with ``level`` taken off for each element.
        guard: the least eta that its poorest element may have.
    """
    copy(mesh, patch, vertices, quads)
    spread(patch)
    limit += level * size(patch)
    outcome = _GIVEN_UP
    for steps in STEPS:
        cost = settle(patch, steps, LEAST_FALL)
        if outcome == _GIVEN_UP and not cost < limit + MARGIN:
            return _GIVEN_UP
        outcome = _GOOD if cost < limit and rate(patch) >= guard else _POOR
    return outcome


@inner
def improve(mesh: Halfedges, search: Search, seed: int, level: float) -> bool:
    """Search around a vertex for a sequence that makes the mesh better; whether one was kept.

    Args:
        mesh: changed when one was.
        search: working memory.
        seed: the vertex.
        level: cost of an element that makes the mesh neither better nor worse.
    """
    patch = search.patch
    surround(mesh, patch, seed)
    if newest(patch, search.changed) < search.failed[seed]:
        return False
    commit(mesh)
    vertices, quads = mesh.counts[VERTICES], mesh.counts[QUADS]
    copy(mesh, patch, vertices, quads)
    limit = price(patch) - level * size(patch) - GAIN
    guard = min(rate(patch), FLOOR)
    logged, hot, count, at = search.stack[_LOGGED], search.stack[_HOT], search.stack[_COUNT], search.stack[_AT]
    search.hot[0], search.seen[0], seen = seed, mesh.counts[SIGNATURE], 1
    logged[0], hot[0], at[0] = 0, 1, 0
    count[0] = list_options(mesh, patch, search.hot[:1], 0.0, SLACK if DEPTH > 1 else GOAL, search.options[0])
    depth = tried = settled = 0
    while depth >= 0:
        undo(mesh, logged[depth])
        if at[depth] == count[depth] or tried == TRIALS or settled == SETTLED:
            depth -= 1
            continue
        option = search.options[depth, at[depth]]
        at[depth] += 1
        total, kind, h, argument = option[TOTAL], int(option[KIND]), int(option[HALFEDGE]), int(option[ARGUMENT])
        hot_now = make(mesh, patch, kind, h, argument, search.hot, hot[depth])
        known = False
        for i in range(seen):
            known = known or search.seen[i] == mesh.counts[SIGNATURE]
        if known:
            continue
        if seen < len(search.seen):
            search.seen[seen] = mesh.counts[SIGNATURE]
            seen += 1
        if total < GOAL:
            outcome = try_out(mesh, patch, vertices, quads, level, limit - WORTH * total, guard)
            tried += 1
            settled += outcome != _GIVEN_UP
            if outcome == _GOOD:
                write_back(mesh, patch)
                search.kept[0] += 1
                note(patch, search.changed, search.kept[0])
                search.changed[quads : mesh.counts[QUADS]] = search.kept[0]
                return True
        if depth + 1 < DEPTH:
            depth += 1
            logged[depth], hot[depth], at[depth] = mesh.counts[LOGGED], hot_now, 0
            limit_now = SLACK if depth + 1 < DEPTH else GOAL
            count[depth] = list_options(mesh, patch, search.hot[:hot_now], total, limit_now, search.options[depth])
    search.failed[seed] = search.kept[0] + 1
    return False


@compiled
def search_all(mesh: Halfedges, search: Search, level: float) -> None:
    """Go over all irregular vertices, again and again, until nothing more is kept."""
    for _ in range(PASSES):
        before = search.kept[0]
        for v in range(len(mesh.degree)):
            if mesh.degree[v] not in (0, PINNED) and irregularity(mesh, v) > 0.0:
                improve(mesh, search, v, level)
        if search.kept[0] == before:
            break


def clean_up(mesh: Halfedges, wanted: SizeField) -> int:
    """Clean a mesh up; the number of sequences that were kept.

    Args:
        mesh: valid; changed in place, and valid again.
        wanted: edge lengths.
    """
    search = Search(
        patch=patch_of(mesh, wanted),
        stack=np.zeros((4, DEPTH), dtype=np.int64),
        options=np.zeros((DEPTH, WIDTH, 4)),
        hot=np.zeros(64, dtype=np.int64),
        seen=np.zeros(1024, dtype=np.int64),
        kept=np.zeros(1, dtype=np.int64),
        changed=np.zeros(len(mesh.quads), dtype=np.int64),
        failed=np.zeros(len(mesh.xy), dtype=np.int64),
    )
    quads = mesh.quads[mesh.quads[:, 0] != NONE]
    mean = mean_cost(mesh.xy, quads, wanted)
    if math.isfinite(mean):
        search_all(mesh, search, LEVEL * mean)
    return int(search.kept[0])
