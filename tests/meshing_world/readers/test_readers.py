"""Polygon files: every format gives the same domain, every fault its place and fix."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from envs.domains.load import load
from envs.types import DomainError

SQUARE = [[0.1, 0.2], [4.1, 0.2], [4.1, 4.2], [0.1, 4.2]]
HOLE = [[1.1, 1.2], [1.1, 2.2], [2.1, 2.2], [2.1, 1.2]]
RINGS = [[*SQUARE, SQUARE[0]], [*HOLE, HOLE[0]]]
POLYGON = {"type": "Polygon", "coordinates": RINGS}
FEATURE = {"type": "Feature", "properties": {"name": "plate"}, "geometry": POLYGON}


def write(folder: Path, name: str, content: object) -> Path:
    """A file with text, bytes, or anything else as JSON."""
    path = folder / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return path


GOOD = {
    "polygon": ("plate.geojson", POLYGON),
    "feature": ("plate.geojson", FEATURE),
    "collection": ("plate.geojson", {"type": "FeatureCollection", "features": [FEATURE]}),
    "geometries": ("plate.geojson", {"type": "GeometryCollection", "geometries": [POLYGON]}),
    "one multipolygon": ("plate.json", {"type": "MultiPolygon", "coordinates": [RINGS]}),
    "elevations": ("plate.json", {"type": "Polygon", "coordinates": [[[*p, 7.0] for p in ring] for ring in RINGS]}),
    "catalogue's": ("plate.json", {"name": "plate", "rings": [SQUARE, HOLE]}),
    "byte-order mark": ("plate.json", b"\xef\xbb\xbf" + json.dumps(POLYGON).encode()),
    "wkt": ("plate.wkt", shapely.Polygon(*[RINGS[0]], [RINGS[1]]).wkt),
    "wkt with elevations": ("plate.txt", shapely.force_3d(shapely.Polygon(RINGS[0], [RINGS[1]])).wkt + "\n"),
    "upper-case extension": ("plate.WKT", shapely.Polygon(RINGS[0], [RINGS[1]]).wkt),
}  # fmt: skip


@pytest.mark.parametrize(("name", "content"), GOOD.values(), ids=GOOD.keys())
def test_every_format_gives_the_same_domain(tmp_path: Path, name: str, content: object) -> None:
    path = write(tmp_path, name, content)
    for spec in (path, str(path)):
        domain = load(spec)
        assert domain.name == "plate"
        np.testing.assert_array_equal(domain.points[:8], [*SQUARE, *HOLE])
        assert domain.area == pytest.approx(15.0)


@pytest.mark.parametrize("rest", ["", "\n", "\n[[1, 2], [3, 4]]\n", "\nelements: 12"])
def test_the_authors_format_is_its_first_line(tmp_path: Path, rest: str) -> None:
    domain = load(write(tmp_path, "ring.json", json.dumps(SQUARE) + rest))
    np.testing.assert_array_equal(domain.points, SQUARE)


def test_a_ring_with_its_seam_is_read(tmp_path: Path) -> None:
    seamed = load(write(tmp_path, "plate.json", POLYGON))
    again = load(write(tmp_path, "ring.json", seamed.vertices.tolist()))
    assert again.area == pytest.approx(seamed.area)
    assert len(again.segments) == len(seamed.segments)


def test_numbers_survive_the_file(tmp_path: Path) -> None:
    ring = (np.array(SQUARE) * np.pi / 3).tolist()
    np.testing.assert_array_equal(load(write(tmp_path, "ring.json", ring)).points, ring)
    wkt = "POLYGON((" + ", ".join(f"{x!r} {y!r}" for x, y in [*ring, ring[0]]) + "))"
    np.testing.assert_array_equal(load(write(tmp_path, "ring.wkt", wkt)).points, ring)


def test_parity_is_fixed_on_the_way_in(tmp_path: Path) -> None:
    path = write(tmp_path, "house.json", [*SQUARE[:3], [2.0, 6.0], SQUARE[3]])
    with pytest.raises(DomainError, match=r"house.json: 5 boundary vertices .*--fix-parity"):
        load(path)
    assert len(load(path, fix_parity=True).ring) == 6


BAD = {
    "empty": ("a.json", "", "the file is empty"),
    "blank": ("a.wkt", " \n\n", "the file is empty"),
    "not text": ("a.json", b"\xff\xfe\x00", "not a text file"),
    "broken json": ("a.json", "[[0, 0],\n[1, 0],\n[1,}", "line 3, column 4: not valid JSON"),
    "broken geojson": ("a.geojson", '{"type": "Polygon",\n "coordinates": [[0 1]]}', "line 2, column 21: not valid"),
    "deep": ("a.json", "[" * 100_000, "nested too deeply"),
    "a number": ("a.json", "3", "neither GeoJSON"),
    "an object": ("a.json", {"a": 1}, "neither GeoJSON"),
    "objects": ("a.json", [{"x": 1}], "not a list of"),
    "no rings": ("a.json", {"rings": []}, "'rings' is no list of rings"),
    "nan": ("a.json", "[[0,0],[1,0],[1,1],[0,NaN]]", "vertex 3 .*not finite"),
    "two polygons": ("a.geojson", {"type": "FeatureCollection", "features": [FEATURE] * 2}, "2 polygons where exactly"),
    "two parts": ("a.geojson", {"type": "MultiPolygon", "coordinates": [RINGS, RINGS]}, "2 polygons where exactly"),
    "no polygon": ("a.geojson", {"type": "FeatureCollection", "features": []}, "no polygon in it"),
    "a point": ("a.geojson", {"type": "Point", "coordinates": [1, 2]}, "GeoJSON of lines and points alone"),
    "no geometry": ("a.geojson", {"type": "Feature", "geometry": None}, "an object without a type"),
    "no coordinates": ("a.geojson", {"type": "Polygon"}, "'coordinates' is no list of rings"),
    "coordinates not rings": ("a.geojson", {"type": "Polygon", "coordinates": [1]}, "'coordinates' is no list"),
    "empty ring": ("a.geojson", {"type": "Polygon", "coordinates": [[]]}, "no vertices"),
    "features no list": ("a.geojson", {"type": "FeatureCollection", "features": 3}, "'features' .*is no list"),
    "parts no list": ("a.geojson", {"type": "MultiPolygon", "coordinates": 3}, "'coordinates' .*is no list"),
    "strange type": ("a.geojson", {"type": ["x"]}, "where a Polygon is needed"),
    "words in a ring": ("a.geojson", {"type": "Polygon", "coordinates": [["a", 1]]}, "not a list of"),
    "json in wkt": ("a.wkt", "[[0, 0]]", "not valid WKT"),
    "open wkt": ("a.wkt", "POLYGON ((0 0, 4 0, 4 4, 0 4))", "not valid WKT .*closed"),
    "wkt and more": ("a.wkt", "POLYGON ((0 0, 4 0, 4 4, 0 4, 0 0)) x", "not valid WKT"),
    "wkt line": ("a.txt", "LINESTRING (0 0, 1 1)", "a LINESTRING where a POLYGON"),
    "wkt empty": ("a.txt", "POLYGON EMPTY", "an empty POLYGON"),
    "wkt two": ("a.txt", "MULTIPOLYGON (((0 0, 4 0, 4 4, 0 0)), ((9 9, 8 9, 9 8, 9 9)))", "2 polygons where"),
    "extension": ("a.stl", "solid", r"unknown extension '.stl'; use one of .geojson, .json, .wkt, .txt"),
    "crossing": ("a.wkt", "POLYGON ((0 0, 1 1, 1 0, 0 1, 0 0))", "outer ring crosses itself: segments 0 and 2"),
}  # fmt: skip


@pytest.mark.parametrize(("name", "content", "message"), BAD.values(), ids=BAD.keys())
def test_bad_files(tmp_path: Path, name: str, content: object, message: str) -> None:
    path = write(tmp_path, name, content)
    with pytest.raises(DomainError, match=message) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_missing_files_and_folders(tmp_path: Path) -> None:
    with pytest.raises(DomainError, match=r"none\.json: no such file"):
        load(tmp_path / "none.json")
    (tmp_path / "folder.json").mkdir()
    with pytest.raises(DomainError, match="cannot be read"):
        load(str(tmp_path / "folder.json"))


@pytest.mark.parametrize("spec", ["T1", "t1"])
def test_catalogue_names_in_any_case(spec: str) -> None:
    assert load(spec).name == "T1"


@pytest.mark.parametrize(("spec", "message"), [
    ("T4", r"'T4': no domain of this name; did you mean T\d\? The catalogue has .*T1, T2, T3.*random-SEED"),
    ("zebra", "'zebra': no domain of this name; The catalogue has"),
    ("", "'': no domain of this name"),
])  # fmt: skip
def test_unknown_names(spec: str, message: str) -> None:
    with pytest.raises(DomainError, match=message):
        load(spec)
