"""SVG drawings: every way to draw a shape gives the same polygon, wherever it is moved and however it is written."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.polygons.drawing import Drawing, Reading
from envs.polygons.exact_curves import CircleArc, EllipseArc, ParametricCurve
from envs.readers import svg
from envs.types import DomainError

HEAD = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
BOX = '<path d="M0 0 H10 V6 H0 Z"/>'


def read(folder: Path, body: str, attributes: str = "", **reading: Any) -> Drawing:
    """What a drawing with these elements states."""
    path = folder / "part.svg"
    path.write_text(f"<svg {HEAD} {attributes}>{body}</svg>")
    return svg.drawing_of_file(path, Reading(**reading))


def polygon(found: Drawing) -> shapely.Polygon:
    """The only polygon of a drawing."""
    (rings,) = found.polygons
    return shapely.Polygon(rings[0], rings[1:])


BOXES = {
    "absolute": '<path d="M 1 2 L 5 2 L 5 5 L 1 5 Z"/>',
    "relative": '<path d="m1,2 4,0 0,3 -4,0z"/>',
    "dense": '<path d="M1 2H5V5H1z"/>',
    "relative lines": '<path d="m1 2h4v3h-4"/>',
    "numbers run together": '<path d="M.1e1 20e-1h+4v3-0h-4z"/>'.replace("v3-0h", "v3h"),
    "cubics that are straight": '<path d="M1 2C2 2 5 2 5 2S5 3 5 5L1 5z"/>',
    "rectangle": '<rect x="1" y="2" width="4" height="3"/>',
    "polygon": '<polygon points="1,2 5,2 5,5 1,5"/>',
    "open polyline, painted": '<polyline points="1 2 5 2 5 5 1 5"/>',
    "lines": '<g fill="none"><line x1="1" y1="2" x2="5" y2="2"/><path d="M5 2V5H1"/><line x1="1" y1="2" x2="1" y2="5"/></g>',  # noqa: E501
    "translated": '<g transform="translate(1, 2)"><path d="M0 0h4v3h-4z"/></g>',
    "scaled and moved": '<path transform="translate(1 2) scale(2,.5)" d="M0 0h2v6h-2z"/>',
    "matrix": '<g transform="matrix(1 0 0 1 1 2)"><g transform="rotate(90)"><path d="M0 0h3v-4h-3z"/></g></g>',
    "turned about a place": '<path transform="rotate(180 3 3.5)" d="M1 2h4v3h-4z"/>',
    "used": '<defs><path id="b" d="M0 0h4v3h-4z"/></defs><use xlink:href="#b" x="1" y="2"/>',
    "a symbol": '<symbol id="b"><path d="M0 0h4v3h-4z"/></symbol><use href="#b" x="1" transform="translate(0 2)"/>',
    "a drawing inside": '<svg x="1" y="2"><path d="M0 0h4v3h-4z"/></svg>',
    "in inches": '<rect x="1" y="2" width="4px" height="0.03125in"/>',
}  # fmt: skip


@pytest.mark.parametrize("body", BOXES.values(), ids=BOXES.keys())
def test_every_way_to_draw_a_box(tmp_path: Path, body: str) -> None:
    found = polygon(read(tmp_path, body, 'viewBox="0 0 10 8"'))
    assert len(found.exterior.coords) == 5
    assert found.symmetric_difference(shapely.box(1, 3, 5, 6)).area < 1e-12


ROUND = {
    "circle": ('<circle cx="5" cy="3" r="2"/>', 4.0, CircleArc),
    "ellipse": ('<ellipse cx="5" cy="3" rx="3" ry="2"/>', 6.0, EllipseArc),
    "ellipse of one radius": ('<ellipse cx="5" cy="3" rx="2"/>', 4.0, CircleArc),
    "two arcs": ('<path d="M3 3a2 2 0 1 0 4 0a2 2 0 1 0-4 0z"/>', 4.0, CircleArc),
    "flags run together": ('<path d="M3 3a2 2 0 104 0 2 2 0 10-4 0z"/>', 4.0, CircleArc),
    "arcs of a turned ellipse": ('<path d="M3 3A3 2 30 0 1 7 3 3 2 30 0 1 3 3"/>', None, EllipseArc),
    "radii that are too small grow": ('<path d="M3 3a.1.1 0 0 0 4 0 .1.1 0 0 0-4 0"/>', 4.0, CircleArc),
    "a scaled circle": ('<circle r="1" transform="matrix(3 0 0 2 5 3)"/>', 6.0, EllipseArc),
    "a mirrored and turned circle": ('<circle r="2" transform="translate(5 3) scale(-1 1) rotate(33)"/>', 4.0, CircleArc),  # noqa: E501
    "rounded rectangle": ('<rect x="1" y="1" width="6" height="4" ry="2"/>', None, CircleArc),
}  # fmt: skip


@pytest.mark.parametrize(("body", "share", "kind"), ROUND.values(), ids=ROUND.keys())
def test_round_shapes_are_exact_curves(tmp_path: Path, body: str, share: float | None, kind: type) -> None:
    found = read(tmp_path, body, edge_length=0.05)
    kinds = [type(line.curve) for line in found.lines]
    assert set(kinds) == {kind}
    if share is not None:
        assert polygon(found).area == pytest.approx(share * math.pi, rel=1e-3)
    for line in found.lines:
        assert line.curve is not None
        np.testing.assert_allclose(line.curve.at(line.curve.nearest(line.points)), line.points, atol=1e-9)


def test_a_rounded_rectangle_has_the_area_of_one(tmp_path: Path) -> None:
    found = read(tmp_path, '<rect width="6" height="4" rx="1" ry="1"/>', edge_length=0.02)
    assert polygon(found).area == pytest.approx(24 - 4 + math.pi, rel=1e-4)


@settings(max_examples=50)
@given(
    x=st.floats(-5, 5), y=st.floats(-5, 5), rx=st.floats(0.3, 4), ry=st.floats(0.3, 4), turned=st.floats(-200, 200),
    large=st.booleans(), sweeping=st.booleans(),
)  # fmt: skip
def test_arcs_go_from_end_to_end_the_way_their_flags_say(
    tmp_path_factory: Any, x: float, y: float, rx: float, ry: float, turned: float, large: bool, sweeping: bool
) -> None:
    if math.hypot(x, y) < 0.1:
        x = 1.0
    d = f"M0 0A{rx} {ry} {turned} {int(large)} {int(sweeping)} {x} {y}"
    found = read(tmp_path_factory.mktemp("svg"), f'<path d="{d}"/>', edge_length=0.05)
    (line,) = found.lines
    np.testing.assert_allclose(line.points[[0, -1]], [[0, 0], [x, -y]], atol=1e-12)
    arc = line.curve
    assert isinstance(arc, CircleArc | EllipseArc)
    c, s = math.cos(math.radians(turned)), math.sin(math.radians(turned))
    local = (line.points * [1, -1] - np.asarray(arc.centre) * [1, -1]) @ np.array([[c, -s], [s, c]])
    grown = np.hypot(local[:, 0] / rx, local[:, 1] / ry)
    np.testing.assert_allclose(grown, grown[0], rtol=1e-6)
    assert grown[0] >= 1 - 1e-9
    chord_to_fit = grown[0] > 1 + 1e-9
    assert chord_to_fit or (abs(arc.sweep) > math.pi) == large or abs(abs(arc.sweep) - math.pi) < 1e-6
    ring = line.points * [1, -1]
    turning = float(np.sum(ring[:-1, 0] * ring[1:, 1] - ring[1:, 0] * ring[:-1, 1]))
    assert abs(turning) < 1e-9 or (turning > 0) == sweeping


def test_bezier_curves_stay_exact_and_smooth_commands_mirror(tmp_path: Path) -> None:
    found = read(tmp_path, '<path d="M0 0C0 4 4 4 4 0S8-4 8 0L8 9 0 9z"/>', edge_length=0.02)
    same = read(tmp_path, '<path d="M0 0C0 4 4 4 4 0C4 -4 8-4 8 0V9H0"/>', edge_length=0.02)
    assert polygon(found).equals(polygon(same))
    quadratic = read(tmp_path, '<path d="M0 0Q2 4 4 0T8 0V9H0"/>', edge_length=0.02)
    assert polygon(quadratic).area == pytest.approx(72, rel=1e-4)
    for each in (found, quadratic):
        assert [type(line.curve) for line in each.lines] == [ParametricCurve] * 2
        for line in each.lines:
            assert line.curve is not None
            np.testing.assert_allclose(line.curve.at(line.curve.nearest(line.points)), line.points, atol=1e-9)


def test_y_is_turned_upwards_within_the_page(tmp_path: Path) -> None:
    triangle = '<path d="M0 0H4L0 4Z"/>'
    for attributes, top in (
        ('viewBox="0 0 4 10"', 10),
        ('width="5" height="20"', 20),
        ("", 0),
        ('viewBox="0 -4 4 8"', 0),
    ):
        assert (4.0, top) in {tuple(p) for p in read(tmp_path, triangle, attributes).polygons[0][0].tolist()}


def test_loops_inside_are_holes_and_lines_divide(tmp_path: Path) -> None:
    hole = '<circle cx="2" cy="3" r="1"/>'
    found = read(tmp_path, BOX + hole + '<path fill="none" d="M5 0V6"/><line x1="-1" y1="3" x2="9" y2="3"/>')
    assert sorted(len(rings) for rings in found.polygons) == [1, 2]
    assert found.notes == ["passed over: 1 open line"]


def test_what_is_not_displayed_is_left_out(tmp_path: Path) -> None:
    sheet = "<style>/* a */ .aid, #gone { display : none } .thin { fill: none !important }</style>"
    hidden = [
        '<g display="none"><circle r="1"/></g>', '<circle r="1" style="stroke:red;visibility:hidden"/>',
        '<circle class="x aid" r="1"/>', '<circle id="gone" r="1"/>', '<clipPath><circle r="1"/></clipPath>',
        '<mask><circle r="1"/></mask>', '<marker><circle r="1"/></marker>', '<circle r="0"/>', '<path d=""/>',
        '<rect width="0" height="3"/>', '<text>plate</text>', '<use href="#nothing"/>', '<use href="other.svg#a"/>',
        '<path class="thin" d="M1 1H2V2"/>',
    ]  # fmt: skip
    found = read(tmp_path, sheet + "".join(hidden) + BOX)
    assert polygon(found).area == 60
    assert found.notes == ["passed over: 1 open line, 1 text"]


NAMES = {
    "id": ('<path id="wall" d="M0 0H1V1"/>', "wall"),
    "id of a program": ('<path id="path12-3" d="M0 0H1V1"/>', ""),
    "label": ('<path id="wall" inkscape:label="left side" d="M0 0H1V1"/>', "left side"),
    "class": ('<path class="st0 wall" d="M0 0H1V1"/>', "wall"),
    "group": ('<g inkscape:label="wall" id="g5"><g id="g7"><path d="M0 0H1V1"/></g></g>', "wall"),
    "use": ('<defs><path id="shape" d="M0 0H1V1"/></defs><use id="wall" href="#shape"/>', "shape"),
}


@pytest.mark.parametrize(("body", "name"), NAMES.values(), ids=NAMES.keys())
def test_names_are_labels_ids_or_classes(tmp_path: Path, body: str, name: str) -> None:
    found = read(tmp_path, body)
    assert {line.name for line in found.lines} == ({name} if name else set())
    assert found.regions == ()


def test_several_outlines_of_several_names_are_regions(tmp_path: Path) -> None:
    body = '<path id="steel" d="M0 0H1V1H0z"/><path id="copper" d="M1 0H2V1H1z"/><circle id="hole" cx=".5" cy=".5" r=".2"/>'  # noqa: E501
    found = read(tmp_path, body)
    assert sorted(found.regions) == ["copper", "steel"]
    assert {line.name for line in found.lines} == {"hole"}


def test_units_are_told(tmp_path: Path) -> None:
    note = "lengths are the drawing's units, {} each; they are not converted"
    assert read(tmp_path, BOX, 'width="50mm" viewBox="0 0 100 80"').notes == [note.format("0.5 mm")]
    assert read(tmp_path, BOX, 'width="50cm"').notes == [note.format("0.0264583 cm")]
    for attributes in ("", 'width="50"', 'width="100%" viewBox="0 0 100 80"', 'width="50px"'):
        assert not read(tmp_path, BOX, attributes).notes


def test_gaps_are_told_and_joined(tmp_path: Path) -> None:
    body = '<path fill="none" d="M0 0H10V6H0V0.001"/>'
    with pytest.raises(DomainError, match=r"the nearest open end is 0\.001 away .*--join 2e-3"):
        read(tmp_path, body)
    assert polygon(read(tmp_path, body, join=0.01)).area == pytest.approx(60, rel=1e-3)


def test_a_doctype_without_declarations_is_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "part.svg"
    doctype = '<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">'
    for encoding in ("utf-8", "utf-16", "iso-8859-1"):
        path.write_bytes(
            f'<?xml version="1.0" encoding="{encoding}"?>{doctype}<svg {HEAD}>{BOX}</svg>'.encode(encoding)
        )
        assert polygon(svg.drawing_of_file(path, Reading())).area == 60


@pytest.mark.parametrize("encoding", ["utf-7", "shift_jis", "cp65001x", "base64"])
def test_an_encoding_that_is_not_read_is_one_line(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "part.svg"
    path.write_text(f'<?xml version="1.0" encoding="{encoding}"?><svg {HEAD}>{BOX}</svg>')
    with pytest.raises(DomainError, match=r"encoding|not valid XML") as caught:
        svg.drawing_of_file(path, Reading())
    assert str(caught.value).startswith(f"{path}: ")


BAD = {
    "empty": ("", "the file is empty"),
    "no xml": ("plate", "line 1: not valid XML"),
    "cut off": (f"<svg {HEAD}>{BOX}", "line 1: not valid XML"),
    "another language": ("<html/>", "no SVG drawing"),
    "nothing": (f"<svg {HEAD}><text>a</text></svg>", r"no outline in it \(1 text\); draw path, rect"),
    "declarations": (f'<!DOCTYPE svg [<!ENTITY a "b">]><svg {HEAD}>{BOX}</svg>', "line 1: a DTD in the file, which is"),
    "a file's entity": ('<!DOCTYPE svg [<!ENTITY a SYSTEM "/etc/passwd">]><svg>&a;</svg>', "a DTD in the file"),
    "an unknown entity": (f"<svg {HEAD}>&a;{BOX}</svg>", "not valid XML"),
    "no move": (f'<svg {HEAD}>\n<path d="L0 0"/></svg>', "line 2: a path begins with M, this one with 'L0 0'"),
    "a word": (f'<svg {HEAD}><path d="M0 0L1 x"/></svg>', "character 6 of the path: ' x'|character 7 of the path: 'x'"),
    "a number too few": (f'<svg {HEAD}><path d="M0 0L1"/></svg>', "its end' where a number is needed"),
    "no command": (f'<svg {HEAD}><path d="M0 0B1 1"/></svg>', "character 4 of the path: 'B1 1' is no command"),
    "a bad transform": (f'<svg {HEAD}><path transform="turn(3)" d="M0 0"/></svg>', r"transform 'turn\(3\)' is not"),
    "too few numbers": (f'<svg {HEAD}><g transform="matrix(1 2)"/></svg>', r"transform 'matrix\(1 2\)' is not"),
    "percent": (f'<svg {HEAD}><circle r="5%"/></svg>', "r '5%' is no length in px, mm"),
    "odd points": (f'<svg {HEAD}><polygon points="1 2 3"/></svg>', "points with a number too many"),
    "words as points": (f'<svg {HEAD}><polygon points="a b"/></svg>', "points 'a b' are no list of numbers"),
    "infinite": (f'<svg {HEAD}><rect width="1e999" height="1"/></svg>', "coordinate not finite"),
    "huge": (f'<svg {HEAD}><path d="M0 0H1e200V1z"/></svg>', "coordinate too large"),
    "in itself": (f'<svg {HEAD}><g id="a"><use href="#a"/></g></svg>', "200,000 elements, or 100 in each other"),
    "view": (f'<svg {HEAD} viewBox="0 0 3">{BOX}</svg>', "with a number too many"),
    "inner view": (f'<svg {HEAD}><svg viewBox="0 0 3 3">{BOX}</svg></svg>', "a viewBox of its own; ungroup it"),
    "open": (f'<svg {HEAD}><line x2="1"/></svg>', r"a curve ends at \(1.0, 0.0\) and no other begins there"),
}  # fmt: skip


@pytest.mark.parametrize(("content", "message"), BAD.values(), ids=BAD.keys())
def test_bad_drawings_are_one_line(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "part.svg"
    path.write_text(content)
    with np.errstate(all="ignore"), pytest.raises(DomainError, match=message) as caught:
        svg.drawing_of_file(path, Reading())
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
