"""``freemesh domains``: the catalogue."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from freemesh_ray.cli.arguments import add_command
from freemesh_ray.formatting.terminal import say

if TYPE_CHECKING:
    from envs.types import Domain


def add(commands: Any) -> None:
    """Add the command to the grammar."""
    add_command(commands, "domains", "list the catalogue", "List the domains that ship with the package.")


def run(options: argparse.Namespace) -> int:
    """Print the catalogue."""
    from envs.domains.load import catalogue, load

    say(domain_table([load(name) for name in catalogue()]))
    return 0


def domain_table(domains: Sequence[Domain]) -> str:
    """The catalogue: vertices, holes, segment lengths and sharpest corner of each domain."""
    import numpy as np

    from freemesh_ray.formatting.table import table

    rows = []
    for domain in domains:
        ends = domain.points[domain.segments]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        rows.append(
            [
                domain.name,
                str(len(domain.segments)),
                f"{lengths.sum():.2f}",
                f"{domain.area:.2f}",
                f"{lengths.max() / lengths.min():.2f}",
                f"{sharpest_corner(domain):.0f}°",
                "with a hole" if len(domain.ring) > len(domain.segments) else "",
            ]
        )
    header = ["domain", "vertices", "perimeter", "area", "longest/shortest", "sharpest", ""]
    return table(header, rows)


def sharpest_corner(domain: Domain) -> float:
    """The least angle inside the domain, degrees."""
    import numpy as np

    ahead = np.roll(domain.vertices, -1, axis=0) - domain.vertices
    behind = np.roll(domain.vertices, 1, axis=0) - domain.vertices
    turn = np.arctan2(ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0], np.sum(ahead * behind, axis=1))
    return float(np.degrees(turn % (2 * np.pi)).min())
