"""The finish of a mesh: clean up its connectivity, move its interior vertices to where the elements are best.

    move all vertices at once -> clean up -> move all vertices at once, twice
    -> fill patches anew -> move all vertices at once, twice -> the better of the two

Elements are held to the edge lengths that are wanted: see `optimiser`. The boundary is never touched. What comes out
is never worse than what was given: see :func:`finish`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from envs.mdp.size_field import SizeField
from envs.mesh import Mesh
from envs.quality import convex_quality
from envs.types import Floats, Ints
from freemesh_ray.finish.along_lines import closed, given_vertices, open_along
from freemesh_ray.finish.cleanup import FLOOR, clean_up
from freemesh_ray.finish.halfedges import NONE, QUADS, VERTICES, Halfedges, build, compact
from freemesh_ray.finish.optimiser import NO_SIZES, descend, descent
from freemesh_ray.finish.refill import EFFORTS, USUAL, Effort, refill
from freemesh_ray.finish.snapping import renumbered
from freemesh_ray.mesh_geometry.metrics import irregular

#: Steps of all vertices at once: before the clean-up; after it; and then with the sharp stand-in.
FIRST_STEPS, STEPS, SHARP_STEPS = 30, 120, 60
#: A descent ends when a step lowers the cost by less than this share.
LEAST_FALL = 2e-5
#: What filling patches anew may cost in mean eta, its 5th percentile and its least value, besides what the mean gains.
LOST = (0.002, 0.01, 0.05)
#: Share of elements and vertices that refilling may add.
ROOM = 1.5
#: Ways to places that vertices are taken to: so many stretches at most, of this share of what is left at least.
APPROACHES, LEAST_SHARE = 12, 0.05
#: How often vertices near elements that became too poor are held, before nothing is moved at all.
HOLDS = 4


@dataclass(frozen=True)
class Finished:
    """A finished mesh.

    Attributes:
        mesh: the domain's points first; elements and other vertices are in no particular order.
        sequences: short sequences of topological changes that were kept.
        patches: patches that were filled anew.
    """

    mesh: Mesh
    sequences: int
    patches: int = 0


def finish(
    mesh: Mesh,
    wanted: SizeField = NO_SIZES,
    *,
    lines: Ints | None = None,
    held: Ints | None = None,
    smooth: bool = True,
    clean: bool = True,
    effort: str = USUAL,
) -> Finished:
    """Improve a complete mesh.

    The mean of eta never falls, the least eta does not fall below what it was, or ``cleanup.FLOOR`` when it was
    better, and the interior vertices that are irregular do not become more.

    Args:
        mesh: without defects.
        wanted: edge lengths, which elements are held to; by default none are.
        lines: (l, 2) int64, edges inside that stay, with their vertices; by default none.
        held: (h,) int64, vertices inside that stay; by default none. Like the boundary's and those of lines they come
            before the others.
        smooth: move interior vertices.
        clean: change the connectivity where that makes elements better; interior vertices nearby move with it.
        effort: how much is tried to fill patches anew, a key of ``EFFORTS``; nothing without ``clean``.

    Raises:
        ValueError: an effort that is none.
    """
    if effort not in EFFORTS:
        raise ValueError(f"effort = {effort!r}: use one of {', '.join(EFFORTS)}")
    keep = np.zeros(0, dtype=np.int64) if held is None else held
    if lines is None or not len(lines):
        return _finished(mesh, wanted, keep, smooth, clean, effort)
    # Open along the lines, whose sides are boundary then, it is a mesh like any other.
    cut = open_along(mesh, lines, keep)
    result = _finished(cut.mesh, wanted, keep, smooth, clean, effort)
    return replace(result, mesh=closed(result.mesh, cut, mesh))


def _finished(mesh: Mesh, wanted: SizeField, held: Ints, smooth: bool, clean: bool, effort: str) -> Finished:
    """What `finish` does, of a mesh without lines."""
    kept = given_vertices(mesh, held)
    fixed = mesh.on_boundary
    fixed[held] = True
    best = _improved(mesh, wanted, fixed, kept, smooth, clean, effort)
    if not len(held) or not (smooth and clean):
        return best
    # The places may suit the mesh better that it becomes without them.
    free = _improved(mesh, wanted, mesh.on_boundary, kept, smooth, clean, effort)
    other = snapped(free.mesh, wanted, held, mesh.vertices[held], kept)
    if other is not None and no_worse(mesh, other) and better(best.mesh, other):
        best = replace(free, mesh=other)
    return best


def snapped(mesh: Mesh, wanted: SizeField, held: Ints, places: Floats, kept: int) -> Mesh | None:
    """The mesh with its vertices nearest to places moved there, and smoothed; None where elements are in the way.

    Args:
        mesh: finished, nothing inside held.
        wanted: edge lengths.
        held: (h,) int64, the numbers these vertices get.
        places: (h, 2) float64.
        kept: how many vertices come first that stay in place.
    """
    near = renumbered(mesh, held, places, kept)
    if near is None:
        return None
    fixed = near.on_boundary
    fixed[held] = True
    work = build(near.vertices, near.quads, fixed, near.on_boundary)
    for _ in range(APPROACHES):
        start = work.xy[held].copy()
        share = 1.0
        while share > LEAST_SHARE:
            work.xy[held] = places if share == 1.0 else start + share * (places - start)
            if convex_quality(work.xy[: len(near.vertices)], near.quads).min() > 0.0:
                break
            share *= 0.5
        else:
            return None
        if share == 1.0:
            relax(work, wanted, False, STEPS)
            relax(work, wanted, True, SHARP_STEPS)
            return replace(near, vertices=work.xy[: len(near.vertices)].copy())
        relax(work, wanted, False, FIRST_STEPS)
    return None


def _improved(
    mesh: Mesh, wanted: SizeField, fixed: np.ndarray, kept: int, smooth: bool, clean: bool, effort: str
) -> Finished:
    """A mesh cleaned up, filled anew and smoothed.

    Args:
        mesh, wanted, smooth, clean, effort: as for `finish`.
        fixed: (n,) bool, vertices that stay where they are.
        kept: how many vertices come first that keep their numbers.
    """
    best = cleaned(mesh, wanted, fixed, kept, smooth, clean)
    if not clean:
        return best
    given = best
    for ways in range(2 if EFFORTS[effort].both else 1):
        other = refilled(given, wanted, fixed[:kept], EFFORTS[effort], ways, smooth)
        if other.patches and no_worse(mesh, other.mesh) and better(best.mesh, other.mesh):
            best = other
    return best


def cleaned(mesh: Mesh, wanted: SizeField, fixed: np.ndarray, kept: int, smooth: bool, clean: bool) -> Finished:
    """A mesh cleaned up and smoothed; the mesh itself if that makes it worse."""
    work = build(mesh.vertices, mesh.quads, fixed, mesh.on_boundary)
    if smooth:
        relax(work, wanted, False, FIRST_STEPS)
    sequences = clean_up(work, wanted) if clean else 0
    if smooth:
        relax(work, wanted, False, STEPS)
        relax(work, wanted, True, SHARP_STEPS)
    vertices, quads = compact(work, kept)
    finished = replace(mesh, vertices=vertices, quads=quads)
    if no_worse(mesh, finished):
        return Finished(finished, sequences)
    return cleaned(mesh, wanted, fixed, kept, smooth, False) if smooth and clean else Finished(mesh, 0)


def refilled(
    before: Finished, wanted: SizeField, fixed: np.ndarray, effort: Effort, ways: int, smooth: bool
) -> Finished:
    """A finished mesh with patches filled anew, and smoothed; ``fixed``: (k,) bool, which of the first k stay."""
    mesh, kept = before.mesh, len(fixed)
    stays = np.zeros(len(mesh.vertices), dtype=np.bool_)
    stays[:kept] = fixed
    work = build(mesh.vertices, mesh.quads, stays, mesh.on_boundary, ROOM)
    patches = refill(work, wanted, effort, ways)
    if patches == 0:
        return before
    if smooth:
        relax(work, wanted, False, STEPS)
        relax(work, wanted, True, SHARP_STEPS)
    vertices, quads = compact(work, kept)
    return Finished(replace(mesh, vertices=vertices, quads=quads), before.sequences, patches)


def better(before: Mesh, after: Mesh) -> bool:
    """Whether fewer irregular vertices, or better elements, are worth what else a mesh has lost."""
    old, new = convex_quality(before.vertices, before.quads), convex_quality(after.vertices, after.quads)
    fewer = len(irregular(before)) - len(irregular(after))
    if fewer < 0 or new.min() < min(float(old.min()), FLOOR):
        return False
    if fewer == 0:
        return bool(new.mean() >= old.mean())
    lost = (old.mean() - new.mean(), np.percentile(old, 5) - np.percentile(new, 5), old.min() - new.min())
    gained = max(0.0, -float(lost[0]))
    return all(each <= most + gained for each, most in zip(lost, LOST, strict=True))


def no_worse(before: Mesh, after: Mesh) -> bool:
    """Whether a finished mesh is as good as promised."""
    old, new = convex_quality(before.vertices, before.quads), convex_quality(after.vertices, after.quads)
    fine = bool(new.mean() >= old.mean() and new.min() >= min(float(old.min()), FLOOR))
    return fine and len(irregular(after)) <= len(irregular(before))


def relax(work: Halfedges, wanted: SizeField, sharp: bool, steps: int) -> None:
    """Move all interior vertices at once, but for those around elements that would become too poor."""
    count, quads = work.counts[VERTICES], work.quads[: work.counts[QUADS]]
    quads = quads[quads[:, 0] != NONE]
    start = work.xy[:count].copy()
    limit = min(float(convex_quality(start, quads).min()), FLOOR)
    free = ~work.fixed[:count] & (work.degree[:count] > 0)
    memory = descent(count, wanted)
    for _ in range(HOLDS):
        order = np.argsort(~free, kind="stable")
        place = np.empty_like(order)
        place[order] = np.arange(count)
        moved, corners = start[order], place[quads]
        descend(moved, corners, int(free.sum()), sharp, steps, LEAST_FALL, memory)
        poor = convex_quality(moved, corners) < limit
        if not poor.any():
            work.xy[order] = moved
            return
        held = np.zeros(count, dtype=np.bool_)
        held[quads[poor]] = True
        held[quads[held[quads].any(axis=1)]] = True
        free &= ~held
