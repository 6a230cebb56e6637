"""The finish of a mesh: topological clean-up and smoothing, each of which only ever improves it.

    smooth a little -> clean up -> move all vertices at once -> smooth

The boundary is never touched. Both steps can be left out, and neither lets the poorest element become poorer than it
was, or than ``smoother.FLOOR`` when it was better.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from envs.mesh import Mesh
from envs.quality import element_quality
from envs.types import Floats, Ints
from freemesh_ray.finish import cleanup, smoother
from freemesh_ray.finish.halfedges import NONE, QUADS, VERTICES, Halfedges, build, compact
from freemesh_ray.finish.optimiser import descend

#: Rounds of smoothing before the clean-up and at the end, passes of the clean-up, steps of all vertices at once.
FIRST_SWEEPS, LAST_SWEEPS, PASSES, STEPS = 6, 30, 4, 80
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
    """Improve a complete mesh.

    Args:
        mesh: without defects.
        smooth: move interior vertices.
        clean: change the connectivity where that makes vertices regular; interior vertices nearby move with it.
    """
    given = np.zeros(len(mesh.vertices), dtype=np.bool_)
    given[mesh.segments.ravel()] = True
    work = build(mesh.vertices, mesh.quads, given)
    step, star = smoother.workspace(work)
    if smooth:
        inner = movable(work)
        smoother.smooth(work, inner, len(inner), FIRST_SWEEPS, False, step, star)
    sequences = cleanup.clean(work, cleanup.workspace(work, step, star), PASSES, 0.0) if clean else 0
    if smooth:
        relax(work)
        inner = movable(work)
        smoother.smooth(work, inner, len(inner), LAST_SWEEPS, False, step, star)
    vertices, quads = compact(work, int(mesh.segments.max()) + 1)
    return Finished(Mesh(mesh.name, vertices, quads, mesh.segments, mesh.complete), sequences)


def movable(work: Halfedges) -> Ints:
    """Interior vertices, (n,) int64."""
    count = work.counts[VERTICES]
    return np.flatnonzero(~work.fixed[:count] & (work.degree[:count] > 0))


def relax(work: Halfedges) -> None:
    """Move all interior vertices at once, but for those around elements that would become too poor."""
    count, quads = work.counts[VERTICES], work.quads[: work.counts[QUADS]]
    quads = np.ascontiguousarray(quads[quads[:, 0] != NONE])
    start = work.xy[:count].copy()
    limit = min(float(element_quality(start, quads).min()), smoother.FLOOR)
    free = np.zeros(count, dtype=np.bool_)
    free[movable(work)] = True
    for _ in range(HOLDS):
        moved = start.copy()
        descend(moved, quads, free, STEPS)
        poor = ~(qualities(moved, quads) >= limit)
        if not poor.any():
            work.xy[:count] = moved
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
