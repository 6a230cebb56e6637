"""OpenFOAM's ``polyMesh``: points, faces between two cells or at the boundary, and zones.

A plane mesh is one cell thick, from z = 0 to 1, with the patch ``frontAndBack`` of type ``empty``. Sides are patches,
regions cell zones, lines face zones, points point zones. Where a side is a wall or a symmetry plane, its ``type`` in
``boundary`` is the user's to change.

In a folder: ``case.foam``, which ParaView opens, beside ``constant/polyMesh``; in an archive: the same.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np

from envs.types import Ints
from freemesh_ray.export.element_kinds import hexahedron
from freemesh_ray.export.facets import matched, numbered, sides_of
from freemesh_ray.export.finite_elements import Facets, FiniteElements, NodeSet

#: Where the mesh of a case lies.
FOLDER = "constant/polyMesh"
#: The patch of the faces at z = 0 and z = 1.
EMPTY = "frontAndBack"
#: The patch of faces that a mesh which is not complete has beside its sides.
UNFINISHED = "unfinished"


def write(mesh: FiniteElements, path: Path) -> None:
    """Write an archive of the files."""
    bytes_of = BytesIO()
    with zipfile.ZipFile(bytes_of, "w") as archive:
        for name, text in files(mesh, f"{path.stem}.foam").items():
            # Without the time, so that a mesh gives the same bytes.
            archive.writestr(zipfile.ZipInfo(name), text, zipfile.ZIP_DEFLATED)
    path.write_bytes(bytes_of.getvalue())


def files(mesh: FiniteElements, marker: str) -> dict[str, bytes]:
    """The files of a case by their names in its folder.

    Args:
        mesh: of order 1.
        marker: what the file is called by which ParaView opens the case.
    """
    plane = mesh.kind.dimension == 2
    title, solid = mesh.title, _thick(mesh) if plane else mesh
    texts = {marker: f"{title}\n"}
    for name, kind, body in _parts(solid, plane):
        texts[f"{FOLDER}/{name}"] = "\n".join([*_header(name, kind), *body, ""])
    return {name: text.encode("ascii") for name, text in texts.items()}


def _thick(mesh: FiniteElements) -> FiniteElements:
    """The plane mesh as one layer of hexahedra."""
    n, kind = len(mesh.nodes), hexahedron(8)
    below = mesh.places
    elements = np.hstack([mesh.elements, mesh.elements + n])

    def raised(part: Facets) -> Facets:
        a, b = part.facets.T
        faces = np.stack([a, b, b + n, a + n], axis=1)
        return replace(part, nodes=np.union1d(part.nodes, part.nodes + n), sides=part.sides + 2, facets=faces)

    front, every = np.arange(len(elements)), sides_of(elements, kind)
    flat = Facets(
        EMPTY, np.arange(2 * n), np.repeat(front, 2), np.tile([0, 1], len(front)), every[:, :2].reshape(-1, 4)
    )
    points = tuple(NodeSet(point.name, np.vstack([point.cells, point.cells + n])) for point in mesh.points)
    return replace(
        mesh,
        nodes=np.concatenate([below, below + np.array([0.0, 0.0, 1.0])]),
        elements=elements,
        kind=kind,
        eta=None,
        sides=(*map(raised, mesh.sides), flat),
        lines=tuple(map(raised, mesh.lines)),
        points=points,
    )


def _parts(mesh: FiniteElements, plane: bool) -> Iterator[tuple[str, str, Iterable[str]]]:
    """Name, class and lines of every file.

    Faces between cells come first, by the lower cell and then the higher one, and face the higher; those of the sides
    follow, one side after the other.
    """
    flat = sides_of(mesh.elements, mesh.kind).reshape(-1, 4)
    cells = np.repeat(np.arange(len(mesh.elements)), len(mesh.kind.sides))
    number, count = numbered(flat)
    order = np.argsort(number, kind="stable")
    shared = (np.cumsum(count) - count)[count == 2]
    lower, upper = order[shared], order[shared + 1]
    inner = np.lexsort([cells[upper], cells[lower]])
    lower, upper = lower[inner], upper[inner]
    sides = [*mesh.sides, *_unfinished(mesh, count[number].reshape(len(mesh.elements), -1) == 1)]
    faces = np.concatenate([flat[lower], *(side.facets for side in sides)])
    owner = np.concatenate([cells[lower], *(side.elements for side in sides)])
    about = f"nPoints:{len(mesh.nodes)} nCells:{len(mesh.elements)} nFaces:{len(faces)} nInternalFaces:{len(lower)}"
    labels = f'labelList;\n    note        "{about}"'
    yield "points", "vectorField", _list(f"({' '.join(map(repr, point))})" for point in mesh.nodes.tolist())
    yield "faces", "faceList", _list(f"4({' '.join(map(str, face))})" for face in faces.tolist())
    yield "owner", labels, _list(map(str, owner.tolist()))
    yield "neighbour", labels, _list(map(str, cells[upper].tolist()))
    yield "boundary", "polyBoundaryMesh", _patches(sides, len(lower), plane)
    regions = [(region.name, region.elements, None) for region in mesh.regions]
    yield "cellZones", "regIOobject", _zones("cell", regions)
    lines = [(line.name, *matched(flat[lower], line.facets)) for line in mesh.lines]
    yield "faceZones", "regIOobject", _zones("face", lines)
    yield "pointZones", "regIOobject", _zones("point", [(point.name, point.nodes, None) for point in mesh.points])


def _unfinished(mesh: FiniteElements, left: np.ndarray) -> Iterator[Facets]:
    """The faces of one cell alone, (m, 6) bool, that are on no side: those of a mesh that is not complete."""
    for side in mesh.sides:
        left[side.elements, side.sides] = False
    if left.any():
        elements, sides = np.nonzero(left)
        facets = sides_of(mesh.elements, mesh.kind)[elements, sides]
        yield Facets(UNFINISHED, np.unique(facets), elements, sides, facets)


def _header(name: str, kind: str) -> Iterator[str]:
    yield from ("FoamFile", "{", "    version     2.0;", "    format      ascii;", f"    class       {kind};")
    yield from (f'    location    "{FOLDER}";', f"    object      {name};", "}")


def _list(items: Iterable[str]) -> Iterator[str]:
    """How many, then they, a line each."""
    rows = list(items)
    yield from (str(len(rows)), "(", *rows, ")")


def _patches(sides: Sequence[Facets], start: int, plane: bool) -> Iterator[str]:
    yield from (str(len(sides)), "(")
    for side in sides:
        kind = "empty" if plane and side.name == EMPTY else "patch"
        yield f"{side.name} {{ type {kind}; nFaces {len(side.facets)}; startFace {start}; }}"
        start += len(side.facets)
    yield ")"


def _zones(what: str, zones: Sequence[tuple[str, Ints, np.ndarray | None]]) -> Iterator[str]:
    """Zones of cells, faces or points; of faces with whether each looks the same way as the zone."""
    yield from (str(len(zones)), "(")
    for name, labels, same_way in zones:
        numbers = " ".join(map(str, labels.tolist()))
        yield f"{name} {{ type {what}Zone; {what}Labels List<label> {len(labels)}({numbers});"
        if same_way is not None:
            flips = " ".join(str(int(not same)) for same in same_way.tolist())
            yield f"flipMap List<bool> {len(labels)}({flips});"
        yield "}"
    yield ")"
