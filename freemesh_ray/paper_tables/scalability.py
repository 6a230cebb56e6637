"""Scalability: one shape with three densities of boundary vertices, one policy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from envs.mesh import Mesh
from envs.types import Domain
from freemesh_ray.compare.our_mesher import MeshDomain
from freemesh_ray.formatting.table import markdown
from freemesh_ray.mesher import MeshingError
from freemesh_ray.paper_tables.published import published

#: The paper's domains.
DOMAINS = ("D1", "D2", "D3")

#: Quantity -> line, format.
LINES = {
    "vertices": ("vertices", ".0f"),
    "perimeter": ("perimeter", ".1f"),
    "density": ("vertices per unit length", ".1f"),
    "elements": ("elements", ".0f"),
    "seconds": ("time (s)", ".2f"),
    "rate": ("elements/s", ",.0f"),
    "coarsening": ("interior elements' area over boundary elements'", ".2f"),
}


def scalability(domains: Sequence[Domain], make: MeshDomain) -> str:
    """The table: each domain beside the paper's one of the same place."""
    paper = published("scalability")
    header, columns = ["scalability"], []
    for i, domain in enumerate(domains):
        header.append(domain.name)
        columns.append(measured(domain, make))
        if i < len(paper["columns"]):
            header.append(f"paper, {paper['columns'][i]}")
            columns.append(printed(i))
    lines = [
        [title, *(format(column[key], form) if key in column else "-" for column in columns)]
        for key, (title, form) in LINES.items()
    ]
    return (
        f"{markdown(header, lines)}\n\nAreas are means, of the elements that have a vertex on the boundary and of the "
        "others: above 1 the boundary is denser than the interior, as the paper says of its meshes. "
        f"Paper: {paper['source']}; elements/s is its elements over its time.\n"
    )


def measured(domain: Domain, make: MeshDomain) -> dict[str, float]:
    """The quantities of a domain and its mesh as cut; those of the mesh are missing when there is none."""
    ends = domain.points[domain.segments]
    perimeter = float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum())
    vertices = float(len(domain.segments))
    found = {"vertices": vertices, "perimeter": perimeter, "density": vertices / perimeter}
    try:
        made = make(domain)
    except MeshingError:
        return found
    elements = float(len(made.raw.quads))
    found |= {"elements": elements, "seconds": made.seconds_raw, "rate": elements / made.seconds_raw}
    return found | coarsening(made.raw)


def coarsening(mesh: Mesh) -> dict[str, float]:
    """The mean area of the interior elements over that of those at the boundary; nothing where all are there."""
    outer = mesh.on_boundary[mesh.quads].any(axis=1)
    return {} if outer.all() else {"coarsening": float(mesh.areas[~outer].mean() / mesh.areas[outer].mean())}


def printed(i: int) -> dict[str, float]:
    """The paper's column ``i``."""
    paper = published("scalability")
    found = {key: float(paper[key][i]) for key in LINES if key in paper}
    return found | {"rate": found["elements"] / found["seconds"]}
