"""Generalisation: four domains from simple to complex, the types of action that mesh them, and their fronts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from envs.mesh import Mesh
from envs.types import Domain, Ints
from freemesh_ray.compare.our_mesher import MeshDomain
from freemesh_ray.formatting.table import markdown
from freemesh_ray.mesher import MeshingError
from freemesh_ray.paper_tables.front_shape import SHARES, front_shape
from freemesh_ray.paper_tables.published import published

#: The paper's domains.
DOMAINS = ("D4", "D5", "D6", "D7")


def generalisation(domains: Sequence[Domain], make: MeshDomain) -> str:
    """The tables: completion and actions by type, beside the paper's figures; the fronts' shapes."""
    paper = published("generalisation")
    lines, fronts, total, completed = [], [], np.zeros(3, dtype=np.int64), 0
    for i, domain in enumerate(domains):
        expected = paper["actions"][i] if i < len(paper["actions"]) else None
        beside = "-" if expected is None else f"{expected} actions"
        try:
            raw = make(domain).raw
        except MeshingError:
            lines.append([domain.name, "no", *["-"] * 5, beside])
            continue
        counts = action_types(raw, domain)
        shapes = [front_shape(raw, share) for share in SHARES]
        fronts.append([domain.name, *(f"{shape.roundness:.2f}, {shape.convexity:.2f}" for shape in shapes)])
        total += counts
        completed += 1
        lines.append([domain.name, "yes", *cells(counts), beside])
    lines.append(["all", f"{completed}/{len(domains)}", *cells(total), f"type 1 about {paper['share_of_type_1']:.0%}"])
    header = ["generalisation", "completed", "type 0", "type 1", "type 2", "actions", "type 1 share", "paper"]
    return (
        f"{markdown(header, lines)}\n\nAn action of type 0 adds no vertex, one of type 1 one, one of type 2 two. "
        f"Paper: {paper['source']}.\n\n"
        f"{markdown(['front when cut', *(f'{share:.0%}' for share in SHARES)], fronts)}\n\n"
        "Roundness, 4 pi area / perimeter^2, and convexity, area / that of the convex hull, of what is left when this "
        "share of the elements is cut: both are 1 for a disc. Paper: fronts gradually become an oval.\n"
    )


def action_types(mesh: Mesh, domain: Domain) -> Ints:
    """(3,) int64: the actions of type 0, 1 and 2 that cut a complete mesh, which add as many vertices.

    The last element is what the last action left, and no action of its own.
    """
    vertices, first = np.unique(mesh.quads, return_index=True)
    added = first[vertices >= len(domain.points)] // 4  # the element that brought each new vertex
    return np.bincount(np.bincount(added, minlength=len(mesh.quads))[:-1], minlength=3)


def cells(counts: Ints) -> list[str]:
    """Counts by type, their sum and the share of type 1."""
    actions = int(counts.sum())
    return [*map(str, counts.tolist()), str(actions), f"{counts[1] / actions:.0%}" if actions else "-"]
