"""The finish of a mesh: topological clean-up and smoothing, each of which only ever improves it.

    move all vertices at once -> clean up -> move all vertices at once -> smooth
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from envs.mesh import Mesh
from envs.quality import element_quality
from envs.types import Floats, Ints
from freemesh_ray.finish import cleanup, smoother
from freemesh_ray.finish.halfedges import NONE, QUADS, VERTICES, Halfedges, build, compact
from freemesh_ray.finish.optimiser import descend, descent

FIRST_STEPS, LAST_STEPS, LAST_SWEEPS, PASSES = 30, 80, 8, 4
#: How often vertices near elements that became too poor are held, before nothing is moved at all.
HOLDS = 4


@dataclass(frozen=True)
class Finished:
    """A finished mesh.

    Attributes:
        mesh: its elements are in no particular order when it was cleaned up.
        sequences: topological changes that were kept.
    """

    mesh: Mesh
    sequences: int


def finish(mesh: Mesh, *, smooth: bool = True, clean: bool = True) -> Finished:
    given = np.zeros(len(mesh.vertices), dtype=np.bool_)
    given[mesh.segments.ravel()] = True
    work = build(mesh.vertices, mesh.quads, given)
    if smooth:
        relax(work, FIRST_STEPS)
    sequences = 0
    if clean:
        e = qualities(work.xy, mesh.quads); gap = np.maximum(0, .72 - e)
        level = float((1 - e + 8 * gap**2).mean())
        search = cleanup.workspace(work)
        sequences = cleanup.clean(work, search, PASSES, 0.0, level)
        global last; last = search
    if smooth:
        relax(work, LAST_STEPS)
        step, star = smoother.workspace(work)
        inner = movable(work)
        smoother.smooth(work, inner, len(inner), LAST_SWEEPS, False, step, star)
    vertices, quads = compact(work, int(mesh.segments.max()) + 1)
    return Finished(Mesh(mesh.name, vertices, quads, mesh.segments, mesh.complete), sequences)


def movable(work: Halfedges) -> Ints:
    """Interior vertices, (n,) int64."""
    count = work.counts[VERTICES]
    return np.flatnonzero(~work.fixed[:count] & (work.degree[:count] > 0))


def relax(work: Halfedges, steps: int) -> None:
    """Move all interior vertices at once, but for those around elements that would become too poor."""
    count, quads = work.counts[VERTICES], work.quads[: work.counts[QUADS]]
    quads = quads[quads[:, 0] != NONE]
    start = work.xy[:count].copy()
    limit = min(float(element_quality(start, quads).min()), cleanup.FLOOR)
    free = np.zeros(count, dtype=np.bool_)
    free[movable(work)] = True
    memory = descent(count)
    for _ in range(HOLDS):
        order = np.argsort(~free, kind="stable")
        place = np.empty_like(order)
        place[order] = np.arange(count)
        moved = start[order]
        descend(moved, place[quads], int(free.sum()), steps, 2e-5, memory)
        poor = ~(qualities(moved, place[quads]) >= limit)
        if not poor.any():
            work.xy[order] = moved
            return
        held = np.zeros(count, dtype=np.bool_)
        held[quads[poor]] = True
        held[quads[held[quads].any(axis=1)]] = True
        free &= ~held


def qualities(vertices: Floats, quads: Ints) -> Floats:
    """(m,) float64: eta_e, -1 of elements that are not strictly convex."""
    corner = vertices[quads]
    ahead, behind = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
    bent = (ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0] <= 0.0).any(axis=1)
    return np.where(bent, -1.0, element_quality(vertices, quads))
