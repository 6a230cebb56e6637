"""Our mesher as the comparison calls it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from envs.domains.load import load
from envs.types import Domain
from freemesh_ray.mesher import MeshResult, mesh_domain
from freemesh_ray.policies.policy import Policy

#: Domain in, mesh out; raises MeshingError.
MeshDomain = Callable[[Domain], MeshResult]


def maker(path: Path) -> MeshDomain:
    """The mesher with the policy in a file, its compiled code warmed up.

    Raises:
        PolicyError: no such file, or not a policy.
    """
    policy = Policy.load(path)
    mesh_domain(policy, load("T1"))
    return lambda domain: mesh_domain(policy, domain)
