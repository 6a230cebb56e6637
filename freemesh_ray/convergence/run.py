"""Every mesher on ever finer meshes of a problem."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from envs.types import Domain
from freemesh_ray.compare.matching import CANNOT_VARY, NOTHING_TO_MATCH, match
from freemesh_ray.compare.mixed_mesh import MixedMesh, PeerError
from freemesh_ray.compare.named_meshers import Mesher
from freemesh_ray.convergence.problem import Problem, UnsolvableError
from freemesh_ray.mesher import MeshingError


@dataclass(frozen=True)
class Solved:
    """A problem on one mesh.

    Attributes:
        problem: its name.
        mesher: the mesher's.
        edge_length: of the boundary's segments.
        elements: of the mesh; 0 where there is none.
        vertices: likewise.
        size_factor: of the sizes inside, where numbers of elements were matched; else NaN.
        remark: what is to be known of the match; "" for nothing.
        errors: relative, by name; None where there is none.
        failure: why; "" where there is a solution.
    """

    problem: str
    mesher: str
    edge_length: float
    elements: int
    errors: Mapping[str, float] | None
    failure: str
    vertices: int = 0
    size_factor: float = math.nan
    remark: str = ""


def run(
    name: str,
    problem: Problem,
    meshers: Sequence[Mesher],
    levels: int,
    told: Callable[[Solved], None],
    *,
    matched: bool = False,
) -> list[Solved]:
    """Solve a problem on ``levels`` meshes of each mesher, the edges halved from one to the next.

    Args:
        name: the problem's.
        problem: it.
        meshers: each gives its last mesh of a domain, the one that it hands out.
        levels: >= 1.
        told: called with each line as it is found.
        matched: whether the others' numbers of elements are matched to the first's.
    """
    found = []
    for level in range(levels):
        edge_length = problem.coarsest / 2**level
        domain = problem.domain(edge_length)
        wanted: int | None = None
        for mesher in meshers:
            solved = Solved(name, mesher.name, edge_length, 0, None, "")
            try:
                mesh, factor, remark = made(mesher, domain, wanted)
                solved = replace(
                    solved, elements=len(mesh), vertices=len(mesh.vertices), size_factor=factor, remark=remark
                )
                solved = replace(solved, errors=problem.errors(mesh))
            except (PeerError, MeshingError, UnsolvableError) as error:
                solved = replace(solved, failure=str(error).replace("\n", " "))
            if matched and wanted is None:
                wanted = solved.elements
            found.append(solved)
            told(solved)
    return found


def made(mesher: Mesher, domain: Domain, wanted: int | None) -> tuple[MixedMesh, float, str]:
    """A mesher's last mesh of a domain, the factor of its sizes, NaN for none, and what is to be known of the match.

    Args:
        mesher: it.
        domain: it.
        wanted: elements to match; 0 where there is nothing to match, None where nothing is to be matched.
    """
    if wanted and mesher.resized:
        found = match(mesher.resized, domain, wanted)
        return found.mesh, found.factor, "" if found.reached else str(found)
    remark = "" if wanted is None else f"not matched: {CANNOT_VARY if wanted else NOTHING_TO_MATCH}"
    return mesher.run(domain)[-1], math.nan, remark
