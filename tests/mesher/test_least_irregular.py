"""Domains that a person would draw as a grid, or as a few, come out so: in any place, begun at any vertex."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from envs.types import Floats
from freemesh_ray.mesh_geometry.metrics import irregular
from freemesh_ray.mesher.polygon_to_mesh import Mesh, mesh
from freemesh_ray.policies.policy import DENSITY, SHIPPED, Policy


@cache
def policy(density: str = DENSITY) -> Policy:
    return Policy.load(SHIPPED[density])


def box(columns: int, rows: int) -> Floats:
    """The boundary of so many unit squares, with a vertex at every one of them."""
    i, j = np.arange(columns), np.arange(rows)
    sides = (
        np.stack([i, 0 * i], axis=1), np.stack([0 * j + columns, j], axis=1),
        np.stack([columns - i, 0 * i + rows], axis=1), np.stack([0 * j, rows - j], axis=1),
    )  # fmt: skip
    return np.concatenate(sides).astype(float)


def disc(n: int) -> Floats:
    turn = 2.0 * np.pi * np.arange(n) / n
    return np.stack([np.cos(turn), np.sin(turn)], axis=1)


def moved(ring: Floats, turn: float, begin: int, scale: float, shift: tuple[float, float]) -> Floats:
    matrix = scale * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return np.roll(ring, begin, axis=0) @ matrix.T + np.array(shift)


def made(ring: Floats, density: str = DENSITY) -> tuple[Mesh, dict[str, float]]:
    result = mesh(ring, policy=policy(density))
    np.testing.assert_array_equal(result.vertices[: len(ring)], ring)
    return result, result.quality()


@pytest.mark.parametrize(("turn", "begin", "scale", "shift"), [
    (0.0, 0, 1.0, (0.0, 0.0)), (0.3, 7, 1e-3, (5.0, -2.0)), (2.0, 33, 250.0, (-1e4, 3e3)),
])  # fmt: skip
@pytest.mark.parametrize(("columns", "rows"), [(20, 20), (40, 40), (80, 80), (40, 10), (7, 3), (24, 1)])
def test_boxes_are_grids(
    columns: int, rows: int, turn: float, begin: int, scale: float, shift: tuple[float, float]
) -> None:
    result, quality = made(moved(box(columns, rows), turn, begin, scale, shift))
    assert len(result.quads) == columns * rows
    assert len(irregular(result)) == quality["singularity_least"] == 0
    assert quality["eta_min"] > 0.999


@pytest.mark.parametrize(("density", "n", "most", "eta"), [
    ("medium", 40, 8, 0.92), ("medium", 80, 8, 0.96), ("medium", 200, 8, 0.98),
    ("even", 40, 8, 0.90), ("even", 80, 12, 0.92), ("even", 200, 24, 0.95),
])  # fmt: skip
def test_discs_have_few_irregular_nodes(density: str, n: int, most: int, eta: float) -> None:
    result, quality = made(disc(n), density)
    assert quality["singularity_least"] == 4
    assert len(irregular(result)) <= most
    assert quality["eta"] >= eta


def test_more_effort_never_gives_more_irregular_nodes() -> None:
    ring = np.array([[0, 0], [6, 0], [6, 2], [2.5, 2], [2.5, 5], [0, 5]], dtype=float)
    counts = [
        len(irregular(mesh(ring, edge_length=0.4, policy=policy(), effort=effort)))
        for effort in ("quick", "usual", "thorough")
    ]
    assert counts == sorted(counts, reverse=True)


def test_the_command_knows_all_efforts() -> None:
    from freemesh_ray.cli.command import parser
    from freemesh_ray.finish import EFFORTS, USUAL

    for effort in EFFORTS:
        assert parser().parse_args(["mesh", "D4", "-o", "o.obj", "--effort", effort]).effort == effort
    assert parser().parse_args(["mesh", "D4", "-o", "o.obj"]).effort == USUAL
