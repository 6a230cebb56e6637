"""Meshes as files for other programs: VTK, Gmsh, Abaqus or CalculiX, Nastran and Wavefront.

Vertices keep their order, elements their order and their counter-clockwise corners. Every bit of the coordinates is
kept but in Nastran's fields of sixteen characters (see :mod:`freemesh_ray.export.nastran`).
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from freemesh_ray.export.formats import FORMATS, MSH_VERSIONS, SUFFIXES
from freemesh_ray.storage.atomic import OutputError, replacing

if TYPE_CHECKING:
    from envs.mesh import Mesh

__all__ = ["FORMATS", "MSH_VERSIONS", "SUFFIXES", "write"]


def write(mesh: Mesh, path: str | Path, version: str = MSH_VERSIONS[0], quadratic: bool = False) -> None:
    """Write a mesh in the format that the extension names; the file is there as a whole or not at all.

    Args:
        mesh: vertices get z = 0; ``.vtu`` and ``.msh`` (4.1) carry the element quality as ``eta``. ``.msh``,
            ``.inp`` and ``.bdf`` name the boundary, and each loop of it where there are several.
        path: ending in one of `SUFFIXES`; missing folders are made.
        version: of the Gmsh format, one of `MSH_VERSIONS`.
        quadratic: elements of eight nodes: the corners, then one halfway along each side (not ``.obj``).

    Raises:
        OutputError: another extension or version, a format without quadratic elements, a mesh without elements, or a
            place that cannot be written to.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise OutputError(f"{path}: unknown format {path.suffix or '(none)'}: use one of {', '.join(FORMATS)}")
    if version not in MSH_VERSIONS:
        raise OutputError(f"{path}: unknown Gmsh version {version}: use one of {', '.join(MSH_VERSIONS)}")
    format = FORMATS[suffix]
    if quadratic and not format.quadratic:
        raise OutputError(f"{path}: {suffix} has no quadratic elements: write linear ones, or another format")
    if not len(mesh.quads):
        raise OutputError(f"{path}: {mesh.name} has no elements: there is nothing to write")
    from freemesh_ray.export.finite_elements import finite_elements  # the command's help needs no kernels

    writer = import_module(f"freemesh_ray.export.{format.module}").write
    versioned = {"version": version} if format.versions else {}
    with replacing(path) as draft:
        writer(finite_elements(mesh, quadratic), draft, **versioned)
