"""Gmsh's quadrilateral meshers on a fixed boundary: one straight curve for each given segment.

None but the quasi-structured algorithm divides one, and it all of them. Sizes inside come from the boundary segments
alone (Mesh.MeshSizeExtendFromBoundary), as Gmsh does by default; where numbers of elements are matched, they are a
factor times our size field, or Gmsh's own.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from envs.mdp.size_field import size_field, sizes_at
from envs.polygons.rings import loops
from envs.types import Domain, Ints, MeshingParameters
from freemesh_ray.compare.mixed_mesh import MixedMesh, PeerError, assembled

#: Gmsh's numbers for kinds of element.
TRIANGLE, QUAD = 2, 3

#: Passes of Gmsh's relocation of nodes; more change nothing in the third digit.
RELOCATIONS = 100


@dataclass(frozen=True)
class Variant:
    """One way to have quadrilaterals from Gmsh.

    Attributes:
        options: Gmsh's options by name.
        afterwards: an optimisation that follows, and how many passes of it; "" for none.
        paired: whether it is given pairs of boundary segments as one, which it halves.
        halves: whether it halves boundary segments of any number of nodes: in pairs it is given segments only where the
            boundary has to be as fine as the others'.
    """

    options: Mapping[str, float]
    afterwards: tuple[str, int] = ("", 0)
    paired: bool = False
    halves: bool = False


FRONTAL, FRONTAL_QUADS = {"Mesh.Algorithm": 6.0}, {"Mesh.Algorithm": 8.0}
BLOSSOM, FULL_QUAD = {"Mesh.RecombinationAlgorithm": 1.0}, {"Mesh.RecombinationAlgorithm": 3.0}
QUASI = {"Mesh.Algorithm": 11.0}

#: By the names of `peers.PEERS`.
VARIANTS: dict[str, Variant] = {
    "gmsh-default": Variant(FRONTAL | BLOSSOM),
    "gmsh-8": Variant(FRONTAL_QUADS | BLOSSOM, ("Relocate2D", RELOCATIONS)),
    # Left to itself Gmsh splits poor quadrilaterals into triangles.
    "gmsh-full-quad": Variant(FRONTAL_QUADS | FULL_QUAD | {"Mesh.RecombineMinimumQuality": -1e22}, paired=True),
    # An error inside its parallel loop would end the process: it is told to go on instead.
    "gmsh-8-quasi": Variant(
        FRONTAL_QUADS | BLOSSOM | {"General.AbortOnError": 0.0}, ("QuadQuasiStructured", 1)
    ),
    # It meshes twice as coarsely and halves all edges, those of the boundary, too.
    "gmsh-quasi": Variant(QUASI | {"General.AbortOnError": 0.0}, halves=True),
}  # fmt: skip


def mesh(domain: Domain, name: str, factor: float | None = None) -> MixedMesh:
    """Mesh a domain with one of the `VARIANTS`; ``seconds`` is the wall time of Gmsh's meshing alone.

    Args:
        domain: what to mesh.
        name: of the variant.
        factor: for a boundary as fine as the given one: of the sizes inside, times our size field; 1: Gmsh's own. None:
            Gmsh's own, and a variant that halves the given segments does so.

    Raises:
        PeerError: Gmsh failed, or the boundary cannot be paired.
        ImportError: Gmsh is not installed.
    """
    variant = VARIANTS[name]
    doubled = variant.halves and factor is not None
    with model(variant.options) as gmsh:
        try:
            middles = build(gmsh, domain, variant.paired or doubled, 3 if variant.paired else 2)
            if factor is not None and factor != 1.0:
                size_inside(gmsh, domain, 2 * factor if doubled else factor)
            start = time.perf_counter()
            gmsh.model.mesh.generate(2)
            for curve, vertex in middles:
                (tag,), _, _ = gmsh.model.mesh.getNodes(1, curve)
                gmsh.model.mesh.setNode(tag, [*domain.points[vertex], 0.0], [0.5])
            if variant.afterwards[0]:
                gmsh.model.mesh.optimize(variant.afterwards[0], niter=variant.afterwards[1])
            seconds = time.perf_counter() - start
            return result(gmsh, name, seconds)
        except PeerError:
            raise
        except Exception as error:  # Gmsh has no type of its own
            raise PeerError(str(error).strip() or "failed without a message") from error


def size_inside(gmsh: Any, domain: Domain, factor: float) -> None:
    """Have Gmsh take a factor times our size field for the sizes inside, in place of those of the boundary's nodes."""
    field = size_field(domain, MeshingParameters().size_gradient)

    def size(dimension: int, tag: int, x: float, y: float, z: float, before: float) -> float:
        return factor * float(sizes_at(field, np.array([[x, y]]))[0])

    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.model.mesh.setSizeCallback(size)


@contextmanager
def model(options: Mapping[str, float]) -> Iterator[Any]:
    """Gmsh with an empty model and these options; silent, and without its hold on Ctrl-C."""
    import gmsh

    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        # Gmsh has SIGPIPE end the process: this one, too, when a child process crashes. Ignored again.
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)
        gmsh.option.setNumber("General.Terminal", 0)
        for option, value in options.items():
            gmsh.option.setNumber(option, value)
        yield gmsh
    finally:
        gmsh.finalize()


def build(gmsh: Any, domain: Domain, paired: bool, nodes: int) -> list[tuple[int, int]]:
    """The domain as Gmsh's geometry: a curve for each segment, or for each pair of them, of so many nodes.

    Returns:
        For pairs of segments, each curve's tag and the vertex in its middle; else nothing.

    Raises:
        PeerError: a loop has an odd number of vertices, or too few, where pairs are needed.
    """
    geometry, wires = gmsh.model.geo, []
    middles: list[tuple[int, int]] = []
    for loop in loops(domain.segments):
        corners = loop
        if paired:
            loop = started(domain, loop)
            corners = loop[::2]
        tags = [geometry.addPoint(*point, 0.0) for point in domain.points[corners].tolist()]
        curves = [geometry.addLine(a, b) for a, b in zip(tags, tags[1:] + tags[:1], strict=True)]
        for curve in curves:
            geometry.mesh.setTransfiniteCurve(curve, nodes)
        wires.append(geometry.addCurveLoop(curves))
        if paired:
            middles += zip(curves, loop[1::2].tolist(), strict=True)
    surface = geometry.addPlaneSurface(wires)
    geometry.synchronize()
    gmsh.model.mesh.setRecombine(2, surface)
    return middles


def started(domain: Domain, loop: Ints) -> Ints:
    """The loop from where its even places, which pairs of segments keep, take more of its turning (squared).

    Raises:
        PeerError: it has an odd number of vertices, or fewer than six.
    """
    if len(loop) % 2 or len(loop) < 6:
        raise PeerError(f"a boundary loop of {len(loop)} vertices does not fall into three or more pairs of segments")
    points = domain.points[loop]
    ahead = np.roll(points, -1, axis=0) - points
    behind = np.roll(ahead, 1, axis=0)
    turn = np.arctan2(behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0], (behind * ahead).sum(axis=1)) ** 2
    return loop if turn[::2].sum() >= turn[1::2].sum() else np.roll(loop, -1)


def result(gmsh: Any, name: str, seconds: float) -> MixedMesh:
    """The mesh in Gmsh's model."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    vertices = np.zeros((int(tags.max(initial=0)) + 1, 2))
    vertices[tags] = coordinates.reshape(-1, 3)[:, :2]
    kinds, _, nodes = gmsh.model.mesh.getElements(2)
    corners = dict(zip(kinds.tolist(), nodes, strict=True))
    return assembled(name, vertices, corners.get(QUAD, ()), corners.get(TRIANGLE, ()), seconds)
