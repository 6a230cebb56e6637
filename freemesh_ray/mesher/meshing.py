"""One mesh for a domain: the deterministic attempt first, exploring ones while none is complete."""

from __future__ import annotations

from envs.mesh import Mesh
from envs.types import Domain
from freemesh_ray.mesher.engine import Grown, grow
from freemesh_ray.policy import Policy

#: Share of the elements that further attempts draw from the policy, so that they go other ways.
EXPLORATION = 0.05


class MeshingError(RuntimeError):
    """The policy did not complete the domain."""


def mesh(policy: Policy, domain: Domain, *, attempts: int = 32, seed: int = 0) -> Mesh:
    """Mesh a domain.

    Args:
        policy: a trained policy.
        domain: what to mesh.
        attempts: further ones, each another way, if the deterministic one fails; the first that completes counts.
        seed: of all draws; the same arguments give the same mesh.

    Returns:
        A complete mesh without defects (see Mesh.defects).

    Raises:
        MeshingError: no attempt completed the domain.
    """
    if len(domain.ring) == 4:
        whole = Mesh(domain.name, domain.points, domain.ring[None], domain.segments, complete=True)
        return validated(whole, domain)
    best = grow(policy, domain, seed)
    for attempt in range(1, 1 + attempts):
        if best.mesh.complete:
            break
        best = max(best, grow(policy, domain, (seed, attempt), exploration=EXPLORATION), key=progress)
    return validated(completed(best, domain, attempts), domain)


def progress(grown: Grown) -> tuple[bool, float]:
    """What attempts are ranked by: whether complete, then the area covered."""
    return grown.mesh.complete, float(grown.mesh.areas.sum())


def completed(grown: Grown, domain: Domain, attempts: int) -> Mesh:
    """The mesh, if it is complete; the one place that decides what becomes of a ring that is left (``grown.ring``).

    Raises:
        MeshingError: a ring is left.
    """
    if grown.mesh.complete:
        return grown.mesh
    raise MeshingError(
        f"{domain.name}: the policy did not complete it in {1 + attempts} attempts "
        f"(at best {progress(grown)[1] / domain.area:.1%} of the area); "
        "raise --attempts, or train longer or on domains more like it"
    )


def validated(mesh: Mesh, domain: Domain) -> Mesh:
    """The mesh, if nothing is wrong with it.

    Raises:
        MeshingError: it has a defect; no mesh with one is handed out.
    """
    if defects := mesh.defects(area=domain.area):
        raise MeshingError(f"{domain.name}: the mesh is not valid: {'; '.join(defects)}")
    return mesh
