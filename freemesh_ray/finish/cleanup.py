"""Topological clean-up: short sequences of swaps, collapses and splits that make vertices regular.

Around each irregular vertex a depth-first search tries sequences of up to ``DEPTH`` changes, those first that leave the
least irregularity. One that lessens it is tried out on a copy of the patch: its vertices are moved to where the
elements are best. It stays when they are then on the whole no poorer than before, and the poorest is not poorer either;
otherwise it is taken back.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from envs.kernels.compiled import compiled
from envs.types import Floats, Ints
from freemesh_ray.finish.changes import HALFEDGE, KIND, ARGUMENT, TOTAL, irregularity, list_options, make
from freemesh_ray.finish.halfedges import LOGGED, QUADS, SIGNATURE, VERTICES, Halfedges, commit, undo
from freemesh_ray.finish.patch import Patch, copy, patch_of, rate, settle, size, spread, surround, write_back

#: The poorest element of a patch may become poorer only as long as it is better than this.
FLOOR = 0.5
#: Changes in one sequence, at most.
DEPTH = 3
#: Changes tried at each depth.
WIDTH = (10, 6, 4)
#: Irregularity that a sequence may add on its way.
SLACK = 3.0
#: Sequences tried out around one vertex, and those that are settled to the end, at most.
TRIALS, FULL = 12, 3
#: Steps of the descent before a sequence is judged for the first time and before the second.
FIRST_STEPS, STEPS = 6, 20
#: A sequence is given up when it costs more than this before the second.
MARGIN = 0.4
#: What the cost of the patch may rise for each unit of irregularity less.
WORTH = 0.0
# Entries of Search.counts.
TRIED, SETTLED, KEPT = range(3)


class Search(NamedTuple):
    """Working memory of the clean-up.

    Attributes:
        patch: the patch.
        hot: (64,) int64, vertices that the next change may start from.
        options: (DEPTH, most of WIDTH, 4) float64, the changes to try; see changes.list_options.
        seen: (1024,) int64, signatures of the connectivities tried.
        counts: (3,) int64, sequences tried, settled, kept.
        changed: (M,) int64, for each element how many sequences had been kept when it was last in the patch of one.
        failed: (V,) int64, for each vertex how many had been kept when the search around it last found nothing.
    """

    patch: Patch
    hot: Ints
    options: Floats
    seen: Ints
    counts: Ints
    changed: Ints
    failed: Ints


@compiled
def improve(
    mesh: Halfedges, search: Search, seed: int, goal: float, gain: float, level: float, regular_too: bool
) -> bool:
    """Search around a vertex for a sequence that lessens irregularity; whether one was kept.

    Args:
        mesh: changed when one is.
        search: working memory.
        seed: the vertex.
        goal: the irregularity added must be less than this.
        gain: the cost of the patch must fall by at least this.
        level: cost of an element that is neither good nor bad for the mesh as a whole.
        regular_too: let changes start from regular vertices, too.
    """
    patch = search.patch
    newest = 0
    for quad in surround(mesh, patch, seed):
        newest = max(newest, search.changed[quad])
    if newest < search.failed[seed]:
        return False
    vertices, quads = mesh.counts[VERTICES], mesh.counts[QUADS]
    commit(mesh)
    copy(mesh, patch, vertices, quads)
    limit = settle(patch, 0, 0.0) - level * size(patch) - gain
    guard = min(rate(patch)[1], FLOOR)
    totals = np.zeros(DEPTH + 1)
    logged = np.zeros(DEPTH + 1, dtype=np.int64)
    hot = np.zeros(DEPTH + 1, dtype=np.int64)
    count, at = np.zeros(DEPTH, dtype=np.int64), np.zeros(DEPTH, dtype=np.int64)
    search.hot[0], hot[0] = seed, 1
    search.seen[0] = mesh.counts[SIGNATURE]
    seen = 1
    count[0] = list_options(
        mesh, patch, search.hot[:1], 0.0, SLACK if DEPTH > 1 else goal, regular_too, search.options[0, : WIDTH[0]]
    )
    depth = tried = settled = 0
    while depth >= 0:
        undo(mesh, logged[depth])
        if at[depth] == count[depth] or tried == TRIALS or settled == FULL:
            depth -= 1
            continue
        option = search.options[depth, at[depth]]
        at[depth] += 1
        total = option[TOTAL]
        hot_now = make(
            mesh, patch, int(option[KIND]), int(option[HALFEDGE]), int(option[ARGUMENT]), search.hot, hot[depth]
        )
        signature = mesh.counts[SIGNATURE]
        known = False
        for i in range(seen):
            known = known or search.seen[i] == signature
        if known:
            continue
        if seen < len(search.seen):
            search.seen[seen] = signature
            seen += 1
        if total < goal:
            tried += 1
            copy(mesh, patch, vertices, quads)
            spread(patch)
            value = settle(patch, FIRST_STEPS, 0.0) - level * size(patch)
            if value < limit + MARGIN:
                settled += 1
                value = settle(patch, STEPS, 1e-3) - level * size(patch)
                if value < limit - WORTH * total and rate(patch)[1] >= max(guard, 1e-3):
                    write_back(mesh, patch)
                    search.counts[KEPT] += 1
                    for i in range(len(search.changed)):
                        if patch.quad_stamp[i] == patch.counts[0]:
                            search.changed[i] = search.counts[KEPT]
                    search.counts[TRIED] += tried
                    search.counts[SETTLED] += settled
                    commit(mesh)
                    return True
        if depth + 1 < DEPTH:
            depth += 1
            totals[depth], logged[depth] = total, mesh.counts[LOGGED]
            hot[depth], at[depth] = hot_now, 0
            count[depth] = list_options(
                mesh, patch, search.hot[:hot_now], total, SLACK if depth + 1 < DEPTH else goal - 1e-9, regular_too,
                search.options[depth, : WIDTH[depth]],
            )
    search.counts[TRIED] += tried
    search.counts[SETTLED] += settled
    search.failed[seed] = search.counts[KEPT] + 1
    return False


@compiled
def clean(mesh: Halfedges, search: Search, passes: int, gain: float, level: float) -> int:
    """Go over all irregular vertices until nothing more is kept, ``passes`` times at most; sequences kept."""
    kept = 0
    for _ in range(passes):
        before_pass = kept
        v = 0
        while v < mesh.counts[VERTICES]:
            if mesh.degree[v] > 0 and irregularity(mesh, v, 0) > 0.0:
                kept += improve(mesh, search, v, -0.5, gain, level, False)
            v += 1
        if kept == before_pass:
            break
    return kept


def workspace(mesh: Halfedges) -> Search:
    """Room for a search in this mesh."""
    return Search(
        patch=patch_of(mesh),
        hot=np.zeros(64, dtype=np.int64),
        options=np.zeros((DEPTH, max(WIDTH), 4)),
        seen=np.zeros(1024, dtype=np.int64),
        counts=np.zeros(3, dtype=np.int64),
        changed=np.zeros(len(mesh.quads), dtype=np.int64),
        failed=np.zeros(len(mesh.xy), dtype=np.int64),
    )
