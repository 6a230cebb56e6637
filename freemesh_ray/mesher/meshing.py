"""Policy and domain in, mesh out: the deterministic episode first, sampled ones when it does not get through."""

from __future__ import annotations

from envs.mesh import Mesh
from envs.types import Domain
from freemesh_ray.evaluate import Evaluated, run_episodes
from freemesh_ray.policy import Policy


class MeshingError(RuntimeError):
    """The policy did not complete the domain."""


def mesh(policy: Policy, domain: Domain, *, attempts: int = 32, seed: int = 0) -> Mesh:
    """Mesh a domain.

    Args:
        policy: a trained policy.
        domain: what to mesh.
        attempts: sampled episodes, side by side, if the deterministic one fails; the completed one with the best mean
            element quality is taken.
        seed: of the sampling; the same arguments give the same mesh.

    Returns:
        A complete mesh without defects (see Mesh.defects).

    Raises:
        MeshingError: no attempt completed the domain.
    """
    if len(domain.ring) == 4:
        whole = Mesh(domain.name, domain.points, domain.ring[None], domain.segments, complete=True)
        return validated(whole, domain)
    results = run_episodes(policy, domain, 1, stochastic=False, seed=seed, widen=True)
    if not results[0].completed and attempts > 0:
        results += run_episodes(policy, domain, attempts, stochastic=True, seed=seed + 1, widen=True)
    completed = [result for result in results if result.completed]
    if not completed:
        farthest = max(results, key=lambda result: result.mesh.areas.sum())
        share = farthest.mesh.areas.sum() / domain.area
        raise MeshingError(
            f"{domain.name}: the policy did not complete it in {len(results)} attempts "
            f"(at best {share:.1%} of the area); "
            "raise --attempts, or train longer or on domains more like it"
        )
    return validated(max(completed, key=quality).mesh, domain)


def quality(result: Evaluated) -> float:
    """What attempts are ranked by: the mean element quality."""
    return result.mean_eta


def validated(mesh: Mesh, domain: Domain) -> Mesh:
    """The mesh, if nothing is wrong with it.

    Raises:
        MeshingError: it has a defect; no mesh with one is handed out.
    """
    if defects := mesh.defects(area=domain.area):
        raise MeshingError(f"{domain.name}: the mesh is not valid: {'; '.join(defects)}")
    return mesh
