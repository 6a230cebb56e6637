"""Meshes as files for other programs; docs/formats.md has what each keeps.

Vertices keep their order, elements their order and their counter-clockwise corners. Every bit of the coordinates is
kept but in fields of sixteen characters (see :mod:`freemesh_ray.export.fixed_width`).
"""

from __future__ import annotations

from contextlib import ExitStack
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from freemesh_ray.export.formats import ELEMENT_TYPES, FORMATS, MSH_VERSIONS, SUFFIXES
from freemesh_ray.storage.atomic import OutputError, check_writable, replacing

if TYPE_CHECKING:
    from envs.mesh import Mesh
    from freemesh_ray.export.finite_elements import FiniteElements
    from freemesh_ray.export.names import Change
    from freemesh_ray.export.solid import SolidMesh

__all__ = ["ELEMENT_TYPES", "FORMATS", "MSH_VERSIONS", "SUFFIXES", "write"]

#: Names that a note has at most.
MOST_NAMED = 5


def write(
    mesh: Mesh | SolidMesh,
    path: str | Path,
    version: str = MSH_VERSIONS[0],
    quadratic: bool = False,
    *,
    order: int | None = None,
    element_type: str | None = None,
) -> tuple[str, ...]:
    """Write a mesh in the format that the extension names; the file is there as a whole or not at all.

    Args:
        mesh: a plane mesh, or one of hexahedra, such as one that was swept. Vertices of a plane one get z = 0. Its
            named parts are kept as far as the format can, see `formats.Format`.
        path: ending in one of `SUFFIXES`, in a folder that is there.
        version: of the Gmsh format, one of `MSH_VERSIONS`.
        quadratic: quadrilaterals of order 2, of eight nodes where the format has such.
        order: of quadrilaterals, 1 to 4: of (order + 1)^2 nodes; of 8 at order 2 where the format has no others.
        element_type: of ``.inp``, one of `ELEMENT_TYPES`; it says the order, too.

    Returns:
        What was changed or left out, for the user, a line each: names that the format cannot hold, and parts.

    Raises:
        OutputError: another extension or version, elements that the format does not hold, a mesh without elements, a
            folder that is missing, or a place that cannot be written to.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise OutputError(f"{path}: unknown format {path.suffix or '(none)'}: use one of {', '.join(FORMATS)}")
    if version not in MSH_VERSIONS:
        raise OutputError(f"{path}: unknown Gmsh version {version}: use one of {', '.join(MSH_VERSIONS)}")
    check_writable(path)
    format = FORMATS[suffix]
    from freemesh_ray.export.names import renamed  # the command's help needs none of this

    held, changes = renamed(_elements(mesh, path, order, quadratic, element_type), format.rule)
    options: dict[str, Any] = {}
    if format.versions:
        options["version"] = version
    if format.element_types:
        options["element_type"] = element_type
    writer = import_module(f"freemesh_ray.export.{format.module}")
    if format.folder:
        with ExitStack() as stack:
            for name, text in writer.files(held, path.name).items():
                draft = stack.enter_context(replacing(path.parent / name))
                draft.write_bytes(text)
    else:
        with replacing(path) as draft:
            writer.write(held, draft, **options)
    return (*_changes(path, changes), *_losses(path, mesh))


def _elements(
    mesh: Mesh | SolidMesh, path: Path, order: int | None, quadratic: bool, element_type: str | None
) -> FiniteElements:
    from envs.mesh import Mesh
    from freemesh_ray.export import choice

    if not len(mesh.quads if isinstance(mesh, Mesh) else mesh.hexes):
        raise OutputError(f"{path}: {mesh.name} has no elements: there is nothing to write")
    if isinstance(mesh, Mesh):
        from freemesh_ray.export.plane import plane_elements

        nodes = choice.nodes_of_quadrilaterals(path, order, quadratic, element_type)
        choice.check_axis(path, mesh.vertices, element_type)
        return plane_elements(mesh, nodes)
    from freemesh_ray.export.solid import solid_elements

    choice.check_hexahedra(path, mesh.hexes.shape[1], order, quadratic, element_type)
    return solid_elements(mesh)


def _changes(path: Path, changes: list[Change]) -> list[str]:
    changes = [change for change in changes if getattr(FORMATS[path.suffix.lower()], change.kind)]
    if not changes:
        return []
    pairs = [f"{change.old!a} is {change.new}" for change in changes]
    return [f"{path}: names that {path.suffix.lower()} cannot hold: {_some(pairs)}"]


def _losses(path: Path, mesh: Mesh | SolidMesh) -> list[str]:
    """A line on the kinds of parts that names were given for and that the format does not keep."""
    from envs.mesh import Mesh

    format, suffix = FORMATS[path.suffix.lower()], path.suffix.lower()
    if isinstance(mesh, Mesh):
        own = mesh.groups
        given = {"sides": own.sides, "regions": own.regions, "lines": own.lines, "points": own.points}
    else:
        swept = mesh.groups
        given = {"sides": swept.faces, "regions": swept.regions, "lines": swept.interfaces, "points": swept.edges}
    lost = {kind: list(names) for kind, names in given.items() if len(names) and not getattr(format, kind)}
    if not lost:
        return []
    names = [name for some in lost.values() for name in some]
    return [f"{path}: {suffix} keeps no {' and no '.join(lost)}: left out {_some(names)}"]


def _some(words: list[str]) -> str:
    more = len(words) - MOST_NAMED
    return ", ".join(words[:MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
