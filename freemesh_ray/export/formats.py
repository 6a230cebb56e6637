"""The formats that meshes are written in: one entry a format, one file a writer, imported when it writes.

A new format is an entry here and a file beside it with ``write(mesh: FiniteElements, path: Path) -> None``, which takes
``version``, too, where the entry has versions.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes:
        name: of the programs that read it.
        module: its writer's file in this package.
        media_type: what HTTP calls it.
        quadratic: whether it holds elements of eight nodes.
        versions: those that can be chosen, the default first.
    """

    name: str
    module: str
    media_type: str
    quadratic: bool = True
    versions: tuple[str, ...] = ()


#: Every format by its suffix, in the order in which they are listed.
FORMATS: dict[str, Format] = {
    ".vtu": Format("VTK, ParaView", "vtk", "application/xml"),
    ".msh": Format("Gmsh", "gmsh", "model/mesh", versions=("4.1", "2.2")),
    ".inp": Format("Abaqus, CalculiX", "abaqus", "text/plain; charset=us-ascii"),
    ".bdf": Format("Nastran", "nastran", "text/plain; charset=us-ascii"),
    ".obj": Format("Wavefront", "wavefront", "model/obj", quadratic=False),
}

SUFFIXES = tuple(FORMATS)
#: Of Gmsh's files.
MSH_VERSIONS = FORMATS[".msh"].versions
