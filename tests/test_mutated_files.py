"""Broken files of every format: a domain or one clear line, never anything else."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import shapely

from envs import rings
from envs.domain import load, load_all
from envs.readers import READERS, source
from envs.types import DomainError

#: Mutated files of each format.
FILES = 250

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
"""

MSH_2 = """$MeshFormat
2.2 0 8
$EndMeshFormat
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
1 1 2 0 1 1 2
2 2 2 0 1 1 2 5
3 2 2 0 1 2 3 5
4 2 2 0 1 3 4 5
5 2 2 0 1 4 1 5
$EndElements
"""

MSH_4 = """$MeshFormat
4.1 0 8
$EndMeshFormat
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
        {"type": "Feature", "properties": {}, "geometry": shapely.geometry.mapping(shapely.box(4, 0, 6, 3))},
    ]}).encode(),
    ".json": json.dumps(RING).encode(),
    ".wkt": PLATE.wkt.encode(),
    ".csv": ("x,y\n" + "".join(f"{x},{y}\n" for x, y in RING) + "\n1.0,1\n2e0,1\n2,2\n1,2\n").encode(),
    ".dxf": dxf_text().encode(),
    ".geo": GEO.encode(),
    ".msh": MSH_2.encode(),
    "4.msh": MSH_4.encode(),
    "binary.msh": binary_msh(),
}  # fmt: skip

#: What mutations put in.
SPLINTERS = [
    b"nan", b"inf", b"-inf", b"1e999", b"-1", b"99999999999", b"0", b"1e308", b"1e-300", b"\x00", b"\xff\xff\xff\x7f",
    b"{", b"}", b"[", b"]", b"(", b")", b";", b",", b"\n", b" ", b"/*", b"$End", b"\r", b"\xe2\x82\xac", b":", b"^",
]  # fmt: skip


def mutations(content: bytes, files: int) -> Iterator[bytes]:
    """Changed copies: bytes put in, left out, changed, repeated, or all the rest cut off."""
    rng = np.random.default_rng(0)
    for _ in range(files):
        changed = bytearray(content)
        for _ in range(int(rng.integers(1, 4))):
            at = int(rng.integers(0, len(changed) + 1))
            until = at + int(rng.integers(1, 20))
            kind = int(rng.integers(0, 6))
            if kind == 0:
                changed[at:at] = SPLINTERS[int(rng.integers(len(SPLINTERS)))]
            elif kind == 1:
                del changed[at:until]
            elif kind == 2:
                changed[at : at + 1] = SPLINTERS[int(rng.integers(len(SPLINTERS)))]
            elif kind == 3 and at < len(changed):
                changed[at] ^= 1 << int(rng.integers(0, 8))
            elif kind == 4:
                changed[at:at] = changed[at:until] * int(rng.integers(1, 4))
            elif rng.random() < 0.2:
                del changed[at:]
        yield bytes(changed)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", SOUND)
def test_mutated_files_are_domains_or_one_line(tmp_path: Path, name: str) -> None:
    if name == ".dxf":
        pytest.importorskip("ezdxf")
    path = tmp_path / f"part{name}"
    path.write_bytes(SOUND[name])
    assert load_all(path, edge_length=0.5)
    refused = 0
    for i, content in enumerate(mutations(SOUND[name], FILES)):
        path.write_bytes(content)
        try:
            domains = load_all(path, edge_length=(None, 0.3)[i % 2], fix_parity=True)
        except DomainError as error:
            refused += 1
            message = str(error)
            assert message.startswith(f"{path}: "), message
            assert "\n" not in message
        else:
            assert domains
            assert all(len(domain.ring) % 2 == 0 and domain.area > 0 for domain in domains)
    assert 0 < refused < FILES


@pytest.mark.parametrize("extension", READERS)
def test_files_that_are_too_large_are_not_read(tmp_path: Path, extension: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(source, "MOST_BYTES", 1000)
    monkeypatch.setattr(source, "MOST_BYTES_OF", {".msh": 1500})
    path = tmp_path / f"part{extension}"
    path.write_bytes(b" " * 2000)
    with pytest.raises(DomainError, match=r"0 MB, more than the 0 MB such a file may have; split or simplify it"):
        load(path)


def test_too_many_vertices_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rings, "MOST_VERTICES", 1000)
    path = tmp_path / "part.csv"
    path.write_text("0 0\n" * 1001)
    with pytest.raises(DomainError, match="1,001 vertices, at most 1,000 are possible; split or simplify"):
        load(path)


@pytest.mark.parametrize("extension", READERS)
def test_devices_are_not_read(extension: str, tmp_path: Path) -> None:
    path = tmp_path / f"part{extension}"
    path.symlink_to("/dev/zero")
    with pytest.raises(DomainError, match="not a regular file"):
        load(path)
