"""DXF drawings as people make them: centre lines, gaps, dividing lines, layers, blocks, units."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from envs.domains.load import load_geometry
from envs.polygons.drawing import Drawing, Reading
from envs.polygons.exact_curves import CircleArc, EllipseArc, ParametricCurve
from envs.readers import dxf
from envs.types import DomainError, Floats

ezdxf = pytest.importorskip("ezdxf")

BOX = [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)]


def drawing() -> tuple[Any, Any]:
    """A new drawing without units, and its model space."""
    document = ezdxf.new(setup=True)
    document.header["$INSUNITS"] = 0
    return document, document.modelspace()


def read(document: Any, folder: Path, **reading: Any) -> Drawing:
    """The drawing as it is read from a file."""
    path = folder / "part.dxf"
    document.saveas(path)
    return dxf.drawing_of_file(path, Reading(**reading))


def areas(read_drawing: Drawing) -> list[float]:
    """Areas of the polygons, in ascending order."""
    return sorted(shapely.Polygon(rings[0], rings[1:]).area for rings in read_drawing.polygons)


def box(space: Any, layer: str = "0", gap: float = 0.0, at: tuple[float, float] = (0.0, 0.0)) -> None:
    """The box as four lines, perhaps with a gap."""
    corners = [(x + at[0], y + at[1]) for x, y in BOX]
    for i, (a, b) in enumerate(zip(corners, [*corners[1:], corners[0]], strict=True)):
        space.add_line(a, (b[0], b[1] + gap) if i == 3 else b, dxfattribs={"layer": layer})


def lines(read_drawing: Drawing, *, optional: bool = False) -> set[str]:
    """The names of lines."""
    return {line.name for line in read_drawing.lines if line.optional == optional}


def test_open_lines_are_passed_over_with_one_line(tmp_path: Path) -> None:
    document, space = drawing()
    space.add_lwpolyline(BOX, close=True)
    space.add_line((-1, 1.5), (5, 1.5), dxfattribs={"layer": "axis"})
    space.add_line((2, -1), (2, 1))
    space.add_circle((2, 1.5), 1, dxfattribs={"layer": "pitch", "linetype": "CENTER"})
    space.add_text("plate", dxfattribs={"layer": "notes"})
    space.add_linear_dim((0, -1), (0, 0), (4, 0), dxfattribs={"layer": "sizes"}).render()
    hatch = space.add_hatch(dxfattribs={"layer": "hatch"})
    hatch.paths.add_polyline_path(BOX)
    found = read(document, tmp_path)
    assert areas(found) == [12.0]
    (note,) = found.notes
    assert note == (
        "passed over: 3 open lines (layers axis, 0, pitch), 1 TEXT (layer notes), 1 DIMENSION (layer sizes), 1 HATCH "
        "(layer hatch)"
    )
    assert lines(found, optional=True) == {"axis", "pitch"}


@pytest.mark.slow
@pytest.mark.parametrize("by", ["entity", "layer", "block"])
def test_broken_line_types_are_those_of_layers_and_blocks_too(tmp_path: Path, by: str) -> None:
    document, space = drawing()
    document.layers.add("aid", linetype="DASHED")
    block = document.blocks.new("ring")
    attributes = {"entity": {"linetype": "HIDDEN"}, "layer": {"layer": "aid"}, "block": {"linetype": "BYBLOCK"}}[by]
    block.add_circle((2, 1.5), 1, dxfattribs=attributes)
    space.add_blockref("ring", (0, 0), dxfattribs={"linetype": "PHANTOM"} if by == "block" else {})
    space.add_lwpolyline(BOX, close=True)
    assert areas(read(document, tmp_path)) == [12.0]


def test_where_all_is_broken_all_counts(tmp_path: Path) -> None:
    document, space = drawing()
    space.add_lwpolyline(BOX, close=True, dxfattribs={"linetype": "DASHED"})
    space.add_circle((2, 1.5), 1, dxfattribs={"linetype": "DASHED"})
    assert [len(rings) for rings in read(document, tmp_path).polygons] == [2]


def test_an_axis_that_closes_the_half_drawn_is_a_side(tmp_path: Path) -> None:
    document, space = drawing()
    for a, b in (((0, 0), (0, 3)), ((0, 3), (4, 3)), ((4, 3), (4, 0))):
        space.add_line(a, b)
    space.add_line((0, 0), (4, 0), dxfattribs={"linetype": "CENTER", "layer": "axis"})
    space.add_line((1, 1), (2, 1), dxfattribs={"linetype": "CENTER"})
    found = read(document, tmp_path)
    assert areas(found) == [12.0]
    assert lines(found) == {"axis"}


@pytest.mark.slow
@given(gap=st.floats(2e-5, 0.04), angle=st.floats(0, 6), hole=st.booleans())
@settings(max_examples=25)
def test_gaps_are_told_and_joined_on_request(tmp_path_factory: Any, gap: float, angle: float, hole: bool) -> None:
    document, space = drawing()
    box(space, gap=gap)
    if hole:
        space.add_circle((2, 1.5), 1)
    for entity in space:
        entity.rotate_z(angle)
    folder = tmp_path_factory.mktemp("dxf")
    if hole and gap > 0.013:  # a share 1e-3 of the outline: it may be meant
        assume(gap > 0.0145)
        found = read(document, folder)
        assert areas(found)[0] < 4
        assert f"{gap:.3g} apart" in found.notes[-1]
    else:
        with pytest.raises(
            DomainError, match=r"a curve ends at .* the nearest open end is .* away at .*--join"
        ) as told:
            read(document, folder)
        assert f" is {gap:.3g} away" in str(told.value)
        join = float(str(told.value).partition("--join ")[2].partition(" ")[0])
        assert gap <= join <= 2.6 * gap
        with pytest.raises(DomainError, match="--join"):
            read(document, folder, join=0.99 * gap)
        found = read(document, folder, join=join)
        assert [len(rings) for rings in found.polygons] == [1 + hole]
        assert found.notes[0] == f"joined 1 gap of up to {gap:.3g}"
    exact = 12 - (math.pi if hole else 0)
    joined = read(document, folder, join=2 * gap)
    assert areas(joined)[0] == pytest.approx(exact, rel=0.03)


def test_joining_leaves_what_is_smaller_than_the_gap(tmp_path: Path) -> None:
    document, space = drawing()
    box(space, gap=0.05)
    space.add_lwpolyline([(1, 1), (1.04, 1), (1.04, 1.04), (1, 1.04)], close=True)
    for a, b in (((2, 1), (2.03, 1)), ((2.03, 1), (2.03, 1.03)), ((2.03, 1.03), (2, 1))):
        space.add_line(a, b)
    assert [len(ring) for ring in read(document, tmp_path, join=0.1).polygons[0]] == [4, 4, 3]


def test_an_end_that_falls_short_of_an_edge_is_joined_to_it(tmp_path: Path) -> None:
    document, space = drawing()
    space.add_lwpolyline(BOX, close=True)
    space.add_line((1, 0), (1, 2.999))
    assert areas(read(document, tmp_path)) == [12.0]
    found = read(document, tmp_path, join=0.01)
    assert areas(found) == pytest.approx([3, 9])
    assert found.notes[0] == "joined 1 gap of up to 0.001"


@pytest.mark.slow
@given(x=st.floats(0.2, 3.8), u=st.floats(0.2, 3.8), angle=st.floats(0, 6), closed=st.booleans())
@settings(max_examples=25)
def test_lines_that_end_on_edges_divide(tmp_path_factory: Any, x: float, u: float, angle: float, closed: bool) -> None:
    document, space = drawing()
    if closed:
        space.add_lwpolyline(BOX, close=True)
    else:
        box(space)
    space.add_line((x, 0), (u, 3), dxfattribs={"layer": "cut"})
    for entity in space:
        entity.rotate_z(angle)
    found = read(document, tmp_path_factory.mktemp("dxf"))
    left = 1.5 * (x + u)
    assert areas(found) == pytest.approx(sorted([left, 12 - left]))
    assert lines(found) == {"cut"}
    assert not found.notes


def bezier_area(controls: list[tuple[float, float]]) -> float:
    """The area between a cubic Bezier curve and its chord, from many points of it."""
    t = np.linspace(0, 1, 2001)[:, None]
    points = sum(math.comb(3, k) * t**k * (1 - t) ** (3 - k) * np.array(c) for k, c in enumerate(controls))
    return float(shapely.Polygon(points).area)


def test_lines_end_on_arcs_ellipses_and_splines(tmp_path: Path) -> None:
    document, space = drawing()
    space.add_circle((0, 0), 2)
    space.add_line((-1.2, 1.6), (-1.2, -1.6))
    space.add_ellipse((10, 0), (2, 0), 0.5)
    space.add_line((10 + 2 * 0.6, 0.8), (10 + 2 * 0.6, -0.8))
    space.add_open_spline([(20, 0), (21, 3), (23, 3), (24, 0)])
    space.add_line((24, 0), (20, 0))
    space.add_line((22, 0), (22, 2.25))
    found = read(document, tmp_path, edge_length=0.2)
    segment = 4 * math.acos(0.6) - 1.2 * 1.6
    cap = 2 * (math.acos(0.6) - 0.6 * 0.8)
    # The cubic with the controls (0, 0), (1, 3), (3, 3), (4, 0) has this area below it.
    half = 0.5 * bezier_area([(0, 0), (1, 3), (3, 3), (4, 0)])
    exact = [segment, 4 * math.pi - segment, cap, 2 * math.pi - cap, half, half]
    assert areas(found) == pytest.approx(sorted(exact), rel=2e-3)
    kinds = {type(line.curve) for line in found.lines if line.curve is not None}
    assert kinds == {CircleArc, EllipseArc, ParametricCurve}


def test_dividing_lines_cross_each_other_and_holes(tmp_path: Path) -> None:
    document, space = drawing()
    space.add_lwpolyline(BOX, close=True)
    space.add_circle((2, 1.5), 1)
    space.add_line((0, 1.5), (4, 1.5))
    space.add_line((2, 0), (2, 3))
    found = read(document, tmp_path, edge_length=0.05)
    quarter = 3 - math.pi / 4
    assert areas(found) == pytest.approx([quarter] * 4, rel=1e-3)
    assert not found.notes


def test_an_outline_inside_that_a_line_connects_stays_a_hole(tmp_path: Path) -> None:
    document, space = drawing()
    space.add_lwpolyline(BOX, close=True)
    space.add_lwpolyline([(1, 1), (3, 1), (3, 2), (1, 2)], close=True)
    space.add_line((0, 1.5), (1, 1.5))
    space.add_line((3, 1.5), (4, 1.5))
    assert areas(read(document, tmp_path)) == [5.0, 5.0]
    (cut,) = [entity for entity in space if entity.dxftype() == "LINE" and entity.dxf.start.x == 3]
    space.delete_entity(cut)
    found = read(document, tmp_path)
    assert areas(found) == [10.0]
    assert found.notes == ["passed over: 1 open line (layer 0)"]


def test_sides_drawn_once_more_are_names(tmp_path: Path) -> None:
    document, space = drawing()
    space.add_lwpolyline(BOX, close=True, dxfattribs={"layer": "wall"})
    space.add_line((0, 3), (0, 0), dxfattribs={"layer": "inlet"})
    space.add_line((4, 1), (4, 2), dxfattribs={"layer": "outlet"})
    path = tmp_path / "part.dxf"
    document.saveas(path)
    geometry = load_geometry(str(path), edge_length=0.5)
    (region,) = geometry.regions
    sides = region.sides
    assert set(sides) == {"wall", "inlet", "outlet"}
    assert len(sides["inlet"]) == 6
    assert len(sides["outlet"]) == 2


def test_layers_are_chosen_and_unknown_ones_told(tmp_path: Path) -> None:
    document, space = drawing()
    document.layers.add("Off").off()
    space.add_lwpolyline(BOX, close=True, dxfattribs={"layer": "Cut"})
    space.add_circle((2, 1.5), 1, dxfattribs={"layer": "engrave"})
    space.add_circle((2, 1.5), 0.5, dxfattribs={"layer": "Off"})
    assert [len(rings) for rings in read(document, tmp_path).polygons] == [2]
    assert [len(rings) for rings in read(document, tmp_path, layers=("cut",)).polygons] == [1]
    assert [len(rings) for rings in read(document, tmp_path, layers=("CUT", "off")).polygons] == [2]
    with pytest.raises(DomainError, match=r"no layer 'ctu'; it has 0, Cut, Defpoints, engrave, Off"):
        read(document, tmp_path, layers=("ctu",))


def test_layers_name_regions_where_several_outlines_are_on_several(tmp_path: Path) -> None:
    document, space = drawing()
    box(space, "steel")
    box(space, "copper", at=(4, 0))
    space.add_circle((2, 1.5), 1, dxfattribs={"layer": "hole"})
    space.add_lwpolyline([(x, y + 5) for x, y in BOX], close=True)
    found = read(document, tmp_path)
    assert sorted(found.regions) == ["", "copper", "steel"]
    assert [len(rings) for rings in found.polygons] == [2 if name == "steel" else 1 for name in found.regions]
    assert lines(found) == {"hole"}


def test_one_layer_names_sides(tmp_path: Path) -> None:
    document, space = drawing()
    box(space, "wall")
    box(space, "wall", at=(10, 0))
    found = read(document, tmp_path)
    assert found.regions == ()
    assert lines(found) == {"wall"}


def test_layer_0_in_a_block_is_the_layer_of_its_insertion(tmp_path: Path) -> None:
    document, space = drawing()
    inner = document.blocks.new("inner")
    inner.add_circle((2, 1.5), 1)
    inner.add_circle((2, 1.5), 0.25, dxfattribs={"layer": "own"})
    block = document.blocks.new("outer")
    block.add_blockref("inner", (0, 0))
    space.add_lwpolyline(BOX, close=True)
    space.add_blockref("outer", (0, 0), dxfattribs={"layer": "bolts"})
    found = read(document, tmp_path)
    assert lines(found) == {"bolts", "own"} or sorted(found.regions) == ["", "own"]
    assert [len(rings) for rings in read(document, tmp_path, layers=("bolts",)).polygons] == [1]
    document.layers.add("bolts").off()
    assert areas(read(document, tmp_path)) == [12.0]


@pytest.mark.parametrize(("code", "told"), [(1, "inches"), (4, "millimetres"), (0, None), (99, None)])
def test_units_are_told(tmp_path: Path, code: int, told: str | None) -> None:
    document, space = drawing()
    document.header["$INSUNITS"] = code
    space.add_lwpolyline(BOX, close=True)
    found = read(document, tmp_path)
    assert areas(found) == [12.0]
    expected = f"lengths are {told}, the drawing's units ($INSUNITS); they are not converted"
    assert list(found.notes) == ([expected] if told else [])


def test_curves_stay_what_they_are(tmp_path: Path) -> None:
    document, space = drawing()
    space.add_lwpolyline([(0, 0, 0.0), (4, 0, 1.0), (4, 2, 0.0), (0, 2, 0.0)], format="xyb", close=True)
    block = document.blocks.new("hole")
    block.add_circle((0, 0), 0.25)
    space.add_blockref("hole", (1, 1), dxfattribs={"xscale": 1, "yscale": 2})
    space.add_circle((-4, 1), 0.25, dxfattribs={"extrusion": (0, 0, -1)})
    found = read(document, tmp_path)
    by_kind = {type(line.curve): line for line in found.lines if line.curve is not None}
    arc = by_kind[CircleArc].curve
    assert isinstance(arc, CircleArc)
    for line in found.lines:
        assert line.curve is not None
        at = line.curve.at(line.curve.nearest(line.points))
        np.testing.assert_allclose(at, line.points, atol=1e-12)
    circles = [line.curve for line in found.lines if isinstance(line.curve, CircleArc)]
    assert sorted((c.radius, round(float(c.centre[0]), 9)) for c in circles) == [(0.25, 4.0), (1.0, 4.0)]
    ellipse = by_kind[EllipseArc].curve
    assert isinstance(ellipse, EllipseArc)
    assert sorted([np.hypot(*ellipse.major), np.hypot(*ellipse.minor)]) == pytest.approx([0.25, 0.5])


def test_a_block_without_height_is_read(tmp_path: Path) -> None:
    document, space = drawing()
    document.blocks.new("plate").add_lwpolyline(BOX, close=True)
    space.add_blockref("plate", (1, 1), dxfattribs={"zscale": 0.0})
    assert areas(read(document, tmp_path)) == [12.0]


def points_of(found: Drawing) -> Floats:
    """All vertices of a drawing's polygons, sorted."""
    points = np.concatenate([ring for rings in found.polygons for ring in rings])
    return points[np.lexsort(points.T)]


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_the_order_of_entities_does_not_matter(tmp_path_factory: Any, seed: int) -> None:
    found = []
    for shuffled in (False, True):
        document, space = drawing()
        strokes = [((0, 0), (6, 0)), ((6, 0), (6, 3)), ((6, 3), (0, 3)), ((0, 3), (0, 0)), ((2, 0), (2, 3)),
                   ((2, 1), (6, 2)), ((4, -1), (4, 5)), ((6, 3), (6, 1))]  # fmt: skip
        order = np.random.default_rng(seed).permutation(len(strokes)) if shuffled else np.arange(len(strokes))
        for i in order.tolist():
            space.add_line(*strokes[i])
        found.append(read(document, tmp_path_factory.mktemp("dxf")))
    assert areas(found[0]) == pytest.approx([6, 6, 6])
    assert areas(found[1]) == pytest.approx(areas(found[0]))
    np.testing.assert_allclose(points_of(found[0]), points_of(found[1]), atol=1e-9)
