"""DXF drawings: what they draw is what is read, whatever it is made of and however it is turned."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.domains.load import load, load_all
from envs.types import Domain, DomainError

ezdxf = pytest.importorskip("ezdxf")

BOX = [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)]


def drawing() -> tuple[Any, Any]:
    """A new drawing and its model space."""
    document = ezdxf.new()
    return document, document.modelspace()


def saved(document: Any, folder: Path, **options: Any) -> Path:
    """The drawing as a file."""
    path = folder / "part.dxf"
    document.saveas(path, **options)
    return path


def boundary_lengths(domain: Domain) -> np.ndarray:
    """(s,) lengths of the given segments."""
    return np.linalg.norm(np.diff(domain.points[domain.segments], axis=1)[:, 0], axis=1)


def rows(points: Any) -> set[tuple[float, float]]:
    """Points as a set."""
    return {(float(x), float(y)) for x, y in np.asarray(points)[:, :2]}


@pytest.mark.parametrize("fmt", ["asc", "bin"])
def test_a_closed_polyline_keeps_its_vertices(tmp_path: Path, fmt: str) -> None:
    document, space = drawing()
    ring = [(x * math.pi, y / 3) for x, y in BOX]
    space.add_lwpolyline(ring, close=True)
    domain = load(saved(document, tmp_path, fmt=fmt))
    assert domain.name == "part"
    np.testing.assert_array_equal(domain.points, ring)


@settings(max_examples=20)
@given(order=st.permutations(range(6)), flips=st.lists(st.booleans(), min_size=6, max_size=6))
def test_lines_in_any_order_and_direction_close(tmp_path_factory: Any, order: list[int], flips: list[bool]) -> None:
    ring = [(0.1, 0.2), (3.3, 0.1), (5.7, 2.2), (4.1, 4.9), (1.3, 4.4), (-1.7, 2.6)]
    document, space = drawing()
    for i in order:
        a, b = ring[i], ring[(i + 1) % 6]
        space.add_line(*((b, a) if flips[i] else (a, b)))
    domain = load(saved(document, tmp_path_factory.mktemp("dxf")))
    assert rows(domain.points) == set(ring)
    assert len(domain.segments) == 6


def test_ends_that_differ_in_the_seventh_digit_meet_and_larger_gaps_are_named(tmp_path: Path) -> None:
    for gap, meets in ((1e-7, True), (1e-3, False)):
        document, space = drawing()
        for a, b in zip(BOX, [*BOX[1:], BOX[0]], strict=True):
            space.add_line(a, (b[0] + gap, b[1]))
        path = saved(document, tmp_path)
        if meets:
            assert len(load(path).ring) == 4
        else:
            with pytest.raises(DomainError, match=r"a curve ends at .* the nearest open end is 0\.001 away at"):
                load(path)


def test_slot_of_lines_and_arcs(tmp_path: Path) -> None:
    document, space = drawing()
    space.add_line((0, 0), (4, 0))
    space.add_arc((4, 1), 1, -90, 90)
    space.add_line((4, 2), (0, 2))
    space.add_arc((0, 1), 1, 90, 270)
    path = saved(document, tmp_path)
    domain = load(path, fix_parity=True)
    assert domain.area == pytest.approx(8 + math.pi, rel=0.02)
    fine = load(path, edge_length=0.1)
    lengths = boundary_lengths(fine)
    assert len(fine.ring) % 2 == 0
    assert len(fine.ring) == pytest.approx((8 + 2 * math.pi) / 0.1, abs=3)
    assert 0.095 < lengths.min() <= lengths.max() < 0.105
    assert {(0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (0.0, 2.0)} <= rows(fine.points), "where line and arc meet"
    right = fine.points[fine.points[:, 0] > 4.0]
    np.testing.assert_allclose(np.linalg.norm(right - [4, 1], axis=1), 1.0, rtol=2e-4)


@pytest.mark.parametrize("bulge", [0.2, 1.0, 2.5, -0.2, -0.5, 1e-9])
def test_bulges_are_arcs(tmp_path: Path, bulge: float) -> None:
    document, space = drawing()
    space.add_lwpolyline([(0, 0, 0.0), (8, 0, bulge), (8, 4, 0.0), (0, 4, 0.0)], format="xyb", close=True)
    domain = load(saved(document, tmp_path), edge_length=0.05)
    # A circular segment of chord c and sweep 4 atan(b).
    sweep = 4 * math.atan(bulge)
    radius = 4 / (2 * math.sin(abs(sweep) / 2))
    segment = math.copysign(radius**2 / 2 * (abs(sweep) - math.sin(abs(sweep))), bulge)
    assert domain.area == pytest.approx(32 + segment, rel=2e-4)
    assert {(8.0, 0.0), (8.0, 4.0)} <= rows(domain.points)


def test_loops_inside_loops_are_holes_and_islands(tmp_path: Path) -> None:
    document, space = drawing()
    space.add_circle((5, 5), 1)
    space.add_lwpolyline([(0, 0), (20, 0), (20, 10), (0, 10)], close=True)
    space.add_circle((5, 5), 3)
    space.add_ellipse((14, 5), (3, 0), 0.5)
    plate, island = sorted(load_all(saved(document, tmp_path), edge_length=0.2), key=lambda d: -d.area)
    assert {plate.name, island.name} == {"part[0]", "part[1]"}
    assert plate.area == pytest.approx(200 - math.pi * 9 - math.pi * 4.5, rel=1e-3)
    assert island.area == pytest.approx(math.pi, rel=1e-2)


def test_lines_shared_by_two_rooms_bound_both(tmp_path: Path) -> None:
    document, space = drawing()
    corners = [(0, 0), (2, 0), (5, 0), (5, 2), (2, 2), (0, 2)]
    for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
        space.add_line(a, b)
    space.add_line((2, 0), (2, 2))
    space.add_circle((1, 1), 0.4)
    path = saved(document, tmp_path)
    left, right = sorted(load_all(path, edge_length=0.3), key=lambda d: d.points[:, 0].max())
    assert left.area == pytest.approx(4 - math.pi * 0.16, rel=2e-2)
    assert right.area == pytest.approx(6)
    wall = [{p for p in rows(domain.points) if p[0] == 2.0} for domain in (left, right)]
    assert wall[0] == wall[1]
    assert len(wall[0]) == 8
    with pytest.raises(DomainError, match="2 polygons where exactly one"):
        load(path)


def test_splines_and_ellipses_chain_with_lines(tmp_path: Path) -> None:
    document, space = drawing()
    space.add_open_spline([(0, 0), (1, -2), (3, 2), (4, 0)])
    space.add_line((4, 0), (4, 3))
    space.add_ellipse((2, 3), (2, 0), 0.5, 0, math.pi)
    space.add_line((0, 0), (0, 3))
    domain = load(saved(document, tmp_path), edge_length=0.05)
    # The spline is antisymmetric about (2, 0): it encloses nothing on balance.
    assert domain.area == pytest.approx(12 + math.pi, rel=1e-3)


def test_mirrored_entities_and_blocks(tmp_path: Path) -> None:
    document, space = drawing()
    block = document.blocks.new("tab")
    block.add_lwpolyline([(0, 0), (2, 0), (2, 1, 0, 0, 1.0), (0, 1)], close=True)
    block.add_circle((1, 0.5), 0.2)
    space.add_blockref("tab", (10, 0))
    space.add_blockref("tab", (0, 5), dxfattribs={"xscale": -2, "yscale": 2, "rotation": 30})
    small, large = sorted(load_all(saved(document, tmp_path), edge_length=0.05), key=lambda d: d.area)
    exact = 2 + math.pi / 2 - math.pi * 0.04
    assert small.area == pytest.approx(exact, rel=3e-3)
    assert large.area == pytest.approx(4 * exact, rel=1e-3)


def test_other_entities_hidden_layers_and_copies_are_passed_over(tmp_path: Path) -> None:
    document, space = drawing()
    document.layers.add("aid").off()
    space.add_line((-9, -9), (9, 9), dxfattribs={"layer": "aid"})
    space.add_text("plate")
    space.add_point((1, 1))
    for _ in range(2):
        space.add_lwpolyline(BOX, close=True)
        for a, b in [((6, 0), (7, 0)), ((7, 0), (7, 1)), ((7, 1), (6, 1)), ((6, 1), (6, 0))]:
            space.add_line(a, b)
    assert sorted(domain.area for domain in load_all(saved(document, tmp_path))) == [1.0, 12.0]


def test_polylines_of_the_old_kind(tmp_path: Path) -> None:
    document, space = drawing()
    space.add_polyline2d(BOX, close=True)
    np.testing.assert_array_equal(load(saved(document, tmp_path)).points, BOX)


@pytest.mark.parametrize("edge_length", [None, 0.1])
def test_flattening_is_the_same_at_every_scale(tmp_path: Path, edge_length: float | None) -> None:
    counts = []
    for scale in (1e-6, 1.0, 1e6):
        document, space = drawing()
        space.add_ellipse((0, 0), (2 * scale, scale), 0.4)
        length = None if edge_length is None else edge_length * scale
        counts.append(len(load(saved(document, tmp_path), edge_length=length, fix_parity=True).ring))
    assert counts[0] == counts[1] == counts[2]


def test_a_drawing_without_an_outline_says_what_is_in_it(tmp_path: Path) -> None:
    document, space = drawing()
    space.add_text("plate")
    with pytest.raises(DomainError, match=r"part\.dxf: no outline among its 1 entities \(1 TEXT\); draw closed curves"):
        load(saved(document, tmp_path))
    path = tmp_path / "none.dxf"
    path.write_text("no drawing")
    with pytest.raises(DomainError, match=r"none\.dxf: not a valid DXF drawing"):
        load(path)


@pytest.mark.slow
def test_blocks_in_blocks_end(tmp_path: Path) -> None:
    document, space = drawing()
    for level in range(12):
        block = document.blocks.new(f"b{level}")
        for _ in range(12):
            if level:
                block.add_blockref(f"b{level - 1}", (0, 0))
    space.add_blockref("b11", (0, 0))
    with pytest.raises(DomainError, match=r"more than .* inserted blocks"):
        load(saved(document, tmp_path))
