"""A patch with the rings of elements around it, on trial: the old elements' cost, and the new ones settled.

The vertices of the rings may move, too, but for those at their outer edge and on the domain's boundary.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from envs.kernels.jit import inlined, inner
from envs.mdp.size_field import SizeField
from envs.quality import eta_or_bent
from envs.types import Floats, Ints
from freemesh_ray.finish.halfedges import Halfedges, around
from freemesh_ray.finish.optimiser import Descent, cost_of, descend, descent
from freemesh_ray.finish.refill import ring_filling as fill
from freemesh_ray.finish.refill.growth import LOOP, SIZE, WORK, Growth
from freemesh_ray.finish.refill.ring_filling import Filling

#: Rings of elements around a patch.
RINGS = 2

# Entries of Region.counts.
RING, RING_STAMP, FREE, VERTICES, QUADS, STAMP = range(6)


class Region(NamedTuple):
    """Working memory.

    Attributes:
        ring: (M,) int64, elements around the patch.
        stamp: (M,) int64, the stamp of the last region that an element was in.
        uses: (V,) int64, elements of the ring around each vertex, valid with ``uses_stamp``.
        uses_stamp: (V,) int64.
        local: (V,) int64, where a vertex is in the region, valid with ``local_stamp``.
        local_stamp: (V,) int64.
        vertices: (N,) int64, the vertices of the region, those that may move first; of new ones -1 less their number
            in the filling.
        xy: (N, 2) float64; quads: (Q, 4) int64, on trial.
        place: (N,) int64, where each vertex of the filling is in the region.
        descent: working memory.
        counts: (6,) int64: elements of the ring; the ring's stamp; moving vertices, vertices, elements of the region;
            its stamp.
    """

    ring: Ints
    stamp: Ints
    uses: Ints
    uses_stamp: Ints
    local: Ints
    local_stamp: Ints
    vertices: Ints
    xy: Floats
    quads: Ints
    place: Ints
    descent: Descent
    counts: Ints


def region_of(mesh: Halfedges, filling: Filling, wanted: SizeField) -> Region:
    """Room for any patch of a mesh, for which such sizes are wanted."""
    n, m = len(mesh.xy), len(mesh.quads)
    most, new = m + len(filling.quads), n + len(filling.xy)

    def ints(count: int) -> Ints:
        return np.zeros(count, dtype=np.int64)

    return Region(
        ring=ints(m), stamp=ints(m), uses=ints(n), uses_stamp=ints(n), local=ints(n), local_stamp=ints(n),
        vertices=ints(new), xy=np.zeros((new, 2)), quads=np.zeros((most, 4), dtype=np.int64),
        place=ints(len(filling.xy)), descent=descent(new, wanted), counts=ints(6),
    )  # fmt: skip


@inner
def surround(mesh: Halfedges, growth: Growth, region: Region) -> None:
    """Gather the rings around a patch."""
    region.counts[RING_STAMP] += 1
    stamp, count, begin = region.counts[RING_STAMP], 0, 0
    for i in range(growth.counts[SIZE]):
        region.stamp[growth.members[i]] = stamp
    for ring in range(RINGS):
        end = count
        vertices = growth.counts[LOOP] if ring == 0 else 4 * (end - begin)
        for i in range(vertices):
            v = growth.loop[i] if ring == 0 else mesh.quads[region.ring[begin + (i >> 2)], i & 3]
            if mesh.degree[v] > len(region.ring):
                continue
            spoke = mesh.out[v]
            for _ in range(mesh.degree[v]):
                quad = spoke >> 2
                if region.stamp[quad] != stamp:
                    region.stamp[quad], region.ring[count] = stamp, quad
                    count += 1
                spoke = around(mesh, spoke)
        begin = end if ring > 0 else 0
    for i in range(count):
        for c in range(4):
            v = mesh.quads[region.ring[i], c]
            if region.uses_stamp[v] != stamp:
                region.uses_stamp[v], region.uses[v] = stamp, 0
            region.uses[v] += 1
    region.counts[RING] = count


@inlined
def _enter(mesh: Halfedges, region: Region, vertex: int, at: int, stamp: int) -> int:
    """Give a vertex a place in the region if it has none; how many there are."""
    if region.local_stamp[vertex] == stamp:
        return at
    region.local[vertex], region.local_stamp[vertex], region.vertices[at] = at, stamp, vertex
    region.xy[at, 0], region.xy[at, 1] = mesh.xy[vertex, 0], mesh.xy[vertex, 1]
    return at + 1


@inner
def copy_old(mesh: Halfedges, growth: Growth, region: Region) -> None:
    """Copy the patch as it is, with the rings around it."""
    region.counts[STAMP] += 1
    stamp, n, patch = region.counts[STAMP], 0, growth.counts[SIZE]
    for i in range(patch + region.counts[RING]):
        quad = growth.members[i] if i < patch else region.ring[i - patch]
        for c in range(4):
            v = mesh.quads[quad, c]
            n = _enter(mesh, region, v, n, stamp)
            region.quads[i, c] = region.local[v]
    region.counts[VERTICES], region.counts[QUADS] = n, patch + region.counts[RING]


@inner
def copy_new(mesh: Halfedges, growth: Growth, region: Region, filling: Filling) -> None:
    """Copy the filling with the rings around it, the vertices that may move first."""
    region.counts[STAMP] += 1
    stamp, loop, n = region.counts[STAMP], growth.counts[LOOP], 0
    for v in range(loop, filling.counts[fill.VERTICES]):
        region.vertices[n], region.place[v] = -1 - v, n
        region.xy[n, 0], region.xy[n, 1] = filling.xy[v, 0], filling.xy[v, 1]
        n += 1
    for moving in range(2):
        for i in range(loop + 4 * region.counts[RING]):
            v = growth.loop[i] if i < loop else mesh.quads[region.ring[(i - loop) >> 2], (i - loop) & 3]
            here = growth.uses[v] + (region.uses[v] if region.uses_stamp[v] == region.counts[RING_STAMP] else 0)
            if (not mesh.fixed[v] and here == mesh.degree[v]) == (moving == 0):
                n = _enter(mesh, region, v, n, stamp)
        if moving == 0:
            region.counts[FREE] = n
    for i in range(loop):
        region.place[i] = region.local[growth.loop[i]]
    new = filling.counts[fill.QUADS]
    for i in range(new + region.counts[RING]):
        for c in range(4):
            if i < new:
                region.quads[i, c] = region.place[filling.quads[i, c]]
            else:
                region.quads[i, c] = region.local[mesh.quads[region.ring[i - new], c]]
    region.counts[VERTICES], region.counts[QUADS] = n, new + region.counts[RING]


@inner
def price(growth: Growth, region: Region) -> float:
    """The cost of the region's elements."""
    n, m = region.counts[VERTICES], region.counts[QUADS]
    growth.counts[WORK] += m
    return cost_of(region.xy[:n], region.quads[:m], region.descent)


@inner
def settle(growth: Growth, region: Region, steps: int, least_fall: float) -> float:
    """Move the vertices that may move to where the elements are best; their cost."""
    n, m = region.counts[VERTICES], region.counts[QUADS]
    growth.counts[WORK] += m * (steps + 1)
    return descend(region.xy[:n], region.quads[:m], region.counts[FREE], False, steps, least_fall, region.descent)


@inner
def rate(region: Region) -> float:
    """The least eta of the region's elements; -1 when one is not strictly convex."""
    least, xy = 1.0, region.xy
    for i in range(region.counts[QUADS]):
        a, b, c, d = region.quads[i, 0], region.quads[i, 1], region.quads[i, 2], region.quads[i, 3]
        eta = eta_or_bent(xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1], xy[d, 0], xy[d, 1])
        least = min(least, eta)
    return least
