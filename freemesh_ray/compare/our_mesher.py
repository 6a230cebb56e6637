"""Our mesher as the comparison calls it."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from envs.domain import load
from envs.mesh import Mesh
from envs.types import Domain
from freemesh_ray import mesher
from freemesh_ray.policy import Policy


@dataclass(frozen=True)
class Made:
    """A mesh, as cut and as handed out.

    Attributes:
        raw: as the policy cut it.
        finished: after what follows the policy; ``raw`` itself when nothing does.
        seconds_raw: wall time up to ``raw``.
        seconds_finished: wall time up to ``finished``, that of ``raw`` included.
    """

    raw: Mesh
    finished: Mesh
    seconds_raw: float
    seconds_finished: float


#: Domain in, mesh out; raises MeshingError.
Make = Callable[[Domain], Made]


def maker(path: Path) -> Make:
    """The mesher with the policy in a file, its compiled code warmed up.

    Raises:
        PolicyError: no such file, or not a policy.
    """
    policy = Policy.load(path)

    def make(domain: Domain) -> Made:
        start = time.perf_counter()
        mesh = mesher.mesh(policy, domain)
        seconds = time.perf_counter() - start
        return Made(raw=mesh, finished=mesh, seconds_raw=seconds, seconds_finished=seconds)

    with suppress(mesher.MeshingError):
        make(load("T1"))
    return make
