"""Every mesher on ever finer meshes of a problem."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from freemesh_ray.compare.meshers import Mesher
from freemesh_ray.compare.mixed_mesh import PeerError
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
        errors: relative, by name; None where there is none.
        failure: why; "" where there is a solution.
    """

    problem: str
    mesher: str
    edge_length: float
    elements: int
    errors: Mapping[str, float] | None
    failure: str


def run(
    name: str, problem: Problem, meshers: Sequence[Mesher], levels: int, told: Callable[[Solved], None]
) -> list[Solved]:
    """Solve a problem on ``levels`` meshes of each mesher, the edges halved from one to the next.

    Args:
        name: the problem's.
        problem: it.
        meshers: each gives its last mesh of a domain, the one that it hands out.
        levels: >= 1.
        told: called with each line as it is found.
    """
    found = []
    for level in range(levels):
        edge_length = problem.coarsest / 2**level
        domain = problem.domain(edge_length)
        for mesher in meshers:
            elements = 0
            try:
                mesh = mesher.run(domain)[-1]
                elements = len(mesh)
                solved = Solved(name, mesher.name, edge_length, elements, problem.errors(mesh), "")
            except (PeerError, MeshingError, UnsolvableError) as error:
                solved = Solved(name, mesher.name, edge_length, elements, None, str(error).replace("\n", " "))
            found.append(solved)
            told(solved)
    return found
