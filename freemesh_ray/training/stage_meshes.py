"""Every stage of a training meshed with its best policy: raw, as the policy left it, and finished."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from envs.domains.load import source
from envs.mesh import Mesh
from envs.types import Domain
from freemesh_ray import export, plots
from freemesh_ray.mesher import MeshingError, mesh_domain
from freemesh_ray.meshes.metrics import measure
from freemesh_ray.policies.policy import Policy

#: The meshes of a stage: the elements that the policy cut, and the same smoothed and cleaned up.
RAW, FINISHED = "raw", "finished"
#: What each is written as.
FORMATS = (".vtu", ".msh", ".inp")


@dataclass(frozen=True)
class StageMeshes:
    """One stage meshed with the best policy.

    Attributes:
        domain: its name.
        meshes: `RAW` and `FINISHED`; empty where the policy did not complete the domain.
        files: written, the picture of both first.
        reason: why there is no mesh.
    """

    domain: str
    meshes: Mapping[str, Mesh] = field(default_factory=dict)
    files: tuple[Path, ...] = ()
    reason: str = ""

    @cached_property
    def figures(self) -> dict[str, dict[str, float]]:
        """The metrics of each mesh (`measure`)."""
        return {name: measure(mesh) for name, mesh in self.meshes.items()}


def mesh_stage(policy: Policy, stage: str, folder: Path) -> StageMeshes:
    """Mesh a stage; write the picture of both meshes, and each as .vtu, .msh and .inp, into ``folder``.

    Args:
        policy: the best one.
        stage: as ``curriculum.stages`` has it; of an endless supply the first domain that is kept from training.
        folder: it is made.

    Raises:
        OutputError: a file cannot be written.
    """
    supply = source(stage)
    domain = supply if isinstance(supply, Domain) else supply.held_out(1)[0]
    try:
        made = mesh_domain(policy, domain)
    except MeshingError as error:
        return StageMeshes(domain.name, reason=str(error))
    if made.filled:
        reason = f"the policy left a part that takes {made.filled} elements to fill"
        return StageMeshes(domain.name, reason=reason)
    meshes = {RAW: made.raw, FINISHED: made.finished}
    picture = folder / f"{domain.name}.png"
    plots.draw_side_by_side(meshes, picture, domain.name)
    files = {folder / f"{domain.name}-{name}{suffix}": mesh for name, mesh in meshes.items() for suffix in FORMATS}
    for path, mesh in files.items():
        export.write(mesh, path)
    return StageMeshes(domain.name, meshes, (picture, *files))
