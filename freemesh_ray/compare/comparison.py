"""Every mesher on every domain, one row after another."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from envs.types import Domain, DomainError, Floats
from freemesh_ray import plots
from freemesh_ray.compare import output
from freemesh_ray.compare.boundary_change import boundary_change
from freemesh_ray.compare.joint_values import pooled
from freemesh_ray.compare.matching import CANNOT_VARY, NOTHING_TO_MATCH, Match, match
from freemesh_ray.compare.mixed_mesh import MixedMesh, PeerError
from freemesh_ray.compare.named_meshers import Mesher
from freemesh_ray.compare.row import Row, figures
from freemesh_ray.mesher import MeshingError

#: Up to so many domains are named in the title of the box plots.
NAMED = 6


@dataclass(frozen=True)
class Compared:
    """What came of a domain.

    Attributes:
        domain: the domain.
        rows: one for each mesh, or failure.
        meshes: those that were made.
    """

    domain: Domain
    rows: list[Row]
    meshes: list[MixedMesh]

    @property
    def panels(self) -> dict[str, MixedMesh | None]:
        """What the domain's picture shows: label -> mesh, None where there is none."""
        made = {mesh.mesher: mesh for mesh in self.meshes}
        return {panel_label(row): made.get(row.mesher) for row in self.rows}


def compare(
    domains: Sequence[Domain],
    meshers: Sequence[Mesher],
    folder: Path | None,
    report_row: Callable[[Row], None],
    *,
    drawn: bool = True,
    absent: Mapping[str, str] = MappingProxyType({}),
    matched: bool = False,
) -> list[Compared]:
    """Run all meshers on all domains; an interrupt leaves the tables and pictures of what is finished.

    Args:
        domains: what to mesh.
        meshers: in the order of the columns.
        folder: where ``comparison.md``, ``.csv``, ``.json``, a picture for each domain and ``boxes.png`` are written;
            None: nowhere.
        report_row: called with each row as it is finished.
        drawn: whether there are pictures.
        matched: whether the others' numbers of elements are matched to those of the first's last mesh of a domain.
        absent: peers that take no part -> why; the tables tell it.

    Raises:
        DomainError: two domains have one name.
        OutputError: the folder cannot be written to.
    """
    check_names(domains)
    done: list[Compared] = []
    try:
        for domain in domains:
            compared = Compared(domain, [], [])
            done.append(compared)
            for mesher in meshers:
                wanted = elements_of(meshers[0].name, compared) if matched and mesher is not meshers[0] else None
                for row, mesh in rows(mesher, domain, wanted):
                    compared.rows.append(row)
                    if mesh is not None:
                        compared.meshes.append(mesh)
                    report_row(row)
            if folder is not None:
                output.write(folder, [row for entry in done for row in entry.rows], absent)
            if folder is not None and drawn and compared.meshes:
                plots.draw_side_by_side(compared.panels, folder / f"{file_name(domain.name)}.png", domain.name)
    finally:
        if folder is not None and any(entry.rows for entry in done):
            output.write(folder, [row for entry in done for row in entry.rows], absent)
            if drawn and any(entry.meshes for entry in done):
                plots.draw_boxes(box_values(done), folder / "boxes.png", title=title([entry.domain for entry in done]))
    return done


def box_values(done: Sequence[Compared]) -> dict[str, dict[str, Floats]]:
    """Metric -> mesher -> values over all domains, (k,).

    A mesher that failed on some domains is called ``name (2/3)``: its values are of other domains than the others'.
    """
    names = output.distinct(row.mesher for entry in done for row in entry.rows)
    meshes = [mesh for entry in done for mesh in entry.meshes]
    made = Counter(mesh.mesher for mesh in meshes)
    labels = [name if made[name] == len(done) else f"{name} ({made[name]}/{len(done)})" for name in names]
    values = pooled(plots.PANELS, names, meshes)
    return {metric: dict(zip(labels, of_mesher.values(), strict=True)) for metric, of_mesher in values.items()}


def title(domains: Sequence[Domain]) -> str:
    """What the box plots are of."""
    return ", ".join(domain.name for domain in domains) if len(domains) <= NAMED else f"{len(domains)} domains"


def panel_label(row: Row) -> str:
    """The mesher, and what it did to the boundary where it did not keep it."""
    if row.boundary is None or row.boundary.kept:
        return row.mesher
    return f"{row.mesher} (boundary {f'+{row.boundary.added} points' if row.boundary.split else 'changed'})"


def rows(mesher: Mesher, domain: Domain, wanted: int | None = None) -> list[tuple[Row, MixedMesh | None]]:
    """A mesher's rows for a domain, with their meshes; a failure is a row without.

    Args:
        mesher: it.
        domain: it.
        wanted: elements to match; 0 where there is nothing to match, None where nothing is to be matched.
    """
    remark = ""
    try:
        if wanted and mesher.resized:
            return [matched_row(match(mesher.resized, domain, wanted), domain)]
        if wanted is not None:
            remark = f"not matched: {CANNOT_VARY if wanted else NOTHING_TO_MATCH}"
        return [
            (Row(domain.name, mesh.mesher, figures(mesh, domain), boundary_change(mesh, domain), "", remark), mesh)
            for mesh in mesher.run(domain)
        ]
    except (PeerError, MeshingError) as error:
        return [(Row(domain.name, mesher.name, None, None, str(error).replace("\n", " ")), None)]


def matched_row(found: Match, domain: Domain) -> tuple[Row, MixedMesh]:
    """The row of a mesh whose number of elements was matched, or was to be, with the mesh."""
    mesh = found.mesh
    values = figures(mesh, domain) | {"size_factor": found.factor, "matched_share": found.share}
    remark = "" if found.reached else str(found)
    return Row(domain.name, mesh.mesher, values, boundary_change(mesh, domain), "", remark), mesh


def elements_of(mesher: str, compared: Compared) -> int:
    """Elements of a mesher's mesh of a domain; 0 where it has none."""
    return next((len(mesh) for mesh in compared.meshes if mesh.mesher == mesher), 0)


def file_name(name: str) -> str:
    """A domain's name as a file's."""
    return re.sub(r"[^\w.-]+", "-", name).strip("-")


def check_names(domains: Sequence[Domain]) -> None:
    """Refuse two domains of one name, which tables and files could not tell apart."""
    names = [file_name(domain.name) for domain in domains]
    for name in names:
        if names.count(name) > 1:
            raise DomainError(f"{name}: two domains of this name; leave one out, or rename its file")
