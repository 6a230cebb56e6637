"""Mesh density: elements of policies trained with a dense, a medium and a sparse density weight."""

from __future__ import annotations

from collections.abc import Mapping

from envs.types import Domain
from freemesh_ray.formatting.markdown import escaped
from freemesh_ray.formatting.table import markdown
from freemesh_ray.paper_tables.published import published, spread_of
from freemesh_ray.paper_tables.repeated import repeat
from freemesh_ray.policies.policy import Policy


def density(policies: Mapping[str, Policy], domain: Domain, episodes: int) -> str:
    """The tables: elements of each policy, and their differences where two have the paper's names beside its own.

    Args:
        policies: label -> policy.
        domain: what all of them mesh.
        episodes: repetitions.
    """
    paper = published("density")
    means: dict[str, float] = {}
    lines = []
    for label, policy in policies.items():
        elements = repeat(policy, domain, episodes).elements
        if len(elements):
            means[label] = float(elements.mean())
        expected = paper["upsilon"].get(label)
        lines.append([label, f"{policy.parameters.upsilon:g}", "-" if expected is None else f"{expected:g}",
                      f"{len(elements)}/{episodes}", spread_of(elements, ".1f")])  # fmt: skip
    parts = [markdown(["density", "weight", "paper's weight", "completed", "elements"], lines)]
    differences = []
    for name, printed in paper["differences"].items():
        more, less = name.split(" - ")
        if more in means and less in means:
            differences.append([name, f"{means[more] - means[less]:.1f}", f"{printed}"])
    if differences:
        parts.append(markdown(["elements", "measured", "paper"], differences))
    parts.append(
        f"Measured on {escaped(domain.name)}, {episodes} episodes of drawn actions, completed meshes only. "
        f"Paper: {paper['source']}.\n"
    )
    return "\n\n".join(parts)
