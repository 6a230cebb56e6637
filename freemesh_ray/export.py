"""Meshes as files for other programs: VTK (``.vtu``), Gmsh (``.msh``) and Abaqus or CalculiX (``.inp``).

Vertices keep their order and every bit of their coordinates, elements their order and their counter-clockwise corners.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import meshio
import numpy as np

from envs.mesh import Mesh
from envs.quality import element_quality
from freemesh_ray.atomic import OutputError, replacing

#: Gmsh file versions -> meshio's names for them.
GMSH = {"4.1": "gmsh", "2.2": "gmsh22"}
#: Most numbers on a data line of an Abaqus set.
PER_LINE = 16


#: What `write` can write.
SUFFIXES = (".vtu", ".msh", ".inp")


def write(mesh: Mesh, path: str | Path, version: str = "4.1") -> None:
    """Write a mesh in the format that the extension names; the file is there as a whole or not at all.

    Args:
        mesh: vertices get z = 0; ``.vtu`` and ``.msh`` carry the element quality as cell data ``eta``.
        path: ending in ``.vtu``, ``.msh`` or ``.inp``; missing folders are made.
        version: of the Gmsh format, ``4.1`` or ``2.2``.

    Raises:
        OutputError: another extension or version, a mesh without elements, or a place that cannot be written to.
    """
    path = Path(path)
    writers: dict[str, Callable[[Path], object]] = {
        ".vtu": lambda draft: _through_meshio(mesh, draft, "vtu"),
        ".msh": lambda draft: _through_meshio(mesh, draft, GMSH[version]),
        ".inp": lambda draft: draft.write_bytes(_abaqus(mesh).encode("ascii")),
    }
    writer = writers.get(path.suffix.lower())
    if writer is None:
        raise OutputError(f"{path}: unknown format {path.suffix or '(none)'}: use one of {', '.join(writers)}")
    if version not in GMSH:
        raise OutputError(f"{path}: unknown Gmsh version {version}: use one of {', '.join(GMSH)}")
    if not len(mesh.quads):
        raise OutputError(f"{path}: {mesh.name} has no elements: there is nothing to write")
    with replacing(path) as draft:
        writer(draft)


def _through_meshio(mesh: Mesh, path: Path, file_format: str) -> None:
    points = np.column_stack([mesh.vertices, np.zeros(len(mesh.vertices))])
    eta = element_quality(mesh.vertices, mesh.quads)
    data, options = {"eta": [eta]}, {}
    if file_format in GMSH.values():
        # meshio writes the repr of every item, which of a NumPy float no reader understands, of a Python float all do.
        data, options = {"eta": [eta.astype(object)]}, {"binary": False, "float_fmt": ".16e"}  # 17 digits: every bit
    if file_format == GMSH["2.2"]:
        data |= {tag: [np.ones(len(eta), dtype=np.int32)] for tag in ("gmsh:physical", "gmsh:geometrical")}
    meshio.Mesh(points, [("quad", mesh.quads)], cell_data=data).write(path, file_format=file_format, **options)


def _abaqus(mesh: Mesh) -> str:
    """The Abaqus input deck of the geometry.

    Sets: nodes and elements ``ALL``, nodes ``BOUNDARY``, and the surface ``BOUNDARY`` of the element faces on it, to
    hang supports and loads on.
    """
    heading = f"{mesh.name}: {len(mesh.quads)} quadrilaterals"
    nodes = (f"{i}, {_coordinate(x)}, {_coordinate(y)}" for i, (x, y) in enumerate(mesh.vertices.tolist(), 1))
    elements = (f"{i}, {', '.join(map(str, quad))}" for i, quad in enumerate((mesh.quads + 1).tolist(), 1))
    return "\n".join([
        "*HEADING",
        "".join(c if c.isascii() and c.isprintable() else "?" for c in heading),
        "*NODE, NSET=ALL", *nodes,
        "*ELEMENT, TYPE=CPE4, ELSET=ALL", *elements,
        "*NSET, NSET=BOUNDARY", *_lines(np.flatnonzero(mesh.on_boundary) + 1),
        "*SURFACE, NAME=BOUNDARY, TYPE=ELEMENT", *_boundary_faces(mesh),
        "",
    ])  # fmt: skip


def _coordinate(value: float) -> str:
    """The shortest text that reads back to the same bits, without an exponent.

    Solvers may read no more than 20 characters of a number. Cut there, a plain decimal loses digits that do not
    matter; one with an exponent would lose the exponent.
    """
    return np.format_float_positional(value, unique=True, trim="0")


def _lines(numbers: Sequence[int] | np.ndarray) -> Iterable[str]:
    return (", ".join(map(str, numbers[i : i + PER_LINE])) for i in range(0, len(numbers), PER_LINE))


def _boundary_faces(mesh: Mesh) -> Iterable[str]:
    """``element, face`` of every element edge on the boundary; face Sk runs from corner k to the next."""
    given = {tuple(edge) for edge in np.sort(mesh.segments, axis=1).tolist()}
    sides = np.sort(np.stack([mesh.quads, np.roll(mesh.quads, -1, axis=1)], axis=-1), axis=-1)
    for element, edges in enumerate(sides.tolist(), 1):
        yield from (f"{element}, S{face}" for face, edge in enumerate(edges, 1) if tuple(edge) in given)
