"""Broken files of every format: a domain or one clear line, never anything else."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import shapely
from confined import confined_pool, each
from mutants import mutants

from envs.domains.load import load, load_all
from envs.polygons import rings
from envs.readers import geo_gmsh
from envs.readers.formats import BY_SUFFIX
from envs.types import DomainError

pytestmark = pytest.mark.slow

#: Mutated files of each format.
FILES = 3000

PLATE = shapely.box(0, 0, 4, 3).difference(shapely.box(1, 1, 2, 2))
RING = list(PLATE.exterior.coords)


def dxf_pairs(*pairs: tuple[int, object]) -> str:
    """Group codes and values as DXF has them."""
    return "".join(f"{code}\n{value}\n" for code, value in pairs)


def dxf_text() -> str:
    """A drawing of the first version's few words: chained lines, arc and spline, a bulged polyline, round holes."""
    entities: list[tuple[int, object]] = []
    for (x, y), (u, v) in (((0, 0), (8, 0)), ((8, 0), (8, 6))):
        entities += [(0, "LINE"), (8, "0"), (10, x), (20, y), (11, u), (21, v)]
    for x, y, u, v in ((0, 5.5, 8, 5), (4, 5, 4, 7), (7, 0, 8, 0), (3, 3, 9, 3)):
        entities += [(0, "LINE"), (8, "cut"), (10, x), (20, y), (11, u), (21, v)]
    entities += [(0, "ARC"), (8, "0"), (10, 4), (20, 6), (40, 4), (50, 0), (51, 180)]
    header = [(0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, "AC1015"), (0, "ENDSEC")]
    entities += [(0, "SPLINE"), (100, "AcDbEntity"), (8, "0"), (100, "AcDbSpline"), (70, 8), (71, 3), (72, 8), (73, 4)]
    entities += [(40, knot) for knot in (0, 0, 0, 0, 1, 1, 1, 1)]
    for x, y in ((0, 6), (-1, 4), (1, 2), (0, 0)):
        entities += [(10, x), (20, y), (30, 0)]
    entities += [(0, "ELLIPSE"), (100, "AcDbEntity"), (8, "0"), (100, "AcDbEllipse"), (10, 6), (20, 1.5)]
    entities += [(11, 1), (21, 0), (31, 0), (40, 0.5), (41, 0), (42, 6.2831853)]
    entities += [(0, "POLYLINE"), (8, "0"), (66, 1), (70, 1)]
    for x, y, bulge in ((1, 1, 0), (2, 1, 0.5), (2, 2, 0), (1, 2, 0)):
        entities += [(0, "VERTEX"), (8, "0"), (10, x), (20, y), (42, bulge)]
    entities += [(0, "SEQEND"), (8, "0"), (0, "CIRCLE"), (8, "0"), (10, 5), (20, 3), (40, 1)]
    return dxf_pairs(*header, (0, "SECTION"), (2, "ENTITIES"), *entities, (0, "ENDSEC"), (0, "EOF"))


GEO = """lc = 1 / 2; r = Sqrt(4);
Point(1) = {0, 0, 0, lc}; Point(2) = {r, 0, 0}; Point(3) = {0, r, 0}; Point(4) = {-r, -r, 0}; Point(5) = {-1, 2, 0};
Circle(1) = {2, 1, 3}; BSpline(2) = {3, 5, 4}; Line(3) = {4, 2};
Transfinite Curve {3} = 5 Using Progression 1.5;
Curve Loop(1) = {1:3}; Plane Surface(1) = {1};
Physical Surface("a") = {1};
c[] = {}; Macro Side
  If (k > 7) c[] += k; ElseIf (k == 0) c[0] = 1; Else d = #c[] > 2 ? k : -k; EndIf
Return
For k In {6:8}
  Point(k) = {k, Hypot(k, 3), 0, lc}; Call Side;
EndFor
t() = Translate {9, 0, 0} { Duplicata { Surface{1}; } };
Rotate {{0, 0, 1}, {1, 2, 0}, Pi / 3} { Surface{t(0)}; }
Point(20) = {0.4, 0.3, 0}; Point{20} In Surface{1};
Physical Curve(StrCat("b", Sprintf("%g", k)), 4) = {1, -2}; Physical Point(9) = {2};
Delete { Point{7}; }
"""

SVG = """<?xml version="1.0"?>
<svg xmlns="http://www.w3.org/2000/svg" width="10mm" viewBox="0 0 10 8">
<style>.thin { fill: none }</style>
<g id="plate" transform="rotate(3) translate(1,1)"><path d="M0 0H8V6C6 7 2 5 0 6z"/></g>
<circle id="hole" cx="3" cy="4.4" r=".8"/><use href="#hole" x="3"/>
<path class="thin" d="m2 2a1 .5 10 1 0 .1 0zM9 0 9 1"/>
<rect x="20" y="1" width="3" height="2" rx=".5"/><polygon points="20,5 23,5 23,7 20,7"/>
</svg>
"""

MSH_2 = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
2
1 7 "low"
2 3 "steel"
$EndPhysicalNames
$Nodes
5
1 0 0 0
2 2 0 0
3 2 2 0
4 0 2 0
5 1 1 0
$EndNodes
$Elements
5
1 1 2 7 1 1 2
2 2 2 3 1 1 2 5
3 2 2 0 1 2 3 5
4 2 2 0 1 3 4 5
5 2 2 0 1 4 1 5
$EndElements
"""

MSH_4 = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
1
1 7 "low"
$EndPhysicalNames
$Entities
1 1 0 0
1 0 0 0 0
1 0 0 0 2 2 0 1 7 2 1 -1
$EndEntities
$Nodes
1 4 1 4
1 1 0 4
1
2
3
4
0 0 0
2 0 0
2 2 0
0 2 0
$EndNodes
$Elements
1 4 1 4
1 1 1 4
1 1 2
2 2 3
3 3 4
4 4 1
$EndElements
"""


def binary_msh() -> bytes:
    """The lines of ``MSH_4`` in binary."""

    def ints(*values: int) -> bytes:
        return np.array(values, dtype="<i4").tobytes()

    def sizes(*values: int) -> bytes:
        return np.array(values, dtype="<u8").tobytes()

    points = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]], dtype="<f8").tobytes()
    nodes = sizes(1, 4, 1, 4) + ints(1, 1, 0) + sizes(4) + sizes(1, 2, 3, 4) + points
    lines = sizes(1, 4, 1, 4) + ints(1, 1, 1) + sizes(4) + sizes(1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4, 1)
    return b"".join([
        b"$MeshFormat\n4.1 1 8\n", ints(1), b"\n$EndMeshFormat\n$Nodes\n", nodes, b"\n$EndNodes\n$Elements\n", lines,
        b"\n$EndElements\n",
    ])  # fmt: skip


SOUND = {
    ".geojson": json.dumps({"type": "FeatureCollection", "features": [
        {"type": "Feature", "properties": {}, "geometry": shapely.geometry.mapping(PLATE)},
        {"type": "Feature", "properties": {"name": "b"}, "geometry": shapely.geometry.mapping(shapely.box(4, 0, 6, 3))},
        {"type": "Feature", "properties": {"name": "top"}, "geometry": {
            "type": "LineString", "coordinates": [[0, 3], [6, 3]]}},
    ]}).encode(),
    ".json": json.dumps(RING).encode(),
    ".wkt": PLATE.wkt.encode(),
    "collection.wkt": f"GEOMETRYCOLLECTION ({PLATE.wkt}, LINESTRING (0 3, 4 3), POINT (3 1))".encode(),
    ".csv": ("x,y\n" + "".join(f"{x},{y}\n" for x, y in RING) + "\n1.0,1\n2e0,1\n2,2\n1,2\n").encode(),
    "names.csv": ("x,y,name\n" + "".join(f"{x},{y},{'ab'[i % 2]}\n" for i, (x, y) in enumerate(RING))).encode(),
    ".dxf": dxf_text().encode(),
    ".svg": SVG.encode(),
    ".geo": GEO.encode(),
    ".msh": MSH_2.encode(),
    "4.msh": MSH_4.encode(),
    "binary.msh": binary_msh(),
}  # fmt: skip


@pytest.fixture(scope="module")
def pool() -> Iterator[ProcessPoolExecutor]:
    """Processes of little memory."""
    with confined_pool() as children:
        yield children


def check_line(message: str, path: Path) -> None:
    """Refusals are one line that can be printed, of a bounded length, and not for lack of memory."""
    assert message.startswith(f"{path}: ")
    told = message.removeprefix(f"{path}: ")
    assert told.isprintable()
    assert len(told) < 400
    assert "allocate" not in told


def is_domain(path: Path, number: int) -> bool:
    """Whether a file gave domains, which must then be sound."""
    try:
        domains = load_all(path, edge_length=(None, 1.0)[number % 2], fix_parity=True)
    except DomainError as error:
        check_line(str(error), path)
        return False
    assert domains
    assert all(len(domain.ring) % 2 == 0 and domain.area > 0 for domain in domains)
    return True


def domains_among_mutants(name: str, seed: int, folder: Path) -> int:
    """How many mutants of a sound file are domains still; run in a process of the pool, which Gmsh is too large for."""
    geo_gmsh.installed = lambda: False
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return each(mutants(SOUND[name], FILES // 2, seed), folder / f"part{seed}{name}", is_domain)


@pytest.mark.parametrize("name", SOUND)
def test_mutated_files_are_domains_or_one_line(tmp_path: Path, name: str, pool: ProcessPoolExecutor) -> None:
    if name.endswith(".dxf"):
        pytest.importorskip("ezdxf")
    path = tmp_path / f"part{name}"
    path.write_bytes(SOUND[name])
    assert load_all(path, edge_length=0.5)
    shares = [pool.submit(domains_among_mutants, name, seed, tmp_path) for seed in (0, 1)]
    assert 0 < sum(share.result() for share in shares) < FILES / 2


@pytest.mark.parametrize("extension", BY_SUFFIX)
def test_files_that_are_too_large_are_not_read(tmp_path: Path, extension: str) -> None:
    path = tmp_path / f"part{extension}"
    with path.open("wb") as file:
        file.truncate(BY_SUFFIX[extension].most_bytes + 1_000_000)  # a hole: it takes no room on the disk
    with pytest.raises(DomainError, match=r"\d+ MB, more than the \d+ MB such a file may have; split or simplify it"):
        load(path)


def test_too_many_vertices_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rings, "MOST_VERTICES", 1000)
    path = tmp_path / "part.csv"
    path.write_text("0 0\n" * 1001)
    with pytest.raises(DomainError, match="1,001 vertices, at most 1,000 are possible; split or simplify"):
        load(path)


@pytest.mark.parametrize("extension", BY_SUFFIX)
def test_devices_are_not_read(extension: str, tmp_path: Path) -> None:
    path = tmp_path / f"part{extension}"
    path.symlink_to("/dev/zero")
    with pytest.raises(DomainError, match="not a regular file"):
        load(path)
