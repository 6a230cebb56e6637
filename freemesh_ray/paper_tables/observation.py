"""Observation ranges: quality, elements and time of policies trained with O1, O2 and O3."""

from __future__ import annotations

from collections.abc import Mapping

from envs.types import Domain
from freemesh_ray.formatting.markdown import escaped
from freemesh_ray.formatting.table import markdown
from freemesh_ray.paper_tables.published import published, spread, spread_of
from freemesh_ray.paper_tables.repeated import repeat
from freemesh_ray.policies.policy import Policy

#: Quantity -> column, decimals.
COLUMNS = {"eta": ("element quality", ".3f"), "elements": ("elements", ".1f"), "seconds": ("time (s)", ".3f")}


def observation(policies: Mapping[str, Policy], domain: Domain, episodes: int) -> str:
    """The table: a line for each policy, by the label that it is given; those of the paper's names beside its figures.

    Args:
        policies: label -> policy.
        domain: what all of them mesh.
        episodes: repetitions.
    """
    paper = published("observation")
    lines = []
    for label, policy in policies.items():
        found = repeat(policy, domain, episodes)
        p = policy.parameters
        cells = [label, f"{p.beta:g}_{p.n}_{p.g}", f"{len(found.elements)}/{episodes}"]
        for key, (_, form) in COLUMNS.items():
            cells.append(spread_of(getattr(found, key), form))
            cells.append(spread(paper[label][key], form) if label in paper else "-")
        lines.append(cells)
    header = ["observation", "range", "completed"]
    for title, _ in COLUMNS.values():
        header += [title, "paper"]
    name = escaped(domain.name)
    return (
        f"{markdown(header, lines)}\n\nMeasured on {name}, {episodes} episodes of drawn actions, completed "
        f"meshes only. Paper: {paper['source']}.\n"
    )
