"""Elements a second of the mesher."""

from __future__ import annotations

import numpy as np

from envs.domains.load import from_rings
from envs.domains.random_domain import circle
from envs.types import Domain
from freemesh_ray.bench.env_steps import cross
from freemesh_ray.formatting.table import table
from freemesh_ray.formatting.terminal import say
from freemesh_ray.mesher import mesh_domain
from freemesh_ray.policies.policy import Policy

#: Vertices of the discs and crosses that the mesher is timed on.
DISCS, CROSSES = (50, 100, 250, 500, 1000, 2000), (250, 500, 1000, 2000)


def disc(n: int) -> Domain:
    """A regular polygon of n vertices: a boundary without corners."""
    return from_rings(circle(n), name=f"disc{n}")


def run(policy: Policy) -> None:
    """Elements a second of the mesher against the size of the mesh, raw and finished; the fastest of three."""
    rows, sizes, times = [], [], []
    for domain in [*map(disc, DISCS), *map(cross, CROSSES)]:
        # The first time compiles and touches the memory.
        made = min((mesh_domain(policy, domain) for _ in range(4)), key=lambda one: one.seconds_finished)
        raw, finished = len(made.raw.quads), len(made.finished.quads)
        sizes.append(raw)
        times.append(made.seconds_finished)
        rows.append(
            [
                domain.name, f"{finished:,}", f"{raw / made.seconds_raw:,.0f}",
                f"{finished / made.seconds_finished:,.0f}", str(made.attempts),
                f"{made.backtracks:,}", f"{made.filled:,}",
            ]
        )  # fmt: skip
    growth = np.polyfit(np.log(sizes), np.log(times), 1)[0]
    say(f"mesher, one core (time grows as elements^{growth:.2f})")
    say(table(["domain", "elements", "raw, elements/s", "finished", "attempts", "backtracks", "filled"], rows))
