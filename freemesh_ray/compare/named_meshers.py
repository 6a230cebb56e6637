"""What is compared: named meshers that take a domain and give its meshes."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module

from envs.types import Domain
from freemesh_ray.compare.child_process import ChildDiedError, Limits, in_child_process
from freemesh_ray.compare.matching import Resized
from freemesh_ray.compare.mixed_mesh import MixedMesh, PeerError, of_mesh
from freemesh_ray.compare.our_mesher import MeshDomain
from freemesh_ray.compare.peers import PEERS, Peer


@dataclass(frozen=True)
class Mesher:
    """A column of the comparison.

    Attributes:
        name: what tables and pictures call it.
        run: its meshes of a domain, most often one; raises PeerError or MeshingError.
        resized: how its sizes are varied on a fixed boundary, to match numbers of elements; None where they cannot be.
    """

    name: str
    run: Callable[[Domain], Sequence[MixedMesh]]
    resized: Resized | None = None


#: What a peer in a process of its own may take.
LIMITS = Limits(memory=32 * 2**30, seconds=300)

#: Our mesher's name, and that of its meshes before anything follows the policy.
OURS, RAW = "freemesh", "freemesh raw"


def ours(make: MeshDomain) -> Mesher:
    """Our mesher: its finished mesh, and the raw one where that is another."""

    def run(domain: Domain) -> list[MixedMesh]:
        made = make(domain)
        finished = of_mesh(made.finished, OURS, made.seconds_finished)
        return [finished] if made.raw is made.finished else [of_mesh(made.raw, RAW, made.seconds_raw), finished]

    return Mesher(OURS, run)


@dataclass(frozen=True)
class Peers:
    """The peers that were asked for.

    Attributes:
        meshers: those that are there.
        absent: the others' names -> why, and what brings them.
    """

    meshers: Sequence[Mesher]
    absent: Mapping[str, str]


def installed_peers(names: Sequence[str], note: Callable[[str], None]) -> Peers:
    """The peers of these names; for each package that is not installed ``note`` is called with one line."""
    wanted = {name: PEERS[name] for name in names}
    missing: dict[str, str] = {}
    for peer in {peer.needs: peer for peer in wanted.values()}.values():
        if what := absence(peer):
            source = f"it comes with {peer.package}" if peer.program else f"pip install {peer.package}"
            note(f"{what}: its meshes are left out; {source}")
            missing[peer.needs] = f"{what}; {source}"
    return Peers(
        [peer_mesher(name) for name, peer in wanted.items() if peer.needs not in missing],
        {name: missing[peer.needs] for name, peer in wanted.items() if peer.needs in missing},
    )


def absence(peer: Peer) -> str:
    """Why a peer is not there; "" where it is."""
    if peer.program:
        return "" if shutil.which(peer.needs) else f"{peer.needs} is not on the path"
    try:
        import_module(peer.needs)
    except (ImportError, OSError) as error:  # OSError: a library that it needs is not there
        reason = "" if isinstance(error, ModuleNotFoundError) else f" ({error})"
        return f"{peer.needs.split('.')[0]} is not installed{reason}"
    return ""


def peer_mesher(name: str) -> Mesher:
    """The peer of a name."""
    return Mesher(
        name,
        lambda domain: [peer_mesh(domain, name)],
        (lambda domain, factor: peer_mesh(domain, name, factor)) if PEERS[name].sized else None,
    )


def peer_mesh(domain: Domain, name: str, *factor: float) -> MixedMesh:
    """A peer's mesh of a domain; the time measured is that of the meshing alone.

    Args:
        domain: what to mesh.
        name: the peer's.
        factor: of the sizes inside, for those whose sizes can be varied; none: its own.

    Raises:
        PeerError: it failed, or its process died.
        ImportError: it is not installed.
    """
    peer = PEERS[name]
    mesh: Callable[..., MixedMesh] = import_module(f"freemesh_ray.compare.{peer.module}").mesh
    if not peer.crashes:
        return mesh(domain, name, *factor)
    try:
        return in_child_process(mesh, domain, name, *factor, limits=LIMITS)
    except ChildDiedError:
        raise PeerError(f"crashed, or took more than {LIMITS.seconds} s of processor time") from None
