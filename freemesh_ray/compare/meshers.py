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


@dataclass(frozen=True)
class Peer:
    """A mesher of another's.

    Attributes:
        module: what has to be there to import.
        package: what installs it.
        mesh: the call.
    """

    module: str
    package: str
    mesh: Callable[[Domain], MixedMesh]


#: Peers by name.
PEERS: dict[str, Peer] = {
    **{name: Peer("gmsh", "gmsh", partial(gmsh_mesh, name=name)) for name in VARIANTS},
    # It now and then crashes, itself or a later call of Gmsh in its process.
    "gmsh-quasi": Peer("gmsh", "gmsh", partial(isolated, gmsh_mesh, name="gmsh-quasi")),
    "netgen": Peer("netgen.geom2d", "netgen-mesher", netgen_mesh),
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
    wanted = {name: PEERS[name] for name in names}
    missing = set()
    for module, package in dict.fromkeys((peer.module, peer.package) for peer in wanted.values()):
        try:
            import_module(module)
        except (ImportError, OSError) as error:  # OSError: a library that it needs is not there
            reason = "" if isinstance(error, ModuleNotFoundError) else f" ({error})"
            note(f"{module.split('.')[0]} is not installed{reason}: its meshes are left out; pip install {package}")
            missing.add(module)
    return [Mesher(name, single(peer.mesh)) for name, peer in wanted.items() if peer.module not in missing]


def single(mesh: Callable[[Domain], MixedMesh]) -> Callable[[Domain], list[MixedMesh]]:
    """A call that gives one mesh as one that gives several."""
    return lambda domain: [mesh(domain)]
