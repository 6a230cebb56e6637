"""Plain Laplacian smoothing: what it moves, what it never does, and where it ends."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.domains.load import from_rings, load
from envs.mesh import Mesh
from freemesh_ray.compare.laplacian import smoothed
from freemesh_ray.mesher import mesh_domain
from freemesh_ray.policies.policy import SHIPPED, Policy

SIDE = 4
GRID = [[x, y] for y in range(SIDE + 1) for x in range(SIDE + 1)]
RING = [[x, 0] for x in range(SIDE)] + [[SIDE, y] for y in range(SIDE)]
RING += [[x, SIDE] for x in range(SIDE, 0, -1)] + [[0, y] for y in range(SIDE, 0, -1)]
INSIDE = [point for point in GRID if point not in RING]


def shaken(shifts: np.ndarray) -> Mesh:
    """A grid of squares, its (SIDE - 1)^2 interior vertices shifted."""
    domain = from_rings(RING, name="grid")
    number = {tuple(point): i for i, point in enumerate([*RING, *INSIDE])}
    quads = [
        [number[x, y], number[x + 1, y], number[x + 1, y + 1], number[x, y + 1]]
        for y in range(SIDE)
        for x in range(SIDE)
    ]
    return Mesh("grid", np.vstack([domain.points, INSIDE + shifts]), np.array(quads), domain.segments, True)


SHIFTS = st.lists(st.floats(-0.2, 0.2), min_size=2 * len(INSIDE), max_size=2 * len(INSIDE))


@given(SHIFTS)
def test_a_shaken_grid_becomes_a_grid(shifts: list[float]) -> None:
    mesh = shaken(np.reshape(shifts, (-1, 2)))
    assert not mesh.defects(area=SIDE**2)
    np.testing.assert_allclose(smoothed(mesh, 200).vertices[len(RING) :], INSIDE, atol=1e-9)


def test_one_sweep_is_the_mean_of_the_neighbours() -> None:
    mesh = shaken(np.random.default_rng(0).uniform(-0.2, 0.2, (len(INSIDE), 2)))
    ends, _ = mesh.edges
    for vertex in range(len(RING), len(mesh.vertices)):
        around = ends[(ends == vertex).any(axis=1)]
        expected = mesh.vertices[around[around != vertex]].mean(axis=0)
        assert smoothed(mesh, 1).vertices[vertex] == pytest.approx(expected)


@settings(max_examples=15)
@given(st.integers(0, 10_000))
def test_meshes_stay_valid_with_their_connectivity_and_boundary(seed: int) -> None:
    domain = load(f"random:{seed}?vertices=40")
    raw = mesh_domain(Policy.load(SHIPPED["medium"]), domain, smooth=False, clean=False).raw
    after = smoothed(raw)
    assert not after.defects(area=domain.area)
    assert (after.quads == raw.quads).all()
    assert (after.vertices[raw.on_boundary] == raw.vertices[raw.on_boundary]).all()
    assert (smoothed(raw, 0).vertices == raw.vertices).all()
