"""Our mesher as the comparison calls it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from envs.domains.load import load
from envs.types import Domain
from freemesh_ray.mesher import Made, make
from freemesh_ray.policies.policy import Policy

#: Domain in, mesh out; raises MeshingError.
Make = Callable[[Domain], Made]


def maker(path: Path) -> Make:
    """The mesher with the policy in a file, its compiled code warmed up.

    Raises:
        PolicyError: no such file, or not a policy.
    """
    policy = Policy.load(path)
    make(policy, load("T1"))
    return lambda domain: make(policy, domain)
