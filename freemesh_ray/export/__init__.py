"""Meshes as files for other programs: VTK, Gmsh, Abaqus or CalculiX, Nastran and Wavefront.

Vertices keep their order, elements their order and their counter-clockwise corners. Every bit of the coordinates is
kept but in Nastran's fields of sixteen characters (see :mod:`freemesh_ray.export.nastran`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from envs.mesh import Mesh
from freemesh_ray.export import abaqus, gmsh, nastran, vtk, wavefront
from freemesh_ray.export.finite_elements import FiniteElements, finite_elements
from freemesh_ray.storage.atomic import OutputError, replacing

__all__ = ["SUFFIXES", "write"]

#: What `write` can write.
SUFFIXES = (".vtu", ".msh", ".inp", ".bdf", ".obj")


def write(mesh: Mesh, path: str | Path, version: str = "4.1", quadratic: bool = False) -> None:
    """Write a mesh in the format that the extension names; the file is there as a whole or not at all.

    Args:
        mesh: vertices get z = 0; ``.vtu`` and ``.msh`` (4.1) carry the element quality as ``eta``. ``.msh``,
            ``.inp`` and ``.bdf`` name the boundary, and each loop of it where there are several.
        path: ending in one of `SUFFIXES`; missing folders are made.
        version: of the Gmsh format, ``4.1`` or ``2.2``.
        quadratic: elements of eight nodes: the corners, then one halfway along each side (not ``.obj``).

    Raises:
        OutputError: another extension or version, a format without quadratic elements, a mesh without elements, or a
            place that cannot be written to.
    """
    path = Path(path)
    writers: dict[str, Callable[[FiniteElements, Path], None]] = {
        ".vtu": vtk.write,
        ".msh": partial(gmsh.write, version=version),
        ".inp": abaqus.write,
        ".bdf": nastran.write,
        ".obj": wavefront.write,
    }
    suffix = path.suffix.lower()
    if suffix not in writers:
        raise OutputError(f"{path}: unknown format {path.suffix or '(none)'}: use one of {', '.join(writers)}")
    if version not in gmsh.VERSIONS:
        raise OutputError(f"{path}: unknown Gmsh version {version}: use one of {', '.join(gmsh.VERSIONS)}")
    if quadratic and suffix == ".obj":
        raise OutputError(f"{path}: .obj has no quadratic elements: write linear ones, or another format")
    if not len(mesh.quads):
        raise OutputError(f"{path}: {mesh.name} has no elements: there is nothing to write")
    with replacing(path) as draft:
        writers[suffix](finite_elements(mesh, quadratic), draft)
