"""Which bridges are taken for seams: those with room around them, each at a vertex of its own."""

from __future__ import annotations

import numpy as np
import pytest

from envs.domains.load import from_ring_with_seam, from_rings
from envs.polygons import seam
from envs.polygons.seam import bridge_candidates
from envs.types import Floats

PLATE = np.array([[0, 0], [5, 0], [10, 0], [10, 5], [10, 10], [5, 10], [0, 10], [0, 5]], dtype=np.float64)


def square_hole(rng: np.random.Generator, x: float, y: float) -> Floats:
    """A square of a random size and tilt about a place."""
    angles = 0.5 * np.pi * np.arange(4) + rng.uniform(0.0, 6.0)
    centre = np.array([x, y]) + rng.uniform(-0.8, 0.8, 2)
    return centre + rng.uniform(0.4, 0.9) * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def test_seams_seldom_share_a_vertex() -> None:
    rng = np.random.default_rng(0)
    visits = []
    for _ in range(40):
        holes = [square_hole(rng, x, y) for x in (3.0, 7.0) for y in (3.0, 7.0)]
        visits.append(np.bincount(from_rings(PLATE, holes).ring).max())
    assert np.mean(np.array(visits) > 2) < 0.1, "a vertex at which one seam ends is visited twice"


def test_seams_that_share_a_vertex_do_not_cross(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seam, "SHARED_VERTEX", 0.1)
    rng = np.random.default_rng(0)
    most = 0
    for _ in range(20):
        holes = [square_hole(rng, x, y) for x in (3.0, 7.0) for y in (3.0, 7.0)]
        domain = from_rings(PLATE, holes)
        most = max(most, np.bincount(domain.ring).max())
        assert from_ring_with_seam(domain.vertices).area == pytest.approx(domain.area)
    assert most > 2


def bridge_cost(gap: float) -> float:
    """The cost of the bridge across a corridor, from (0, 0) to (0, 1), that a third ring's corner stays ``gap`` off."""
    outer = np.array([[0, 0], [100, 0], [100, 9], [-9, 9], [-9, 0]], dtype=np.float64)
    across = np.array([[0, 1], [0, 2], [90, 2], [90, 1]], dtype=np.float64)
    corner = np.array([[-gap, 0.5], [-gap - 0.3, 0.3], [-gap - 0.6, 0.5], [-gap - 0.3, 0.7]])
    points = np.concatenate([outer, across, corner])
    ring_of = np.repeat([0, 1, 2], [5, 4, 4])
    following = np.concatenate([np.roll(np.arange(a, b), -1) for a, b in ((0, 5), (5, 9), (9, 13))])
    candidates = bridge_candidates([outer, across, corner], points, ring_of, following)
    (cost,) = (bridge.cost for bridge in candidates if (bridge.start, bridge.end) == (0, 5))
    return cost


def test_a_bridge_that_passes_close_to_a_vertex_is_dear() -> None:
    assert bridge_cost(0.02) == pytest.approx(100 * bridge_cost(0.2))
    assert bridge_cost(0.2) > bridge_cost(0.4) == pytest.approx(1.0)
