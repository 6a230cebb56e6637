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
from freemesh_ray.finish import finish
from freemesh_ray.mesh_geometry.metrics import measure
from freemesh_ray.mesher import MeshingError, mesh_domain
from freemesh_ray.policies.evaluation import run_episodes
from freemesh_ray.policies.policy import Policy

#: The meshes of a stage: the elements that the policy cut, and the same smoothed and cleaned up.
RAW, FINISHED = "raw", "finished"
#: What each is written as.
FORMATS = (".vtu", ".msh", ".inp")
#: Episodes of a policy that meshes in its environment alone: the first without draws.
ATTEMPTS = 10


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
        PluginError: a plug-in failed.
    """
    supply = source(stage)
    domain = supply if isinstance(supply, Domain) else supply.held_out(1)[0]
    if policy.plug_ins.alter:
        return _written(domain.name, _mesh_in_environment(policy, domain), folder)
    try:
        made = mesh_domain(policy, domain)
    except MeshingError as error:
        return StageMeshes(domain.name, reason=str(error))
    if made.filled:
        reason = f"the policy left a part that takes {made.filled} elements to fill"
        return StageMeshes(domain.name, reason=reason)
    return _written(domain.name, {RAW: made.raw, FINISHED: made.finished}, folder)


def _mesh_in_environment(policy: Policy, domain: Domain) -> dict[str, Mesh]:
    """The best mesh of `ATTEMPTS` episodes, raw and finished, of a policy that plug-ins keep from compiled meshing;
    empty where none was completed.
    """
    ended = run_episodes(policy, domain, 1, stochastic=False, seed=0)
    ended += run_episodes(policy, domain, ATTEMPTS - 1, stochastic=True, seed=0)
    best = max(ended, key=lambda one: one.score)
    if not best.completed or best.mesh.defects(area=domain.area):
        return {}
    finished = finish(best.mesh).mesh
    return {RAW: best.mesh, FINISHED: best.mesh if finished.defects(area=domain.area) else finished}


def _written(name: str, meshes: Mapping[str, Mesh], folder: Path) -> StageMeshes:
    """The meshes of domain ``name``, written."""
    if not meshes:
        return StageMeshes(name, reason=f"the policy completed no mesh in {ATTEMPTS} episodes")
    picture = folder / f"{name}.png"
    plots.draw_side_by_side(meshes, picture, name)
    files = {folder / f"{name}-{which}{suffix}": mesh for which, mesh in meshes.items() for suffix in FORMATS}
    for path, mesh in files.items():
        export.write(mesh, path)
    return StageMeshes(name, meshes, (picture, *files))
