"""Our meshes by how much follows the policy: it alone, what completes its mesh, plain smoothing, the finish."""

from __future__ import annotations

import time
from collections.abc import Sequence

from envs.types import Domain
from freemesh_ray.compare.laplacian import smoothed
from freemesh_ray.compare.mixed_mesh import MixedMesh, PeerError, of_mesh
from freemesh_ray.compare.named_meshers import OURS, RAW, Mesher
from freemesh_ray.compare.our_mesher import MeshDomain
from freemesh_ray.policies.evaluation import run_episodes
from freemesh_ray.policies.policy import Policy

#: The policy's mean action, drawn only after a rejected one; the raw mesh after plain Laplacian smoothing.
ALONE, SMOOTHED = "policy alone", "smoothed"


def stages(policy: Policy, make: MeshDomain) -> list[Mesher]:
    """The four of them, as columns of a comparison.

    Args:
        policy: it.
        make: our mesher with it.
    """

    def alone(domain: Domain) -> list[MixedMesh]:
        began = time.perf_counter()
        (episode,) = run_episodes(policy, domain, 1, stochastic=False, seed=0)
        seconds = time.perf_counter() - began
        if not episode.completed:
            raise PeerError(f"the policy alone stopped after {len(episode.mesh.quads)} elements")
        return [of_mesh(episode.mesh, ALONE, seconds)]

    def followed(domain: Domain) -> Sequence[MixedMesh]:
        made = make(domain)
        began = time.perf_counter()
        plain = smoothed(made.raw)
        seconds = made.seconds_raw + time.perf_counter() - began
        return [
            of_mesh(made.raw, RAW, made.seconds_raw),
            of_mesh(plain, SMOOTHED, seconds),
            of_mesh(made.finished, OURS, made.seconds_finished),
        ]

    return [Mesher(ALONE, alone), Mesher(OURS, followed)]
