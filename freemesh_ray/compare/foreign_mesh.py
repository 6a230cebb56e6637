"""Meshes that another program wrote, as columns of the comparison: ``LABEL=FILE`` or ``DOMAIN:LABEL=FILE``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from envs.errors import UserError
from envs.polygons.rings import LARGEST_COORDINATE
from envs.types import Domain, Floats, Ints
from freemesh_ray.compare.abaqus_file import read_abaqus
from freemesh_ray.compare.meshio_file import read_meshio
from freemesh_ray.compare.mixed_mesh import MixedMesh, PeerError, assembled
from freemesh_ray.compare.named_meshers import Mesher

#: meshio's names for elements that are compared, and how many corners they have; nodes beyond those are left out.
QUADS = ("quad", "quad8", "quad9")
TRIANGLES = ("triangle", "triangle6", "triangle7")

#: What is read: formats that stand in one file and name no other.
SUFFIXES = (".inp", ".msh", ".vtu", ".vtk", ".bdf", ".fem", ".nas", ".mesh", ".obj", ".off", ".ply", ".stl", ".su2")

#: Bytes of a mesh file at most.
MOST_BYTES = 200_000_000

#: Bounding boxes are the same within this share of the diameter.
BOX_TOLERANCE = 1e-3


class MeshFileError(UserError, ValueError):
    """A mesh file that cannot be used; one line with its name and the fix."""


@dataclass(frozen=True)
class Given:
    """A mesh file and where it belongs.

    Attributes:
        domain: name of its domain.
        mesh: what it holds, under its label.
    """

    domain: str
    mesh: MixedMesh


def files(texts: Sequence[str], domains: Sequence[Domain]) -> list[Mesher]:
    """One mesher for each label in ``[DOMAIN:]LABEL=FILE``; it gives what the files hold.

    Raises:
        MeshFileError: a text of another form, a file that is no mesh, or one that belongs to no domain.
    """
    given = [placed(text, domains) for text in texts]
    table: dict[str, dict[str, MixedMesh]] = {}
    for entry in given:
        of_label = table.setdefault(entry.mesh.mesher, {})
        if entry.domain in of_label:
            raise MeshFileError(f"{entry.mesh.mesher}: two files for {entry.domain}; give one, or another label")
        of_label[entry.domain] = entry.mesh

    def mesher(label: str, meshes: dict[str, MixedMesh]) -> Mesher:
        def run(domain: Domain) -> list[MixedMesh]:
            if domain.name not in meshes:
                raise PeerError(f"no file given for {domain.name}")
            return [meshes[domain.name]]

        return Mesher(label, run)

    return [mesher(label, meshes) for label, meshes in table.items()]


def placed(text: str, domains: Sequence[Domain]) -> Given:
    """The mesh in ``[DOMAIN:]LABEL=FILE``, and the domain that it is of."""
    names = [domain.name for domain in domains]
    name = next((name for name in names if text.startswith(f"{name}:")), "")
    head, equals, path = text.removeprefix(f"{name}:").partition("=")
    unknown, _, label = head.rpartition(":")
    if not (equals and label and path):
        raise MeshFileError(f"--mesh {text!r}: write LABEL=FILE or DOMAIN:LABEL=FILE")
    if unknown:
        raise MeshFileError(f"--mesh {text!r}: {unknown} is not among the domains compared, {', '.join(names)}")
    mesh = replace(read(Path(path)), mesher=label)
    if name:
        return Given(name, mesh)
    matching = [d for d in domains if mesh.keeps(d)] or [d for d in domains if same_box(mesh, d)]
    if len(matching) != 1:
        which = f"fits {', '.join(d.name for d in matching)} alike" if matching else "has the extent of no domain here"
        raise MeshFileError(f"{path}: {which}; write DOMAIN:{label}={path}")
    return Given(matching[0].name, mesh)


def same_box(mesh: MixedMesh, domain: Domain) -> bool:
    """Whether mesh and domain have one bounding box."""
    first, second = (np.stack([p.min(axis=0), p.max(axis=0)]) for p in (mesh.vertices, domain.points))
    return bool(np.abs(first - second).max() <= BOX_TOLERANCE * domain.diameter)


def read(path: Path) -> MixedMesh:
    """The quadrilaterals and triangles in a file of one of `SUFFIXES`; its plane is z = constant.

    Raises:
        MeshFileError: no such file, not a mesh, no elements of these kinds, or not in one plane.
    """
    if not path.is_file():
        raise MeshFileError(f"{path}: no such mesh file; check the path")
    if path.suffix.lower() not in SUFFIXES:
        raise MeshFileError(f"{path}: unknown format {path.suffix!r}; use one of {', '.join(SUFFIXES)}")
    if path.stat().st_size > MOST_BYTES:
        raise MeshFileError(f"{path}: more than {MOST_BYTES / 1e6:.0f} MB; export the surface mesh alone")
    points, quads, triangles = parts(path)
    corners = np.concatenate([quads.ravel(), triangles.ravel()])
    if points.ndim != 2 or points.shape[1] < 2 or not (np.abs(points) <= LARGEST_COORDINATE).all():
        raise MeshFileError(f"{path}: its points are not all places in the plane or in space; export it again")
    if len(corners) and not 0 <= corners.min() <= corners.max() < len(points):
        raise MeshFileError(f"{path}: an element of a node that is not there; export it again")
    size = np.ptp(points, axis=0) if len(points) else np.zeros(2)
    if len(size) > 2 and size[2] > 1e-6 * np.linalg.norm(size):
        raise MeshFileError(f"{path}: not in one plane z = constant; turn it into the plane first")
    try:
        return assembled(path.stem, points[:, :2], quads, triangles, float("nan"))
    except PeerError:
        raise MeshFileError(f"{path}: holds no quadrilaterals or triangles; export the surface mesh") from None


def parts(path: Path) -> tuple[Floats, Ints, Ints]:
    """A file's points (n, 2 or 3), quadrilaterals (m, 4) and triangles (t, 3).

    Raises:
        MeshFileError: not a mesh.
    """
    try:
        if path.suffix.lower() == ".inp":
            return read_abaqus(path)
        points, cells = read_meshio(path)
    except (ValueError, OSError) as error:
        reason = " ".join(ascii(str(error))[1:-1].split())[:100]
        raise MeshFileError(f"{path}: cannot be read ({reason}); write .inp, .msh or .vtu") from error
    quads = [np.empty((0, 4)), *(nodes[:, :4] for kind, nodes in cells if kind in QUADS)]
    triangles = [np.empty((0, 3)), *(nodes[:, :3] for kind, nodes in cells if kind in TRIANGLES)]
    return points, np.concatenate(quads).astype(np.int64), np.concatenate(triangles).astype(np.int64)
