"""The elements of a patch make way for those of a filling, in the mesh itself."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from envs.kernels.jit import inner
from envs.types import Ints
from freemesh_ray.finish import halfedges
from freemesh_ray.finish.halfedges import NONE, Halfedges, after, around, before, origin
from freemesh_ray.finish.refill import ring_filling as fill
from freemesh_ray.finish.refill.growth import LOOP, SIZE, Growth, following, new_mark, shrink
from freemesh_ray.finish.refill.ring_filling import Filling


class Exchange(NamedTuple):
    """Working memory.

    Attributes:
        first: (N,) int64, the last half-edge of the filling that leaves a vertex, and
        chain: (4 Q,) int64, the one before it.
        opposite: (4 Q,) int64, the half-edge of the filling on the other side; -2 - i across edge i of the loops.
        beyond: (R,) int64, the half-edge outside across each edge of the loops.
        vertex: (N,) int64, the mesh's vertex for each of the filling.
        inside: (V,) int64, the vertices inside the old patch.
        version: (M,) int64, how often an element was exchanged.
        counts: (1,) int64, vertices inside the old patch.
    """

    first: Ints
    chain: Ints
    opposite: Ints
    beyond: Ints
    vertex: Ints
    inside: Ints
    version: Ints
    counts: Ints


def exchange_of(mesh: Halfedges, filling: Filling) -> Exchange:
    """Room for any filling of a patch of a mesh."""
    n, m = len(filling.xy), len(filling.quads)

    def ints(count: int) -> Ints:
        return np.zeros(count, dtype=np.int64)

    return Exchange(
        first=ints(n), chain=ints(4 * m), opposite=ints(4 * m), beyond=ints(len(filling.loop)), vertex=ints(n),
        inside=ints(len(mesh.xy)), version=ints(len(mesh.quads)), counts=ints(1),
    )  # fmt: skip


@inner
def _joined_outside(mesh: Halfedges, growth: Growth, u: int, w: int) -> bool:
    """Whether an edge that no element of the patch has joins two vertices of the loop."""
    spoke = mesh.out[u]
    for _ in range(mesh.degree[u]):
        if not growth.inside[spoke >> 2] and (origin(mesh, after(spoke)) == w or origin(mesh, before(spoke)) == w):
            return True
        spoke = around(mesh, spoke)
    return False


@inner
def link(mesh: Halfedges, growth: Growth, filling: Filling, exchange: Exchange) -> bool:
    """Find what lies across each edge of the filling; False when it is no mesh of the patch, or there is no room."""
    vertices, quads, loop = filling.counts[fill.VERTICES], filling.counts[fill.QUADS], growth.counts[LOOP]
    added, gone = vertices - loop, 0
    mark = new_mark(growth)
    for i in range(loop):
        growth.vertex_mark[growth.loop[i]] = mark
    for i in range(growth.counts[SIZE]):
        for c in range(4):
            v = mesh.quads[growth.members[i], c]
            if growth.vertex_mark[v] != mark:
                growth.vertex_mark[v], exchange.inside[gone] = mark, v
                gone += 1
    if mesh.counts[halfedges.VERTICES] + added - gone >= len(mesh.xy):
        return False
    if mesh.counts[halfedges.QUADS] + quads - growth.counts[SIZE] >= len(mesh.quads):
        return False
    for v in range(vertices):
        exchange.first[v] = NONE
    for h in range(4 * quads):
        u, w = filling.quads[h >> 2, h & 3], filling.quads[h >> 2, (h + 1) & 3]
        g = exchange.first[u]
        while g != NONE:
            if filling.quads[g >> 2, (g + 1) & 3] == w:
                return False
            g = exchange.chain[g]
        exchange.chain[h], exchange.first[u] = exchange.first[u], h
    rim = 0
    for h in range(4 * quads):
        u, w = filling.quads[h >> 2, h & 3], filling.quads[h >> 2, (h + 1) & 3]
        g = exchange.first[w]
        while g != NONE and filling.quads[g >> 2, (g + 1) & 3] != u:
            g = exchange.chain[g]
        if g == NONE:
            if u >= loop or w != following(growth, u):
                return False
            g, rim = -2 - u, rim + 1
        elif u < loop and w < loop and _joined_outside(mesh, growth, growth.loop[u], growth.loop[w]):
            return False
        exchange.opposite[h] = g
    for i in range(loop):
        exchange.vertex[i] = growth.loop[i]
    for v in range(added):
        exchange.vertex[loop + v] = exchange.inside[v] if v < gone else mesh.counts[halfedges.VERTICES] + v - gone
    exchange.counts[0] = gone
    return rim == loop


@inner
def make_way(mesh: Halfedges, growth: Growth, filling: Filling, exchange: Exchange) -> None:
    """Put the linked filling in the patch's place; the patch is then empty. New vertices have no places yet."""
    vertices, quads, loop = filling.counts[fill.VERTICES], filling.counts[fill.QUADS], growth.counts[LOOP]
    size = growth.counts[SIZE]
    for i in range(loop):
        v = growth.loop[i]
        exchange.beyond[i] = mesh.opp[growth.rim[i]]
        mesh.degree[v] -= growth.uses[v]
    for i in range(exchange.counts[0]):
        v = exchange.inside[i]
        mesh.degree[v], mesh.out[v] = 0, NONE
    shrink(mesh, growth, 0)
    for i in range(size, quads):
        growth.members[i] = mesh.counts[halfedges.QUADS] + i - size
    for i in range(max(size, quads)):
        quad = growth.members[i]
        exchange.version[quad] += 1
        if i >= quads:
            mesh.quads[quad, 0] = NONE
            for c in range(4):
                mesh.opp[4 * quad + c] = NONE
    mesh.counts[halfedges.QUADS] += max(0, quads - size)
    for v in range(loop, vertices):
        new = exchange.vertex[v]
        mesh.degree[new], mesh.fixed[new], mesh.rim[new], mesh.ideal[new] = 0, False, False, 4.0
        mesh.counts[halfedges.VERTICES] = max(mesh.counts[halfedges.VERTICES], new + 1)
    for q in range(quads):
        for c in range(4):
            v = exchange.vertex[filling.quads[q, c]]
            mesh.quads[growth.members[q], c] = v
            mesh.degree[v] += 1
    for h in range(4 * quads):
        here, g = 4 * growth.members[h >> 2] + (h & 3), exchange.opposite[h]
        v = mesh.quads[here >> 2, here & 3]
        if g >= 0:
            mesh.opp[here] = 4 * growth.members[g >> 2] + (g & 3)
        else:
            mesh.opp[here] = exchange.beyond[-2 - g]
            if mesh.opp[here] != NONE:
                mesh.opp[mesh.opp[here]] = here
        if mesh.opp[here] == NONE or not mesh.rim[v]:
            mesh.out[v] = here
