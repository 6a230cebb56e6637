"""What is compared: named meshers that take a domain and give its meshes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module

from envs.types import Domain
from freemesh_ray.compare.gmsh_mesher import VARIANTS, gmsh_mesh
from freemesh_ray.compare.isolated import isolated
from freemesh_ray.compare.mixed_mesh import MixedMesh, of_mesh
from freemesh_ray.compare.netgen_mesher import netgen_mesh
from freemesh_ray.compare.our_mesher import Make


@dataclass(frozen=True)
class Mesher:
    """A column of the comparison.

    Attributes:
        name: what tables and pictures call it.
        run: its meshes of a domain, most often one; raises PeerError or MeshingError.
    """

    name: str
    run: Callable[[Domain], Sequence[MixedMesh]]


#: Our mesher's name, and that of its meshes before anything follows the policy.
OURS, RAW = "freemesh", "freemesh raw"

#: Peers by name: what has to be installed, and the call.
PEERS: dict[str, tuple[str, Callable[[Domain], MixedMesh]]] = {
    **{name: ("gmsh", partial(gmsh_mesh, name=name)) for name in VARIANTS},
    # Its optimisation writes where it should not on some domains: it would take this process down now or later.
    "gmsh-quasi": ("gmsh", partial(isolated, gmsh_mesh, name="gmsh-quasi")),
    "netgen": ("netgen.geom2d", netgen_mesh),
}


def ours(make: Make) -> Mesher:
    """Our mesher: its finished mesh, and the raw one where that is another."""

    def run(domain: Domain) -> list[MixedMesh]:
        made = make(domain)
        finished = of_mesh(made.finished, OURS, made.seconds_finished)
        return [finished] if made.raw is made.finished else [of_mesh(made.raw, RAW, made.seconds_raw), finished]

    return Mesher(OURS, run)


def peers(names: Sequence[str], note: Callable[[str], None]) -> list[Mesher]:
    """The peers of these names that are installed; for each package that is not, ``note`` is called with one line."""
    found, missing = [], set()
    for name in names:
        package, mesh = PEERS[name]
        if package in missing:
            continue
        try:
            import_module(package)
        except (ImportError, OSError) as error:  # OSError: a library that it needs is not there
            missing.add(package)
            reason = "" if isinstance(error, ModuleNotFoundError) else f" ({error})"
            what, wheel = package.split(".")[0], {"gmsh": "gmsh"}.get(package, "netgen-mesher")
            note(f"{what} is not installed{reason}: its meshes are left out; pip install {wheel}")
            continue
        found.append(Mesher(name, lambda domain, mesh=mesh: [mesh(domain)]))  # type: ignore[misc]
    return found
