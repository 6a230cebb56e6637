"""The peers, meshers of others: how each meshes, and what it needs. None is imported before it meshes.

A new peer is an entry here and a file beside it with ``mesh(domain: Domain, name: str) -> MixedMesh``, which takes a
third argument, ``factor: float | None``, where its sizes can be varied on a fixed boundary.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Peer:
    """One peer.

    Attributes:
        meaning: how it meshes, in a line.
        module: its file in this package.
        package: what installs it, for pip; of a program, where it comes from.
        needs: what has to be there to import; of a program, its name on the path.
        crashes: whether it now and then takes its process down, or a later call there: it is given one of its own.
        program: whether it is a program, no Python package.
        sized: whether its ``mesh`` takes a factor of the sizes inside, too, the boundary kept.
    """

    meaning: str
    module: str
    package: str
    needs: str
    crashes: bool = False
    program: bool = False
    sized: bool = False


def _gmsh(meaning: str, *, crashes: bool = False) -> Peer:
    """One of Gmsh's."""
    return Peer(meaning, "gmsh_mesher", "gmsh", "gmsh", crashes, sized=True)


#: Every peer by its name, in the order in which they are listed.
PEERS: dict[str, Peer] = {
    "gmsh-default": _gmsh("Frontal-Delaunay triangles, recombined by Blossom"),
    "gmsh-8": _gmsh("Frontal-Delaunay for quads, recombined by Blossom, nodes relocated"),
    "gmsh-full-quad": _gmsh("Blossom full-quad on pairs of boundary segments, which it halves again"),
    "gmsh-8-quasi": _gmsh("Frontal-Delaunay for quads, Blossom, then the quasi-structured optimisation", crashes=True),
    "gmsh-quasi": _gmsh("quasi-structured quads (algorithm 11), which halve every boundary segment", crashes=True),
    "netgen": Peer("Netgen, quad-dominated", "netgen_mesher", "netgen-mesher", "netgen.geom2d"),
    "fastq": Peer(
        "Sandia's FASTQ, paving", "fastq_mesher", "SEACAS, https://github.com/sandialabs/seacas", "fastq", program=True
    ),
}  # fmt: skip

#: What pip installs for them, each once.
PACKAGES = tuple(dict.fromkeys(peer.package for peer in PEERS.values() if not peer.program))
