"""The clean-up: a better mesh of the same domain, with fewer irregular vertices, never with more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rough_meshes import SHAPES, fan, grid, halfedges, rough
from test_halfedges import check

from envs.mesh import Mesh
from envs.quality import element_quality
from freemesh_ray.finish.changes import irregularity
from freemesh_ray.finish.cleanup import FLOOR, clean_up
from freemesh_ray.finish.halfedges import LOGGED, VERTICES, Halfedges, compact
from freemesh_ray.finish.optimiser import NO_SIZES
from freemesh_ray.finish.patch import ELEMENTS, copy, patch_of, size, surround

pytestmark = pytest.mark.slow


def cleaned(mesh: Mesh) -> tuple[Mesh, Halfedges, int]:
    work = halfedges(mesh)
    kept = clean_up(work, NO_SIZES)
    vertices, quads = compact(work, int(mesh.segments.max()) + 1)
    return replace(mesh, vertices=vertices, quads=quads), work, kept


def total(work: Halfedges) -> float:
    """Irregularity of the whole mesh."""
    return sum(irregularity(work, v) for v in range(work.counts[VERTICES]) if work.degree[v] > 0)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", range(3))
def test_what_comes_out_is_a_better_mesh_of_the_same_domain(shape: str, seed: int) -> None:
    mesh = rough(shape, seed)
    result, work, kept = cleaned(mesh)
    assert result.defects(mesh.areas.sum()) == []
    check(work)
    rim = mesh.on_boundary
    np.testing.assert_array_equal(result.vertices[np.flatnonzero(rim)], mesh.vertices[rim])
    before, after = element_quality(mesh.vertices, mesh.quads), element_quality(result.vertices, result.quads)
    assert after.min() >= min(before.min(), FLOOR)
    if kept == 0:
        np.testing.assert_array_equal(result.quads, mesh.quads)
        np.testing.assert_array_equal(result.vertices, mesh.vertices)
    else:
        assert after.mean() > before.mean()
        assert total(work) <= total(halfedges(mesh)) + 1e-9


def test_random_changes_are_undone_by_the_clean_up() -> None:
    before = after = 0.0
    for seed in range(6):
        mesh = rough("square", seed, changes=8)
        before += total(halfedges(mesh))
        after += total(cleaned(mesh)[1])
    assert before > 60.0
    assert after < 0.35 * before


def test_regular_vertices_are_worth_poorer_elements() -> None:
    """On leaning grids elements are better around some irregular vertices: most of those vanish all the same."""
    before = after = 0.0
    for seed in range(10):
        mesh = rough("square", seed, changes=6)
        mesh = replace(mesh, vertices=mesh.vertices @ np.array([[1.0, 0.0], [0.8, 1.0]]))
        before += total(halfedges(mesh))
        after += total(cleaned(mesh)[1])
    assert after < 0.08 * before


@pytest.mark.parametrize("shape", ["square", "ring", "cell", "strip"])
def test_a_regular_mesh_stays_as_it_is(shape: str) -> None:
    mesh = grid(shape)
    result, work, kept = cleaned(mesh)
    assert kept == work.counts[LOGGED] == 0
    np.testing.assert_array_equal(result.vertices, mesh.vertices)
    np.testing.assert_array_equal(result.quads, mesh.quads)


@pytest.mark.parametrize("elements", [5, 8, 12, 32, 33, 60])
def test_vertices_with_many_elements_do_no_harm(elements: int) -> None:
    mesh = fan(elements)
    result, work, _ = cleaned(mesh)
    assert result.defects(mesh.areas.sum()) == []
    check(work)
    assert (element_quality(result.vertices, result.quads)).min() >= element_quality(mesh.vertices, mesh.quads).min()


@pytest.mark.parametrize("shape", SHAPES)
def test_a_patch_is_all_elements_around_its_vertices(shape: str) -> None:
    mesh = rough(shape, 1)
    work = halfedges(mesh)
    patch = patch_of(work, NO_SIZES)
    for seed in range(len(mesh.vertices)):
        surround(work, patch, seed)
        copy(work, patch, len(mesh.vertices), len(mesh.quads))
        inner = np.flatnonzero(patch.vertex_stamp == patch.vertex_stamp.max())
        elements = np.flatnonzero(patch.quad_stamp == patch.vertex_stamp.max())
        if seed in inner:
            np.testing.assert_array_equal(np.flatnonzero(np.isin(mesh.quads, inner).any(axis=1)), elements)
            assert size(patch) == len(elements) <= ELEMENTS


def test_the_same_mesh_twice() -> None:
    mesh = rough("L", 4)
    first, second = cleaned(mesh)[0], cleaned(mesh)[0]
    np.testing.assert_array_equal(first.vertices, second.vertices)
    np.testing.assert_array_equal(first.quads, second.quads)
