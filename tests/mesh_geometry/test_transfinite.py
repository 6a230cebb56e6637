"""Structured zones: valid grids on given boundaries, exact where the map is known, told where they fail."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.polygons.rings import signed_area
from envs.types import DomainError, Floats
from freemesh_ray.mesh_geometry.metrics import irregular
from freemesh_ray.mesh_geometry.transfinite import divided, transfinite


def joined(*sides: Floats) -> tuple[Floats, list[int]]:
    """The ring of four sides, and its corners."""
    corners = np.cumsum([0, *(len(side) - 1 for side in sides[:-1])]).tolist()
    return np.concatenate([side[:-1] for side in sides]), corners


def test_an_even_and_a_graded_rectangle_are_grids() -> None:
    corners = np.array([[0, 0], [3, 0], [3, 2], [0, 2.0]])
    ends = [corners[[i, (i + 1) % 4]] for i in range(4)]
    ratios = (4.0, 0.2, 0.25, 5.0)
    ring, at = joined(*(divided(side, n, r) for side, n, r in zip(ends, (6, 4, 6, 4), ratios, strict=True)))
    mesh = transfinite(ring, at, "zone", ("low", "right", "", "low"))
    assert mesh.defects(6.0) == []
    assert len(mesh.quads) == 24
    xs, ys = (np.unique(np.round(mesh.vertices[:, axis], 12)) for axis in (0, 1))
    assert len(xs) == 7
    assert len(ys) == 5
    widths = np.diff(xs)
    np.testing.assert_allclose(widths[1:] / widths[:-1], 4.0**0.2)
    np.testing.assert_allclose(np.diff(ys)[-1] / np.diff(ys)[0], 0.2)
    np.testing.assert_array_equal(mesh.vertices[: len(ring)], ring)
    assert len(irregular(mesh)) == 0
    assert {name: len(group) for name, group in mesh.groups.sides.items()} == {"low": 10, "right": 4}
    assert {tuple(s) for s in mesh.groups.sides["low"].tolist()} <= {tuple(s) for s in mesh.segments.tolist()}


@settings(max_examples=60)
@given(
    columns=st.integers(1, 12), rows=st.integers(1, 12), sweep=st.floats(0.2, 3.0), ratio=st.floats(0.2, 5.0),
    begin=st.integers(0, 50),
)  # fmt: skip
def test_part_of_a_ring_is_a_polar_grid(columns: int, rows: int, sweep: float, ratio: float, begin: int) -> None:
    t = np.linspace(0.0, sweep, rows + 1)
    arc = np.stack([np.cos(t), np.sin(t)], axis=1)
    inwards = divided(np.array([2.0 * arc[-1], arc[-1]]), columns, 1.0 / ratio)
    ring, corners = joined(divided(np.array([arc[0], 2.0 * arc[0]]), columns, ratio), 2.0 * arc, inwards, arc[::-1])
    mesh = transfinite(ring, corners, "zone")
    assert mesh.defects(signed_area(ring)) == []
    steps = ratio ** (np.arange(columns) / max(1, columns - 1))
    radii = 1.0 + np.concatenate([[0.0], np.cumsum(steps) / steps.sum()])
    expected = np.outer(radii, np.exp(1j * t)).ravel()
    found = mesh.vertices @ np.array([1.0, 1j])
    assert np.abs(found[:, None] - expected).min(axis=1).max() < 1e-12
    # Wherever the ring begins, and whichever corner is the first one.
    start = begin % len(ring)
    turned = np.roll(ring, -start, axis=0)
    again = transfinite(turned, sorted((np.array(corners) - start) % len(ring)), "zone")
    assert again.defects(signed_area(ring)) == []
    assert np.abs(again.vertices @ np.array([1.0, 1j]) - expected[:, None]).min(axis=0).max() < 1e-12


@settings(max_examples=60)
@given(seed=st.integers(0, 10_000))
def test_bent_zones_are_valid_or_told(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = np.array([[0, 0], [3, 0], [3, 2], [0, 2.0]]) + rng.uniform(-0.6, 0.6, (4, 2))
    counts = rng.integers(1, 9, 2)
    sides = []
    for i in range(4):
        a, b = corners[i], corners[(i + 1) % 4]
        t = np.linspace(0, 1, 30)[:, None]
        normal = np.array([[b[1] - a[1], a[0] - b[0]]])
        side = a + t * (b - a) + rng.uniform(-0.3, 0.3) * np.sin(np.pi * t) * normal
        sides.append(divided(side, int(counts[i % 2]), rng.uniform(0.3, 3.0)))
    ring, at = joined(*sides)
    try:
        mesh = transfinite(ring, at, "zone")
    except DomainError:
        with pytest.raises(DomainError, match=r"^zone: a structured zone of this shape has an element at \(.*\)"):
            transfinite(ring, at, "zone")
    else:
        assert mesh.defects(signed_area(ring)) == []


def test_of_a_parallelogram_lines_between_opposite_points_stay_straight() -> None:
    corners = np.array([[0, 0], [4, 0], [5, 2], [1, 2.0]])
    ratios = (6.0, 3.0, 3.0, 0.5)
    sides = [divided(corners[[i, (i + 1) % 4]], (5, 4)[i % 2], ratios[i]) for i in range(4)]
    ring, at = joined(*sides)
    mesh = transfinite(ring, at, "zone")
    ways = np.array([corners[1], corners[3]])
    for lines in ((sides[0], sides[2][::-1]), (sides[3][::-1], sides[1])):
        ends = [end @ np.linalg.inv(ways) for end in lines]
        for a, b in zip(*ends, strict=True):
            off = np.cross(np.append(b - a, 0.0), np.pad(mesh.vertices @ np.linalg.inv(ways) - a, ((0, 0), (0, 1))))[
                :, 2
            ]
            assert (np.abs(off) < 1e-12).sum() == (5 if lines[0] is sides[0] else 6)


def test_what_is_no_zone_is_told() -> None:
    square = np.array([[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [0, 2.0]])
    with pytest.raises(
        DomainError, match=r"^zone: the side from \(0\.0, 0\.0\) to \(2\.0, 0\.0\) has 2 segments and the opposite one "
    ):  # fmt: skip
        transfinite(square, [0, 2, 4, 5], "zone")
    dart = np.array([[0, 0], [4, 0], [1, 1], [0, 4.0]])
    with pytest.raises(DomainError, match=r"^zone: .* an element at \(1\.25, 1\.25\) that is not convex; divide"):
        transfinite(dart, [0, 1, 2, 3], "zone")
    for count, ratio in ((0, 1.0), (3, 0.0), (3, np.nan), (3, 1e5)):
        with pytest.raises(DomainError, match=r"give 1 segment or more, and a ratio from 0\.001 to 1000"):
            divided(square[:2], count, ratio)
