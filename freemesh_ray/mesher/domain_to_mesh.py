"""One mesh for a domain: grown by the policy, the rest filled if need be, validated, finished.

    grow -> (another way, when it got stuck) -> fill the ring that is left -> validate -> finish -> validate

Every domain is completed: what the policy cannot mesh in ``ATTEMPTS`` attempts, ``envs.filling.convex_fill`` fills.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from envs.errors import FAILED, UserError
from envs.filling.convex_fill import FillError, fill
from envs.mdp.size_field import elements_wanted, size_field
from envs.mesh import Mesh
from envs.polygons.element_count import check_elements, expected_in_domain
from envs.quality import element_quality
from envs.types import NO_WISHES, Domain, WantedSizes
from freemesh_ray.finish import NO_SIZES, USUAL, finish
from freemesh_ray.mesher.engine import Grown, grow
from freemesh_ray.mesher.warm_up import warm_up
from freemesh_ray.policies.policy import Policy, PolicyError
from freemesh_ray.storage import free_memory

#: Times that the policy begins a domain before what is left is filled.
ATTEMPTS = 3

#: Bytes that a mesh takes for each expected element, from its front to its finish (measured: 290 to 1200).
BYTES_PER_ELEMENT = 1500

#: Share of the elements that further attempts draw from the policy, so that they go other ways.
EXPLORATION = 0.05


class MeshingError(UserError, RuntimeError):
    """A domain that has no valid mesh in floating point."""

    exit_code = FAILED


@dataclass(frozen=True)
class MeshResult:
    """A mesh, as the policy left it and as it is handed out; both without defects.

    Attributes:
        raw: elements in the order they were cut, those that filled the last ring at the end.
        finished: smoothed and cleaned up; ``raw`` itself when neither was wanted.
        seconds_raw: wall time up to ``raw``.
        seconds_finished: wall time up to ``finished``, that of ``raw`` included.
        attempts: times that the policy began.
        sources: elements by where they came from (see engine.Grown), of the attempt that is handed out; those that
            filled the ring that was left count as ``filled``.
        backtracks: times that elements were taken back.
        sequences: topological changes of the clean-up.
        patches: patches that were filled anew.
        deviation: how far the given outline lies off the boundary at most, where that was split; domain units.
    """

    raw: Mesh
    finished: Mesh
    seconds_raw: float
    seconds_finished: float
    attempts: int = 1
    sources: Mapping[str, int] = field(default_factory=dict)
    backtracks: int = 0
    sequences: int = 0
    patches: int = 0
    deviation: float = 0.0

    @property
    def filled(self) -> int:
        """Elements that the policy did not find."""
        return self.sources.get("filled", 0)


def mesh_domain(
    policy: Policy,
    domain: Domain,
    *,
    seed: int = 0,
    best_of: int = 1,
    search: bool = False,
    smooth: bool = True,
    clean: bool = True,
    effort: str = USUAL,
    sizes: WantedSizes = NO_WISHES,
    allow_large: bool = False,
) -> MeshResult:
    """Mesh a domain.

    Args:
        policy: a trained policy.
        domain: what to mesh.
        seed: of all draws; the same arguments give the same mesh.
        best_of: meshes to make, each another way; the one whose elements are best in the mean is handed out.
        search: for each element take the best of several of the policy's draws, by its critics or by the reward;
            otherwise its mean action.
        smooth, clean, effort: see finish.
        sizes: what is wanted inside beyond the boundary's own sizes; for a policy whose scale is ``size``.
        allow_large: make a mesh of more than ``element_count.MOST_ELEMENTS`` expected elements, too.

    The first call in a process loads the kernels, or compiles them, which no mesh's time includes.

    Raises:
        PolicyError: sizes for a policy that does not know the edge length wanted.
        DomainError, MemoryShortError: the mesh would be too large, or memory has no room for it; nothing was begun.
        MeshingError: no valid mesh was found: a domain thinner than its coordinates are precise.
    """
    if sizes.stated and not policy.parameters.sized:
        raise PolicyError(
            f"{domain.name}: the policy was trained with env.scale = {policy.parameters.scale} and keeps to no size: "
            "give --density even, or leave --size, --min-size and --max-size out"
        )
    expected = expected_in_domain(domain)
    if sizes.stated:
        expected = max(expected, elements_wanted(domain, policy.parameters.size_gradient, sizes))
    if not allow_large:
        check_elements(expected, domain.name)
    check_memory(expected, domain.name)
    warm_up(policy)
    began = time.perf_counter()
    candidates = [mesh_once(policy, domain, (seed, k), search, smooth, clean, effort, sizes) for k in range(best_of)]
    best = max(candidates, key=lambda one: mean_quality(one.finished))
    return replace(best, seconds_finished=time.perf_counter() - began) if best_of > 1 else best


def check_memory(expected: float, source: str) -> None:
    """Refuse a mesh that memory has no room for.

    Args:
        expected: elements.
        source: what the message begins with.

    Raises:
        MemoryShortError: as said.
    """
    what = f"{source}: a mesh of about {expected:,.0f} elements"
    free_memory.check(BYTES_PER_ELEMENT * expected, what, "use a larger edge length")


def mean_quality(mesh: Mesh) -> float:
    """Mean eta_e."""
    return float(element_quality(mesh.vertices, mesh.quads).mean())


def mesh_once(
    policy: Policy,
    domain: Domain,
    seed: tuple[int, int],
    search: bool,
    smooth: bool,
    clean: bool,
    effort: str,
    sizes: WantedSizes,
) -> MeshResult:
    """One mesh for `mesh_domain`."""
    began = time.perf_counter()
    grown, attempts = nothing(domain), 0
    while len(domain.ring) > 4 and attempts < ATTEMPTS and not grown.mesh.complete:
        share = exploration(search, seed[1] + attempts)
        another = grow(policy, domain, (*seed, attempts), exploration=share, sizes=sizes)
        grown, attempts = max(grown, another, key=covered), attempts + 1
    raw = validated(completed(grown, domain), domain)
    seconds_raw = time.perf_counter() - began
    sources = dict(grown.sources) | {"filled": len(raw.quads) - len(grown.mesh.quads)}
    finished, sequences, patches = raw, 0, 0
    if smooth or clean:
        sized = policy.parameters.sized  # another policy makes elements of sizes of its own
        wanted = size_field(domain, policy.parameters.size_gradient, sizes=sizes) if sized else NO_SIZES
        result = finish(
            raw, wanted, lines=domain.lines, held=domain.held, smooth=smooth, clean=clean, effort=effort
        )  # fmt: skip
        finished, sequences, patches = validated(result.mesh, domain), result.sequences, result.patches
    seconds = time.perf_counter() - began
    return MeshResult(
        raw, finished, seconds_raw, seconds, attempts, sources, grown.backtracks, sequences, patches, domain.deviation
    )


def exploration(search: bool, number: int) -> float:
    """Share of the elements that are drawn: all in a search, none in the first attempt, some in the others."""
    return 1.0 if search else EXPLORATION * (number > 0)


def nothing(domain: Domain) -> Grown:
    """The domain before anything was cut."""
    empty = Mesh(domain.name, domain.points, np.zeros((0, 4), dtype=np.int64), domain.segments, complete=False)
    return Grown(mesh=empty, ring=domain.ring, action_types={}, sources={}, backtracks=0, taken_back=0)


def covered(grown: Grown) -> tuple[bool, float]:
    """What attempts are ranked by: whether complete, then the area covered."""
    return grown.mesh.complete, float(grown.mesh.areas.sum())


def completed(grown: Grown, domain: Domain) -> Mesh:
    """The mesh with the ring that is left filled; the whole domain, if that ring is too thin.

    Raises:
        MeshingError: the domain is too thin, too.
    """
    if grown.mesh.complete:
        return grown.mesh
    mesh = grown.mesh
    try:
        filling = fill(mesh.vertices, grown.ring)
    except FillError:
        try:
            mesh, filling = nothing(domain).mesh, fill(domain.points, domain.ring)
        except FillError as error:
            raise MeshingError(f"{domain.name}: {error}") from error
    return replace(mesh, vertices=filling.points, quads=np.concatenate([mesh.quads, filling.quads]), complete=True)


def validated(mesh: Mesh, domain: Domain) -> Mesh:
    """The mesh, if nothing is wrong with it.

    Raises:
        MeshingError: it has a defect; no mesh with one is handed out.
    """
    if defects := [*mesh.defects(area=domain.area), *lost(mesh, domain)]:
        raise MeshingError(f"{domain.name}: the mesh is not valid: {'; '.join(defects)}")
    return mesh


def lost(mesh: Mesh, domain: Domain) -> list[str]:
    """What a mesh does not keep of its domain's lines and of the points inside that stay; empty when it keeps all."""
    if not len(domain.lines) and not len(domain.held):
        return []
    found, base = [], len(mesh.vertices)
    known = np.sort(mesh.edges[0], axis=1) @ [base, 1]
    missing = int(np.sum(~np.isin(np.sort(domain.lines, axis=1) @ [base, 1], known)))
    if missing:
        found.append(f"{missing} segments of lines are no edges")
    given = np.union1d(domain.lines.ravel(), domain.held)
    used = np.zeros(base, dtype=np.bool_)
    used[mesh.quads.ravel()] = True
    off = int(np.sum(~used[given] | (mesh.vertices[given] != domain.points[given]).any(axis=1)))
    if off:
        found.append(f"{off} points of lines, or points inside, are no vertices")
    return found
