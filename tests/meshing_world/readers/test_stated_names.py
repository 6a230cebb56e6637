"""Names, lines and points that GeoJSON, tables and WKT state come out as they went in."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.polygons.drawing import Drawing, Reading
from envs.readers import json_text, plain_text, table, wkt
from envs.readers.geojson import drawing_of_geojson
from envs.types import DomainError

BOX = [[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]
NEXT = [[4, 0], [6, 0], [6, 3], [4, 3], [4, 0]]


def feature(kind: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    """A GeoJSON Feature."""
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def collection(*features: dict[str, Any]) -> dict[str, Any]:
    """A GeoJSON FeatureCollection."""
    return {"type": "FeatureCollection", "features": list(features)}


def stated(path: Path, content: Any) -> Drawing:
    """What a JSON file states."""
    path.write_text(json.dumps(content))
    return json_text.drawing_of_file(path, Reading())


def test_features_name_regions_lines_and_places(tmp_path: Path) -> None:
    drawing = stated(tmp_path / "part.geojson", collection(
        feature("Polygon", [BOX], material="steel", colour="grey"),
        feature("MultiPolygon", [[NEXT], [[[9, 9], [10, 9], [10, 10], [9, 9]]]], name="coil", material="copper"),
        feature("LineString", [[0, 0], [4, 0], [6, 0]], name="bottom"),
        feature("MultiLineString", [[[1, 1, 7], [2, 1, 7]], [[1, 2], [2, 2]]], crack=True),
        feature("Point", [3, 1.5], name="gauge"),
        feature("MultiPoint", [[1, 0.5], [2, 0.5]]),
    ))  # fmt: skip
    assert drawing.regions == ("steel", "coil", "coil")
    assert [np.asarray(rings[0]).shape for rings in drawing.polygons] == [(5, 2), (5, 2), (4, 2)]
    assert [(line.name, line.crack, line.points.tolist()) for line in drawing.lines] == [
        ("bottom", False, [[0, 0], [4, 0], [6, 0]]),
        ("", True, [[1, 1], [2, 1]]),
        ("", True, [[1, 2], [2, 2]]),
    ]
    assert [(p.x, p.y, p.name) for p in drawing.places] == [(3, 1.5, "gauge"), (1, 0.5, ""), (2, 0.5, "")]


def test_without_names_there_are_none(tmp_path: Path) -> None:
    drawing = stated(
        tmp_path / "part.json", collection(feature("Polygon", [BOX]), feature("Polygon", [NEXT], name=None))
    )
    assert drawing.regions == ()


@given(name=st.text(), material=st.none() | st.text())
def test_the_name_comes_before_the_material(name: str, material: str | None) -> None:
    drawing = drawing_of_geojson(feature("Polygon", [BOX], name=name, material=material), "part")
    assert drawing.regions == ((name.strip(),) if name.strip() else ())
    drawing = drawing_of_geojson(feature("Polygon", [BOX], name=None, material=material), "part")
    assert drawing.regions == ((material.strip(),) if material and material.strip() else ())


def test_a_number_is_a_name() -> None:
    assert drawing_of_geojson(feature("Polygon", [BOX], material=7), "part").regions == ("7",)


BAD = {
    "a list as a name": (feature("Polygon", [BOX], name=["a"]), r"\['a'\] as a Feature's name; give a text"),
    "lines alone": (feature("LineString", BOX), "lines and points alone; give a Polygon, too"),
    "one place": (collection(feature("LineString", [[1, 1]])), "'coordinates' of a LineString are no list of"),
    "no length": (collection(feature("LineString", [[1, 1], [1, 1]])), r"a LineString at \(1.0, 1.0\) has no length"),
    "words": (collection(feature("LineString", [[1, 1], ["a", 1]])), r"\['a', 1\] in a LineString where \[x, y\]"),
    "infinity": (collection(feature("Point", [float("inf"), 1])), r"a Point at \(inf, 1.0\): coordinate not finite"),
    "nothing": (collection(feature("Point", None)), "'coordinates' of a Point are no list of"),
    "huge": (collection(feature("Point", [10**400, 1])), "a Point with a coordinate that is too large"),
    "lines no list": (collection(feature("MultiLineString", 3)), "'coordinates' of the GeoJSON MultiLineString is no"),
}  # fmt: skip


@pytest.mark.parametrize(("content", "message"), BAD.values(), ids=BAD.keys())
def test_bad_features_are_one_line(tmp_path: Path, content: Any, message: str) -> None:
    path = tmp_path / "part.geojson"
    with pytest.raises(DomainError, match=message) as caught:
        stated(path, content)
    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize("column", ["name", "side"])
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_column_names_the_segments_that_begin_there(tmp_path: Path, column: str, separator: str) -> None:
    path = tmp_path / "part.csv"
    rows = [
        "x,y,%s",
        "0,0,bottom",
        "2,0,bottom",
        "4,0,",
        "4,3,'top'",
        "0,3,left",
        "",
        "1,1,hole",
        "2,1,hole",
        "1,2,hole",
    ]
    path.write_text("\n".join(rows).replace(",", separator) % column)
    drawing = table.drawing_of_file(path, Reading())
    assert [(line.name, line.points.tolist()) for line in drawing.lines] == [
        ("bottom", [[0, 0], [2, 0], [4, 0]]),
        ("top", [[4, 3], [0, 3]]),
        ("left", [[0, 3], [0, 0]]),
        ("hole", [[1, 1], [2, 1], [1, 2], [1, 1]]),
    ]
    assert [len(rings) for rings in drawing.polygons] == [2]


def test_a_repeated_first_row_ends_the_last_segment(tmp_path: Path) -> None:
    path = tmp_path / "part.csv"
    path.write_text("name;x;y\na, b;0,5;0\n;4;0\n;4;3\nleft;0,5;3\nignored;0,5;0\n")
    drawing = table.drawing_of_file(path, Reading())
    assert [(line.name, line.points.tolist()) for line in drawing.lines] == [
        ("a, b", [[0.5, 0], [4, 0]]),
        ("left", [[0.5, 3], [0.5, 0]]),
    ]


def test_other_columns_are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "part.csv"
    path.write_text("x,y,remark\n0,0,a\n1,0,b\n1,1,c\n0,1,d\n")
    assert not table.drawing_of_file(path, Reading()).lines


def test_collections_hold_polygons_lines_and_points(tmp_path: Path) -> None:
    path = tmp_path / "part.txt"
    path.write_text(
        "GEOMETRYCOLLECTION (POLYGON ((0 0, 4 0, 4 3, 0 3, 0 0)), LINESTRING Z (1 1 9, 2 1 9), POINT (3 1), "
        "GEOMETRYCOLLECTION (MULTIPOLYGON (((4 0, 6 0, 6 3, 4 0))), MULTILINESTRING ((1 2, 2 2)), MULTIPOINT (3 2)))"
    )
    drawing = plain_text.drawing_of_file(path, Reading())
    assert [len(rings[0]) for rings in drawing.polygons] == [5, 4]
    assert [line.points.tolist() for line in drawing.lines] == [[[1, 1], [2, 1]], [[1, 2], [2, 2]]]
    assert [(place.x, place.y) for place in drawing.places] == [(3, 1), (3, 2)]
    assert drawing.regions == ()


BAD_WKT = {
    "lines alone": ("GEOMETRYCOLLECTION (LINESTRING (0 0, 1 1))", "no POLYGON in the GEOMETRYCOLLECTION"),
    "no length": ("GEOMETRYCOLLECTION (LINESTRING (1 1, 1 1))", "has no length; give it two places"),
    "an empty line": ("GEOMETRYCOLLECTION (LINESTRING EMPTY)", "an empty LINESTRING where a POLYGON is needed"),
    "deep": ("GEOMETRYCOLLECTION (" * 30 + "POINT (1 1)" + ")" * 30, "nested more than 20 deep"),
    "beyond": ("GEOMETRYCOLLECTION (POINT (1e300 1))", "coordinate too large"),
    "none": ("MULTIPOLYGON EMPTY", "no POLYGON in the MULTIPOLYGON"),
}


@pytest.mark.parametrize(("text", "message"), BAD_WKT.values(), ids=BAD_WKT.keys())
def test_bad_collections_are_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "part.wkt"
    path.write_text(text)
    with pytest.raises(DomainError, match=message) as caught:
        wkt.drawing_of_file(path, Reading())
    assert str(caught.value).startswith(f"{path}: ")
