"""What Gmsh scripts name, embed and bend comes in with the polygons."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from envs.polygons.drawing import Drawing, Reading
from envs.polygons.exact_curves import CircleArc, EllipseArc, ParametricCurve
from envs.readers.geo import drawing_of_file, sizes_of_file

PLATE = """
lc = 0.5; r = 1; L = 10;
Point(1)={0,0,0,lc}; Point(2)={r,0,0,lc/8}; Point(3)={L,0,0,lc}; Point(4)={L,L,0,lc}; Point(5)={0,L,0,lc};
Point(6)={0,r,0,lc/8};
Line(1)={2,3}; Line(2)={3,4}; Line(3)={4,5}; Line(4)={5,6}; Circle(5)={6,1,2};
Curve Loop(1)={1,2,3,4,5}; Plane Surface(1)={1};
"""


def read(folder: Path, text: str, edge_length: float | None = None) -> Drawing:
    """What a script states."""
    path = folder / "part.geo"
    path.write_text(text)
    return drawing_of_file(path, Reading(edge_length))


def ends(drawing: Drawing) -> dict[str, list[list[list[float]]]]:
    """The first and the last point of the lines of each name."""
    found: dict[str, list[list[list[float]]]] = {}
    for line in drawing.lines:
        found.setdefault(line.name, []).append([line.points[0].tolist(), line.points[-1].tolist()])
    return found


def test_physical_groups_are_names(tmp_path: Path) -> None:
    text = PLATE + 'Physical Curve("bottom")={1}; Physical Line("far", 7)={2,-3}; Physical Curve("hole")={5};'
    text += 'Physical Surface("plate")={1}; Physical Point("corner")={4};'
    drawing = read(tmp_path, text)
    assert list(drawing.regions) == ["plate"]
    assert [(place.x, place.y, place.name) for place in drawing.places] == [(10.0, 10.0, "corner")]
    assert ends(drawing) == {
        "bottom": [[[1, 0], [10, 0]]], "far": [[[10, 0], [10, 10]], [[10, 10], [0, 10]]], "hole": [[[0, 1], [1, 0]]],
    }  # fmt: skip
    assert not drawing.notes
    assert not any(line.crack or line.optional for line in drawing.lines)


def test_lines_are_the_points_of_the_rings(tmp_path: Path) -> None:
    drawing = read(tmp_path, PLATE + "Physical Curve(3)={5};", 0.3)
    ring = [tuple(p) for p in np.asarray(drawing.polygons[0][0]).tolist()]
    (hole,) = drawing.lines
    assert {tuple(p) for p in hole.points.tolist()} <= set(ring)
    assert len(hole.points) > 40


def test_numbers_alone_make_names(tmp_path: Path) -> None:
    drawing = read(tmp_path, PLATE + "Physical Curve(7)={1}; Physical Surface(3)={1}; Physical Point(5)={2};")
    assert list(drawing.regions) == ["surface_3"]
    assert set(ends(drawing)) == {"curve_7", ""}
    assert [place.name for place in drawing.places] == ["point_5"]


def test_of_several_groups_the_first_names(tmp_path: Path) -> None:
    text = PLATE + 'Physical Curve("a")={1,2}; Physical Curve("b")={2,3,1}; Physical Curve("b") -= {3};'
    drawing = read(tmp_path, text)
    assert set(ends(drawing)) == {"a", ""}
    assert drawing.notes == ["curve 2 is in the physical groups 'a' and 'b' (so are 1 more); the first names it"]


def test_groups_grow_and_take_all(tmp_path: Path) -> None:
    drawing = read(tmp_path, PLATE + 'Physical Curve("a")={1}; Physical Curve("a") += {2}; Physical Curve("b")={:};')
    assert {name: len(found) for name, found in ends(drawing).items()} == {"a": 2, "b": 3}


def test_what_lies_in_surfaces_is_inside(tmp_path: Path) -> None:
    text = PLATE + "Point(7)={3,3,0,.1}; Point(8)={5,5,0}; Point(9)={7,3,0}; Line(9)={7,8}; Spline(10)={8,9,7};"
    text += 'Curve{9, 10} In Surface{1}; Point{9, 2} In Surface{1}; Physical Curve("fibre")={10};'
    drawing = read(tmp_path, text)
    assert ends(drawing)["fibre"] == [[[5, 5], [3, 3]]]
    assert [[3, 3], [5, 5]] in ends(drawing)[""]
    assert not any(line.optional for line in drawing.lines)
    assert [(place.x, place.y, place.name) for place in drawing.places] == [(7.0, 3.0, ""), (1.0, 0.0, "")]
    sizes = sizes_of_file(tmp_path / "part.geo")
    assert sizes is not None
    assert [3.0, 3.0, 0.1] in sizes.tolist()


def test_named_curves_that_are_nowhere_are_optional(tmp_path: Path) -> None:
    text = PLATE + 'Point(7)={3,3,0}; Point(8)={5,5,0}; Line(9)={7,8}; Physical Curve("axis")={9};'
    (axis,) = [line for line in read(tmp_path, text).lines if line.name]
    assert axis.optional


def test_points_off_everything_are_left_out_with_a_note(tmp_path: Path) -> None:
    drawing = read(tmp_path, PLATE + 'Physical Point("centre")={1, 2};')
    assert [(place.x, place.y) for place in drawing.places] == [(1.0, 0.0)]
    assert drawing.notes == ["point 1 has a name and lies on no curve, nor in a surface; it is left out"]


def test_regions_stand_beside_their_polygons(tmp_path: Path) -> None:
    text = (
        PLATE.replace("Plane Surface(1)={1};", "")
        + """
    Point(10)={20,0,0}; Point(11)={20,10,0}; Line(10)={3,10}; Line(11)={10,11}; Line(12)={11,4};
    Curve Loop(2)={10,11,12,-2}; Plane Surface(2)={2}; Plane Surface(1)={1};
    Physical Surface("right")={2}; Physical Curve("between")={2};
    """
    )
    drawing = read(tmp_path, text)
    assert list(drawing.regions) == ["right", ""]
    assert np.asarray(drawing.polygons[0][0])[:, 0].min() == 10.0


CURVES = {
    "Circle(1)={1,2,3};": CircleArc, "Ellipse(1)={1,2,1,5};": EllipseArc,
    "Spline(1)={1,4,3};": ParametricCurve, "BSpline(1)={1,4,5,3};": ParametricCurve,
    "Bezier(1)={1,4,5,3};": ParametricCurve, "Line(1)={1,3};": None,
}  # fmt: skip


@pytest.mark.parametrize(("text", "kind"), CURVES.items())
def test_curves_are_exact(tmp_path: Path, text: str, kind: type | None) -> None:
    points = "Point(1)={2,0,0};Point(2)={0,0,0};Point(3)={0,2,0};Point(4)={2,2,0};Point(5)={0,1,0};Point(6)={-1,-1,0};"
    last = 5 if "5};" in text else 3
    closing = f"Line(2)={{{last},6}};Line(3)={{6,1}};Curve Loop(1)={{1:3}};Plane Surface(1)={{1}};"
    drawing = read(tmp_path, points + text + closing, 0.1)
    if kind is None:
        assert not drawing.lines
        return
    (line,) = drawing.lines
    assert isinstance(line.curve, kind)
    on = line.curve.at(line.curve.nearest(line.points))
    np.testing.assert_allclose(on, line.points, atol=1e-12)
    assert len(line.points) > 10


def test_half_circles_go_round_to_the_left(tmp_path: Path) -> None:
    text = "Point(1)={-1,0,0};Point(2)={0,0,0};Point(3)={1,0,0};Circle(1)={1,2,3};Circle(2)={3,2,1};"
    drawing = read(tmp_path, text + "Curve Loop(1)={1,2};Plane Surface(1)={1};", 0.1)
    x, y = np.asarray(drawing.polygons[0][0]).T
    assert 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) == pytest.approx(np.pi, rel=1e-3)
