"""Half-edges: changes of connectivity keep the mesh a mesh, and each can be taken back bit for bit."""

from __future__ import annotations

import numpy as np
import pytest
from rough_meshes import SHAPES, change, fan, grid, halfedges, rough

from freemesh_ray.finish.halfedges import (
    LOG,
    LOGGED,
    NONE,
    PINNED,
    QUADS,
    SIGNATURE,
    VERTICES,
    Halfedges,
    adjacent,
    commit,
    compact,
    swap,
    undo,
)
from freemesh_ray.finish.optimiser import NO_SIZES
from freemesh_ray.finish.patch import patch_of


def check(work: Halfedges) -> None:
    """Assert all that is promised of half-edges."""
    count, m = work.counts[VERTICES], work.counts[QUADS]
    alive = work.quads[:m, 0] != NONE
    h = np.flatnonzero(np.repeat(alive, 4))
    start = work.quads[h >> 2, h & 3]
    end = work.quads[h >> 2, (h + 1) & 3]
    opposite = work.opp[h]
    inner = opposite != NONE
    back = opposite[inner]
    assert alive[back >> 2].all()
    np.testing.assert_array_equal(work.opp[back], h[inner])
    np.testing.assert_array_equal(work.quads[back >> 2, back & 3], end[inner])
    np.testing.assert_array_equal(work.quads[back >> 2, (back + 1) & 3], start[inner])
    directed = start * (count + 1) + end
    assert len(np.unique(directed)) == len(directed)

    degree = np.bincount(start, minlength=count)
    free = work.degree[:count] != PINNED
    np.testing.assert_array_equal(work.degree[:count][free], degree[free])
    used = np.flatnonzero((degree > 0) & free)
    out = work.out[used]
    np.testing.assert_array_equal(work.quads[out >> 2, out & 3], used)
    rim = np.zeros(count, dtype=bool)
    rim[start[~inner]] = True
    np.testing.assert_array_equal(rim[used], work.fixed[used])
    np.testing.assert_array_equal(work.opp[out] == NONE, work.fixed[used])
    for v in used.tolist():
        spoke, turned = work.out[v], 0
        while turned < work.degree[v]:
            assert work.quads[spoke >> 2, spoke & 3] == v
            spoke, turned = work.opp[(spoke & ~3) | ((spoke + 3) & 3)], turned + 1
        assert spoke == (NONE if work.fixed[v] else work.out[v])


def euler(work: Halfedges) -> int:
    """Vertices - edges + elements."""
    quads = work.quads[: work.counts[QUADS]]
    quads = quads[quads[:, 0] != NONE]
    ends = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    return len(np.unique(quads)) - len(np.unique(ends, axis=0)) + len(quads)


def snapshot(work: Halfedges) -> list[np.ndarray]:
    """All that describes the mesh, up to what is in use."""
    n, m = int(work.counts[VERTICES]), int(work.counts[QUADS])
    parts = (work.quads[:m], work.opp[: 4 * m], work.out[:n], work.degree[:n], work.ideal[:n], work.xy[:n], work.counts)
    return [part.copy() for part in parts]


@pytest.mark.parametrize("shape", SHAPES)
def test_a_fresh_mesh_is_linked_correctly(shape: str) -> None:
    mesh = grid(shape)
    work = halfedges(mesh)
    check(work)
    assert work.counts[LOGGED] == work.counts[SIGNATURE] == 0
    edges, _ = mesh.edges
    for u, w in edges[:20].tolist():
        assert work.degree[u] == PINNED or adjacent(work, u, w)


def test_boundaries_that_meet_in_a_vertex_and_very_many_elements_pin_it() -> None:
    assert np.count_nonzero(halfedges(grid("pinch")).degree == PINNED) == 1
    assert not (halfedges(fan(12)).degree == PINNED).any()
    assert np.count_nonzero(halfedges(fan(40)).degree == PINNED) == 1


@pytest.mark.parametrize("shape", ["square", "ring", "L", "pinch"])
@pytest.mark.parametrize("seed", range(6))
def test_changes_keep_a_mesh_and_undo_takes_them_back(shape: str, seed: int) -> None:
    work, rng = halfedges(rough(shape, seed)), np.random.default_rng(seed)
    patch, made = patch_of(work, NO_SIZES), 0
    characteristic = euler(work)
    for _ in range(6):
        commit(work)
        states, logged = [snapshot(work)], [0]
        for _ in range(int(rng.integers(1, 6))):
            before = int(work.counts[LOGGED])
            if not change(work, patch, rng):
                break
            made += 1
            check(work)
            assert euler(work) == characteristic
            assert work.counts[LOGGED] - before <= LOG
            states.append(snapshot(work))
            logged.append(int(work.counts[LOGGED]))
        back = int(rng.integers(len(states)))
        undo(work, logged[back])
        for part, was in zip(snapshot(work), states[back], strict=True):
            np.testing.assert_array_equal(part, was)
        check(work)
    assert made > 6


def test_the_same_changes_in_another_order_have_the_same_signature() -> None:
    signatures, meshes = [], []
    for order in ((0, 1), (1, 0)):
        work = halfedges(grid("square", shake=0.0))
        inner = np.flatnonzero(work.opp[: 4 * work.counts[QUADS]] != NONE)
        first, far = inner[0], inner[-1]
        for i in order:
            swap(work, (first, far)[i], 0)
        signatures.append(int(work.counts[SIGNATURE]))
        meshes.append({frozenset(quad) for quad in work.quads[: work.counts[QUADS]].tolist()})
    assert signatures[0] == signatures[1] != 0
    assert meshes[0] == meshes[1]


def test_compact_drops_what_is_dead_and_keeps_the_given_vertices() -> None:
    mesh = rough("ring", 3, changes=30)
    work, rng = halfedges(mesh), np.random.default_rng(3)
    patch = patch_of(work, NO_SIZES)
    for _ in range(10):
        change(work, patch, rng)
    kept = int(mesh.segments.max()) + 1
    vertices, quads = compact(work, kept)
    np.testing.assert_array_equal(vertices[:kept], mesh.vertices[:kept])
    np.testing.assert_array_equal(np.unique(quads), np.arange(len(vertices)))
    alive = work.quads[: work.counts[QUADS]]
    alive = alive[alive[:, 0] != NONE]
    np.testing.assert_array_equal(vertices[quads], work.xy[alive])
