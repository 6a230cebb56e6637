"""The formats that meshes are written in: one entry a format, one file a writer, imported when it writes.

A new format is an entry here and a file beside it with ``write(mesh: FiniteElements, path: Path) -> None``, which takes
``version`` or ``element_type``, too, where the entry has any. A row of the table in docs/formats.md follows from it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from freemesh_ray.export.abaqus_elements import NODES
from freemesh_ray.export.names import NameRule

#: Names that stand in a file by themselves, between blanks.
WORDS = NameRule(64)
#: Names on a line of their own.
LINES = NameRule(56, allowed=" -~")
#: Names of any letters, in quotes or in XML; blanks inside, too.
TEXTS = NameRule(120, allowed=r"\w .,:;+\-()\[\]/=@#%*~^|!?$")


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes:
        name: of the programs that read it.
        module: its writer's file in this package.
        media_type: what HTTP calls it.
        nodes: how many a quadrilateral that it holds may have.
        hexes: how many a hexahedron may have.
        sides: how it keeps the named parts of the boundary; empty: not at all.
        regions: how it keeps those of the domain.
        lines: how it keeps the named lines, in space surfaces, inside.
        points: how it keeps named points.
        rule: the names that it can hold.
        versions: those that can be chosen, the default first.
        element_types: those that can be chosen.
        folder: where, beside the file, what else belongs to it is written; empty: it is one file.
    """

    name: str
    module: str
    media_type: str
    nodes: tuple[int, ...] = (4, 8)
    hexes: tuple[int, ...] = (8, 20)
    sides: str = ""
    regions: str = ""
    lines: str = ""
    points: str = ""
    rule: NameRule = WORDS
    versions: tuple[str, ...] = ()
    element_types: tuple[str, ...] = ()
    folder: str = ""


TEXT = "text/plain; charset=us-ascii"
EXODUS = Format(
    "Exodus II", "exodus", "application/x-netcdf", nodes=(4, 8, 9),
    sides="side sets", regions="element blocks", lines="side sets", points="node sets", rule=NameRule(32),
)  # fmt: skip
#: An OpenFOAM mesh, in a folder or in an archive.
OPENFOAM = Format(
    "OpenFOAM, a folder", "openfoam", TEXT, nodes=(4,), hexes=(8,), folder="constant/polyMesh",
    sides="patches", regions="cell zones", lines="face zones", points="point zones",
    rule=NameRule(64, allowed="A-Za-z0-9_.-", letter_first=True, reserved=frozenset({"frontAndBack", "unfinished"})),
)  # fmt: skip

#: Every format by its suffix, in the order in which they are listed.
FORMATS: dict[str, Format] = {
    ".vtu": Format(
        "VTK, ParaView", "vtk", "application/xml", nodes=(4, 8, 9, 16, 25),
        sides="cells", regions="cells", lines="cells", points="cells", rule=TEXTS,
    ),
    ".msh": Format(
        "Gmsh", "gmsh", "model/mesh", nodes=(4, 8, 9, 16, 25), versions=("4.1", "2.2"),
        sides="physical curves", regions="physical surfaces", lines="physical curves", points="physical points",
        rule=TEXTS,
    ),
    ".inp": Format(
        "Abaqus, CalculiX", "abaqus", TEXT, element_types=tuple(NODES),
        sides="NSET, ELSET, SURFACE", regions="NSET, ELSET", lines="NSET, ELSET, SURFACE", points="NSET",
        rule=NameRule(76, allowed="A-Za-z0-9_", letter_first=True, capitals=True, reserved=frozenset({"ALL"})),
    ),
    ".bdf": Format(
        "Nastran", "nastran", TEXT,
        sides="SET1, SPC1", regions="PSHELL, MAT1", lines="SET1, SPC1", points="SET1, SPC1", rule=LINES,
    ),
    ".k": Format(
        "LS-DYNA", "ls_dyna", TEXT, hexes=(8,),
        sides="SET_NODE", regions="PART", lines="SET_NODE", points="SET_NODE", rule=LINES,
    ),
    ".unv": Format(
        "I-deas", "ideas", TEXT,
        sides="groups of elements", regions="groups of elements", lines="groups of elements", points="groups of nodes",
        rule=NameRule(24),
    ),
    ".su2": Format("SU2", "su2", TEXT, nodes=(4,), hexes=(8,), sides="markers"),
    ".foam": OPENFOAM,
    ".zip": replace(OPENFOAM, name="OpenFOAM, an archive", media_type="application/zip", folder=""),
    ".e": EXODUS,
    ".exo": EXODUS,
    ".xdmf": Format(
        "XDMF, DOLFINx", "xdmf", "application/xml", nodes=(4, 8, 9),
        sides="numbers", regions="numbers", lines="numbers", rule=TEXTS,
    ),
    ".mesh": Format(
        "MFEM", "mfem", TEXT, nodes=(4, 9, 16, 25), hexes=(8,),
        sides="boundary attributes", regions="attributes", rule=NameRule(64),
    ),
    ".ism": Format(
        "HOHQMesh's ISM-v2", "hohqmesh", TEXT, nodes=(4, 9, 16, 25), hexes=(),
        sides="names of sides", rule=NameRule(32),
    ),
    ".obj": Format("Wavefront", "wavefront", "model/obj", nodes=(4,), hexes=()),
}  # fmt: skip

SUFFIXES = tuple(FORMATS)
#: Of Gmsh's files.
MSH_VERSIONS = FORMATS[".msh"].versions
#: Of Abaqus' and CalculiX'.
ELEMENT_TYPES = FORMATS[".inp"].element_types

#: What `kept` tells of a format, in this order.
COLUMNS = (
    "suffix",
    "read by",
    "quadrilaterals of",
    "hexahedra of",
    "sides",
    "regions",
    "lines inside",
    "points",
    "names",
)


def kept(suffix: str) -> tuple[str, ...]:
    """What a format keeps, in words, one for each of `COLUMNS`; empty where it keeps nothing."""
    form = FORMATS[suffix]
    counts = (f"{', '.join(map(str, some))} nodes" if some else "" for some in (form.nodes, form.hexes))
    names = "" if not form.sides else f"{form.rule.most} characters" + (", capitals" if form.rule.capitals else "")
    return (suffix, form.name, *counts, form.sides, form.regions, form.lines, form.points, names)
