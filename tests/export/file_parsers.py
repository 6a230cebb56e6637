"""The formats' grammars, just enough of each to read back what was written, without the programs that they are for."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
import zipfile
from dataclasses import dataclass, field
from pathlib import Path

import meshio
import numpy as np
from scipy.io import netcdf_file

from envs.types import Floats, Ints


@dataclass
class Found:
    """What a file holds.

    Attributes:
        nodes: (n, 2 or 3) float64.
        corners: (m, 4 or 8) int64.
        sides: corners of the facets, (k, 2 or 4), of each side, and of each line where the format tells them not apart.
        lines: likewise of each line.
        regions: elements of each region.
        sets: nodes of each named part that is a set of nodes.
        cells: all nodes of each element, in the format's order, of formats that the tests know it of.
        curves: places along curved sides, by element and side.
    """

    nodes: Floats
    corners: Ints
    sides: dict[str, Ints] = field(default_factory=dict)
    lines: dict[str, Ints] = field(default_factory=dict)
    regions: dict[str, Ints] = field(default_factory=dict)
    sets: dict[str, Ints] = field(default_factory=dict)
    cells: Ints | None = None
    curves: dict[tuple[int, int], Floats] = field(default_factory=dict)


def ints(texts: list[str]) -> Ints:
    """Rows of numbers."""
    return np.array([text.replace(",", " ").split() for text in texts], dtype=np.int64)


def abaqus(path: Path) -> Found:
    """``*NODE``, ``*ELEMENT``, ``*NSET``, ``*ELSET``, ``*SURFACE``; a data line that ends in a comma goes on."""
    text = path.read_text(encoding="ascii").replace(",\n", ", ")
    found = Found(np.zeros((0, 2)), np.zeros((0, 4), dtype=np.int64))
    faces = {}
    for card in re.split(r"^(?=\*)", text, flags=re.M)[1:]:
        head, *rows = card.splitlines()
        keyword, *options = head.split(", ")
        name = options[0].partition("=")[2] if options else ""
        if keyword == "*NODE":
            found.nodes = np.array([[float(x) for x in row.split(", ")[1:]] for row in rows])
        elif keyword == "*ELEMENT":
            found.cells = ints(rows)[:, 1:] - 1
            found.corners = found.cells[:, : 8 if "C3D" in head else 4]
        elif keyword == "*NSET":
            found.sets[name] = np.concatenate([ints([row])[0] for row in rows]) - 1
        elif keyword == "*ELSET":
            found.regions[name] = np.concatenate([ints([row])[0] for row in rows]) - 1
        elif keyword == "*SURFACE":
            faces[name] = np.array([[int(x) for x in row.split(", S")] for row in rows]) - 1
    local = [[0, 1], [1, 2], [2, 3], [3, 0]]
    if found.corners.shape[1] == 8:
        local = [[0, 1, 2, 3], [4, 7, 6, 5], [0, 4, 5, 1], [1, 5, 6, 2], [2, 6, 7, 3], [3, 7, 4, 0]]
    for name, pairs in faces.items():
        found.sides[name] = found.corners[pairs[:, :1], np.array(local)[pairs[:, 1]]]
    return found


def nastran(path: Path) -> Found:
    """GRID*, CQUAD4, CQUAD8, CHEXA, PSHELL, PSOLID, SET1 and SPC1, of small fields but for GRID."""
    cards: list[list[str]] = []
    names: dict[str, str] = {}
    for line in path.read_text(encoding="ascii").splitlines():
        if line.startswith("$"):
            about = re.match(r"\$ (Set|Property) (\d+): (.*)", line)
            names |= {about[1] + about[2]: about[3]} if about else {}
            continue
        width = 16 if "*" in line[:8] else 8
        fields = [line[i : i + width].strip() for i in range(8, len(line), width)]
        if line[:1] in "+*":
            cards[-1] += fields
        else:
            cards.append([line[:8].strip(), *fields])
    real = lambda text: float(re.sub(r"(?<=[\d.])([+-])", r"e\1", text))  # noqa: E731
    elements = [card for card in cards if card[0] in ("CQUAD4", "CQUAD8", "CHEXA")]
    cells = np.array([card[3:] for card in elements], dtype=np.int64) - 1
    nodes = np.array([[real(x) for x in card[3:6]] for card in cards if card[0] == "GRID*"])
    found = Found(nodes, cells[:, : 8 if elements[0][0] == "CHEXA" else 4], cells=cells)
    region = np.array([int(card[2]) for card in elements])
    for card in cards:
        if card[0] in ("PSHELL", "PSOLID"):
            found.regions[names[f"Property{card[1]}"]] = np.flatnonzero(region == int(card[1]))
        if card[0] == "SET1":
            found.sets[names[f"Set{card[1]}"]] = np.array(card[2:], dtype=np.int64) - 1
        if card[0] == "SPC1":
            assert card[2] == "123456"
            assert (np.array(card[3:], dtype=np.int64) - 1).tolist() == found.sets[names[f"Set{card[1]}"]].tolist()
    return found


def ls_dyna(path: Path) -> Found:
    """``*NODE`` of I8 and F16 fields, ``*ELEMENT`` of I8, ``*PART`` and ``*SET_NODE_LIST_TITLE`` of I10."""
    text = re.sub(r"^\$.*\n", "", path.read_text(encoding="ascii"), flags=re.M)
    found = Found(np.zeros((0, 3)), np.zeros((0, 4), dtype=np.int64))
    cut = lambda row, width: [row[i : i + width] for i in range(0, len(row), width)]  # noqa: E731
    parts, part_of = {}, np.zeros(0)
    for card in re.split(r"^(?=\*)", text, flags=re.M)[1:]:
        head, *rows = card.splitlines()
        if head == "*NODE":
            found.nodes = np.array([[float(x) for x in cut(row[8:], 16)] for row in rows])
            assert [int(row[:8]) for row in rows] == list(range(1, len(rows) + 1))
        elif head.startswith("*ELEMENT"):
            table = np.array([[int(x) for x in cut(row, 8)] for row in rows])
            found.corners, part_of = table[:, 2 : 6 if "SHELL" in head else 10] - 1, table[:, 1]
        elif head == "*PART":
            parts[int(cut(rows[1], 10)[0])] = rows[0]
        elif head == "*SET_NODE_LIST_TITLE":
            found.sets[rows[0]] = np.array([int(x) for row in rows[2:] for x in cut(row, 10)]) - 1
    found.regions = {name: np.flatnonzero(part_of == number) for number, name in parts.items()}
    return found


def ideas(path: Path) -> Found:
    """Datasets 2411, 2412 and 2467; corners are every second node of parabolic elements."""
    blocks = re.findall(r"^    -1\n +(\d+)\n(.*?)^    -1$", path.read_text(encoding="ascii"), flags=re.M | re.S)
    assert [number for number, _ in blocks] == ["2411", "2412", "2467"]
    nodes, elements, groups = (text.splitlines() for _, text in blocks)
    places = np.array([[float(row[i : i + 25].replace("D", "E")) for i in (0, 25, 50)] for row in nodes[1::2]])
    by_label: dict[int, tuple[int, list[int]]] = {}
    while elements:
        label, kind, _, _, _, count = map(int, elements.pop(0).split())
        if kind in (11, 24):
            elements.pop(0)
        row: list[int] = []
        while len(row) < count:
            row += map(int, elements.pop(0).split())
        by_label[label] = kind, [node - 1 for node in row]
    every = [by_label[label] for label in range(1, len(by_label) + 1)]
    corner = {11: [0, 1], 24: [0, 2], 44: range(4), 45: [0, 2, 4, 6], 115: range(8), 116: [0, 2, 4, 6, 12, 14, 16, 18]}
    cells = [[row[i] for i in corner[kind]] for kind, row in every]
    largest = max(map(len, cells))
    full = np.array([row for (_, row), cell in zip(every, cells, strict=True) if len(cell) == largest])
    found = Found(places, np.array([cell for cell in cells if len(cell) == largest]), cells=full)
    while groups:
        count = int(groups.pop(0).split()[7])
        name, rows = groups.pop(0), groups[: (count + 1) // 2]
        del groups[: len(rows)]
        entries = ints(rows[:-1]).reshape(-1, 4).tolist() + np.reshape(rows[-1].split(), (-1, 4)).astype(int).tolist()
        tags = [tag - 1 for _, tag, _, _ in entries]
        assert len(tags) == count
        kinds = {kind for kind, *_ in entries}
        if kinds == {7} or len(cells[tags[0]]) == largest / 4:
            found.sets[name] = np.unique(tags if kinds == {7} else [every[tag][1] for tag in tags])
        elif len(cells[tags[0]]) == largest:
            found.regions[name] = np.array(tags)
        else:
            found.sides[name] = np.array([cells[tag] for tag in tags])
    return found


def su2(path: Path) -> Found:
    """NDIME, NELEM, NPOIN, NMARK and MARKER_TAG with their counts."""
    lines = [line for line in path.read_text(encoding="ascii").splitlines() if not line.startswith("%")]
    take = lambda count: [lines.pop(0).split() for _ in range(count)]  # noqa: E731
    value = lambda key: re.fullmatch(rf"{key}= (\S+)", lines.pop(0))[1]  # noqa: E731
    dimension = int(value("NDIME"))
    elements = take(int(value("NELEM")))
    points = take(int(value("NPOIN")))
    kind, face = {2: ("9", "3"), 3: ("12", "9")}[dimension]
    assert {row[0] for row in elements} == {kind}
    assert [int(row[-1]) for row in points] == list(range(len(points)))
    found = Found(
        np.array([[float(x) for x in row[:dimension]] for row in points]),
        np.array([[int(x) for x in row[1:-1]] for row in elements]),
    )
    for _ in range(int(value("NMARK"))):
        name = value("MARKER_TAG")
        rows = take(int(value("MARKER_ELEMS")))
        assert {row[0] for row in rows} == {face}
        found.sides[name] = np.array([[int(x) for x in row[1:]] for row in rows])
    assert not lines
    return found


def openfoam(path: Path) -> Found:
    """The files of ``constant/polyMesh`` in a folder or an archive; a plane mesh is read from its back."""
    if path.suffix == ".zip":
        with zipfile.ZipFile(path) as archive:
            texts = {name.rsplit("/", 1)[-1]: archive.read(name).decode("ascii") for name in archive.namelist()}
    else:
        folder = path.parent / "constant" / "polyMesh"
        texts = {file.name: file.read_text(encoding="ascii") for file in folder.iterdir()}
    body = {name: text.partition("}\n")[2] for name, text in texts.items()}

    def items(name: str) -> list[str]:
        count, _, rest = body[name].partition("\n(\n")
        rows = rest.rpartition("\n)")[0].splitlines()
        assert len(rows) == int(count)
        return rows

    nodes = np.array([[float(x) for x in row.strip("()").split()] for row in items("points")])
    faces = np.array([[int(x) for x in row[2:-1].split()] for row in items("faces")])
    owner, neighbour = (np.array(items(name), dtype=np.int64) for name in ("owner", "neighbour"))
    inner = len(neighbour)
    # The rules of the format: upper triangular order, and faces that look from their owner.
    assert (owner[:inner] < neighbour).all()
    assert (np.lexsort([neighbour, owner[:inner]]) == np.arange(inner)).all()
    centres = np.array(
        [
            nodes[faces[(owner == c) | (np.append(neighbour, [-1] * (len(faces) - inner)) == c)]].mean(axis=(0, 1))
            for c in range(owner.max() + 1)
        ]
    )
    p = nodes[faces]
    normal = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    assert ((p.mean(axis=1) - centres[owner]) * normal).sum(axis=1).min() > 0.0
    patches = re.findall(r"^(\S+) \{ type (\w+); nFaces (\d+); startFace (\d+); \}$", body["boundary"], flags=re.M)
    assert [int(start) for *_, start in patches] == (
        inner + np.cumsum([0, *(int(n) for _, _, n, _ in patches)])[:-1]
    ).tolist()
    sides = {name: faces[int(start) : int(start) + int(n)] for name, _, n, start in patches}

    def zones(name: str) -> dict[str, Ints]:
        found = re.findall(r"^(\S+) \{ type \w+; \w+ List<label> (\d+)\(([\d ]*)\);", body[name], flags=re.M)
        assert all(int(n) == len(labels.split()) for _, n, labels in found)
        return {zone: np.array(labels.split(), dtype=np.int64) for zone, _, labels in found}

    lines = {name: faces[labels] for name, labels in zones("faceZones").items()}
    points, regions = zones("pointZones"), zones("cellZones")
    if {name: kind for name, kind, *_ in patches}.get("frontAndBack") != "empty":
        return Found(nodes, np.zeros((len(centres), 8), dtype=np.int64), sides, lines, regions, points)
    n = len(nodes) // 2
    assert nodes[:n, :2].tobytes() == nodes[n:, :2].tobytes()
    assert set(nodes[:n, 2]) == {0.0}
    assert set(nodes[n:, 2]) == {1.0}
    flat = sides.pop("frontAndBack")
    back = flat[(flat < n).all(axis=1)]
    corners = np.roll(back[:, ::-1], 1, axis=1)
    level = lambda some: {name: f[f < n].reshape(-1, 2) for name, f in some.items()}  # noqa: E731
    return Found(nodes[:n, :2], corners, level(sides), level(lines), regions, {k: v[v < n] for k, v in points.items()})


def exodus(path: Path) -> Found:
    """Coordinates, blocks, side sets and node sets by their names; the elements in the order of ``elem_num_map``."""
    with netcdf_file(path, "r", mmap=False) as file:
        v = {name: np.array(variable[:]) for name, variable in file.variables.items()}
        kinds = {
            name: variable.elem_type.decode() for name, variable in file.variables.items() if name.startswith("connect")
        }
        assert file.title
    names = lambda kind: [b"".join(row).rstrip(b"\0").decode() for row in v.get(f"{kind}_names", [])]  # noqa: E731
    solid = "coordz" in v
    nodes = np.array([v[f"coord{axis}"] for axis in ("xyz" if solid else "xy")], dtype=np.float64).T
    order = v["elem_num_map"] - 1
    blocks = [v[f"connect{i}"] - 1 for i in range(1, len(names("eb")) + 1)]
    listed = np.concatenate(blocks)
    cells = np.empty_like(listed)
    cells[order] = listed
    assert set(kinds.values()) <= {"QUAD4", "QUAD8", "QUAD9", "HEX8", "HEX20"}
    assert all(name.startswith("HEX") == solid for name in kinds.values())
    found = Found(nodes, cells[:, : 8 if solid else 4].astype(np.int64), cells=cells)
    ends = np.cumsum([0, *map(len, blocks)])
    found.regions = {name: np.sort(order[a:b]) for name, a, b in zip(names("eb"), ends, ends[1:], strict=False)}
    local = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    if solid:
        local = np.array([[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [0, 4, 7, 3], [0, 3, 2, 1], [4, 5, 6, 7]])
    for i, name in enumerate(names("ss"), 1):
        found.sides[name] = listed[v[f"elem_ss{i}"] - 1][
            np.arange(len(v[f"elem_ss{i}"]))[:, None], local[v[f"side_ss{i}"] - 1]
        ]
    found.sets = {name: v[f"node_ns{i}"] - 1 for i, name in enumerate(names("ns"), 1)}
    return found


def xdmf(path: Path) -> Found:
    """Two uniform grids with topology, geometry and an attribute, all in XML."""
    cells, facets = ET.parse(path).getroot().findall("Domain/Grid")

    def data(node: ET.Element, kind: type) -> np.ndarray:
        (item,) = node.findall("DataItem")
        shape = [int(n) for n in item.get("Dimensions", "").split()]
        return np.array((item.text or "").split(), dtype=kind).reshape(shape)

    def parts(grid: ET.Element) -> dict[str, Ints]:
        values = data(grid.find("Attribute"), np.int64).ravel()
        named = {i.get("Value", ""): int(i.get("Name", "")) for i in grid.findall("Information")}
        assert set(values.tolist()) <= set(named.values())
        return {name: np.flatnonzero(values == number) for name, number in named.items()}

    solid = "Hexahedron" in cells.find("Topology").get("TopologyType")
    edges = data(facets.find("Topology"), np.int64)[:, : 4 if solid else 2]
    nodes = data(cells.find("Geometry"), np.float64)
    assert nodes.tobytes() == data(facets.find("Geometry"), np.float64).tobytes()
    elements = data(cells.find("Topology"), np.int64)
    return Found(
        nodes,
        elements[:, : 8 if solid else 4],
        cells=elements,
        sides={name: edges[rows] for name, rows in parts(facets).items()},
        regions=parts(cells),
    )


def mfem(path: Path) -> Found:
    """Elements, boundary, vertices, and of order 2 and above the nodes."""
    text = path.read_text(encoding="ascii")
    assert text.startswith("MFEM mesh v1.0\n")
    names = {
        (about, int(i)): name
        for about, i, name in re.findall(r"^# (attribute|boundary attribute) (\d+): (.*)$", text, flags=re.M)
    }
    words = re.sub(r"^#.*$", "", text, flags=re.M).split("\n")
    rows = [row for row in words if row.strip()][1:]
    where = {row: i for i, row in enumerate(rows)}
    table = lambda key: [row.split() for row in rows[where[key] + 2 : where[key] + 2 + int(rows[where[key] + 1])]]  # noqa: E731
    elements, boundary = (np.array(table(key), dtype=np.int64) for key in ("elements", "boundary"))
    start = where["vertices"]
    count, places = int(rows[start + 1]), rows[start + 3 :]
    if "nodes" in where:
        assert rows[start + 2] == "nodes"
        assert rows[start + 5 : start + 7] == ["VDim: 2", "Ordering: 1"]
        places = rows[start + 7 :]
    found = Found(np.array([row.split() for row in places], dtype=np.float64), elements[:, 2:])
    if "nodes" in where:
        name = next(row for row in rows if row.startswith("FiniteElementCollection: "))
        found.cells = continuous(elements[:, 2:], count, int(name.rpartition("P")[2]))
    assert elements[:, 2:].max() < count
    number = lambda about, name: next(i for key, i in names if key == about and names[key, i] == name)  # noqa: E731
    for (about, _), name in names.items():
        if about == "attribute":
            found.regions[name] = np.flatnonzero(elements[:, 0] == number(about, name))
        else:
            found.sides[name] = boundary[boundary[:, 0] == number(about, name), 2:]
    return found


def continuous(corners: Ints, count: int, order: int) -> Ints:
    """(m, (order + 1)^2): the values of a continuous function that elements have, row by row.

    Values at vertices come first, then those inside edges, which are numbered as the elements have them first, each
    from its lower vertex on, then those inside elements, row by row.
    """
    inner = order - 1
    number: dict[frozenset[int], int] = {}
    for row in corners.tolist():
        for a, b in zip(row, (*row[1:], row[0]), strict=True):
            number.setdefault(frozenset((a, b)), len(number))
    found = np.empty((len(corners), order + 1, order + 1), dtype=np.int64)
    for i, row in enumerate(corners.tolist()):
        found[i, 0, 0], found[i, 0, order], found[i, order, order], found[i, order, 0] = row
        walks = []
        for a, b in zip(row, (*row[1:], row[0]), strict=True):
            values = count + number[frozenset((a, b))] * inner + np.arange(inner)
            walks.append(values if a < b else values[::-1])
        found[i, 0, 1:order], found[i, 1:order, order] = walks[0], walks[1]
        found[i, order, 1:order], found[i, 1:order, 0] = walks[2][::-1], walks[3][::-1]
        first = count + len(number) * inner + i * inner * inner
        found[i, 1:order, 1:order] = first + np.arange(inner * inner).reshape(inner, inner)
    return found.reshape(len(corners), -1)


def hohqmesh(path: Path) -> Found:
    """ISM-V2: nodes, edges and element blocks; what the edges say is held against the elements."""
    lines = path.read_text(encoding="ascii").splitlines()
    assert lines.pop(0) == "ISM-V2"
    n, e, m, order = map(int, lines.pop(0).split())
    nodes = np.array([[float(x) for x in lines.pop(0).split()] for _ in range(n)])
    edges = ints([lines.pop(0) for _ in range(e)])
    corners, found = [], Found(nodes[:, :2], np.zeros((m, 4), dtype=np.int64))
    # The corners that sides 1 to 4 run from and to.
    ends = ((0, 1), (1, 2), (3, 2), (0, 3))
    outer: dict[str, list[list[int]]] = {}
    for i in range(m):
        nodes_of = [int(x) - 1 for x in lines.pop(0).split()]
        corners.append(nodes_of)
        for side, flag in enumerate(lines.pop(0).split()):
            if flag == "1":
                curve = np.array([[float(x) for x in lines.pop(0).split()] for _ in range(order + 1)])
                assert curve[[0, -1]].tolist() == nodes[[nodes_of[k] for k in ends[side]]].tolist()
                found.curves[i, side] = curve
        for side, name in enumerate(lines.pop(0).split()):
            if name != "---":
                outer.setdefault(name, []).append([nodes_of[side], nodes_of[(side + 1) % 4]])
    assert not lines
    found.corners, found.sides = np.array(corners), {name: np.array(some) for name, some in outer.items()}
    for a, b, left, right, first, second in edges.tolist():
        walked = [corners[left - 1][first - 1], corners[left - 1][first % 4]]
        assert walked == [a - 1, b - 1]
        if right == 0:
            assert second == 0
            continue
        one = [corners[left - 1][k] for k in ends[first - 1]]
        other = [corners[right - 1][k] for k in ends[abs(second) - 1]]
        assert one == (other if second > 0 else other[::-1])
    return found


def through_meshio(path: Path) -> Found:
    """Gmsh's and VTK's files, their groups by number and field data."""
    mesh = meshio.read(path, file_format="gmsh" if path.suffix == ".msh" else "vtu")
    numbers = mesh.cell_data["gmsh:physical" if path.suffix == ".msh" else "group"]
    dimension = max(int(about[1]) for about in mesh.field_data.values())
    size, side = (4, 2) if dimension == 2 else (8, 4)
    cells = [(np.asarray(block.data), np.asarray(values)) for block, values in zip(mesh.cells, numbers, strict=True)]
    largest = max(data.shape[1] for data, _ in cells)
    body = [(data, values) for data, values in cells if data.shape[1] == largest]
    region_of = np.concatenate([values for _, values in body])
    found = Found(mesh.points, np.concatenate([data[:, :size] for data, _ in body]))
    for name, (number, of_dimension) in mesh.field_data.items():
        mine = [data[values == number] for data, values in cells if (values == number).any()]
        if of_dimension == dimension:
            found.regions[name] = np.flatnonzero(region_of == number)
        elif of_dimension == dimension - 1:
            found.sides[name] = np.concatenate([data[:, :side] for data in mine])
        else:
            found.sets[name] = np.unique(np.concatenate([data.ravel() for data in mine]))
    return found


PARSERS = {
    ".inp": abaqus, ".bdf": nastran, ".k": ls_dyna, ".unv": ideas, ".su2": su2, ".foam": openfoam, ".zip": openfoam,
    ".e": exodus, ".exo": exodus, ".xdmf": xdmf, ".mesh": mfem, ".ism": hohqmesh, ".msh": through_meshio,
    ".vtu": through_meshio,
}  # fmt: skip
