"""A cylinder in a channel at Reynolds number 20 (Schaefer, Turek 1996, 2D-1): its drag, of Taylor-Hood elements."""

from __future__ import annotations

from typing import Any

import numpy as np
import skfem
from scipy.sparse import bmat, csr_matrix
from skfem import Basis, ElementQuad1, ElementQuad2, ElementVector, MeshQuad
from skfem.helpers import ddot, div, dot, grad, mul

from envs.types import Domain, Floats, Ints
from freemesh_ray.compare.mixed_mesh import MixedMesh
from freemesh_ray.convergence.problem import Problem, UnsolvableError, circle, polygon

LENGTH, HEIGHT, CENTRE, RADIUS = 2.2, 0.41, (0.2, 0.2), 0.05
VISCOSITY, FASTEST = 0.001, 0.3
#: The drag coefficient that the benchmark's authors agree on, and what makes one of a force.
DRAG, PER_FORCE = 5.57953523384, 2 / ((2 / 3 * FASTEST) ** 2 * 2 * RADIUS)
#: Newton's iterations, and the change of the velocity, over its size, below which they end.
MOST, ENOUGH = 20, 1e-8


def domain(edge_length: float) -> Domain:
    """The channel, the cylinder's vertices on the circle."""
    corners = [(0.0, 0.0), (LENGTH, 0.0), (LENGTH, HEIGHT), (0.0, HEIGHT)]
    return polygon("channel", corners, edge_length, circle(CENTRE, RADIUS, edge_length))


@skfem.BilinearForm
def _diffusion(u, v, w):  # type: ignore[no-untyped-def]
    return VISCOSITY * ddot(grad(u), grad(v))


@skfem.BilinearForm
def _pressure(u, q, w):  # type: ignore[no-untyped-def]
    return -div(u) * q


@skfem.BilinearForm
def _carried(u, v, w):  # type: ignore[no-untyped-def]
    return dot(mul(grad(u), w.by), v)


@skfem.BilinearForm
def _carrying(u, v, w):  # type: ignore[no-untyped-def]
    return dot(mul(grad(w.by), u), v)


class _Flow:
    """The discrete problem on a mesh."""

    def __init__(self, mesh: MixedMesh) -> None:
        quads = MeshQuad(mesh.vertices.T.copy(), mesh.quads.T.copy(), sort_t=False, validate=False)
        self.velocity = Basis(quads, ElementVector(ElementQuad2()), intorder=5)
        self.pressure = self.velocity.with_element(ElementQuad1())
        self.viscous: csr_matrix = _diffusion.assemble(self.velocity)
        self.divergence: csr_matrix = _pressure.assemble(self.velocity, self.pressure)
        facets = quads.boundary_facets()
        x, y = quads.p[:, quads.facets[:, facets]].mean(axis=1)
        round_it = np.hypot(x - CENTRE[0], y - CENTRE[1]) < 1.01 * RADIUS
        self.cylinder: Ints = self.velocity.get_dofs(facets[round_it]).all("u^1")
        #: Everything but the outflow.
        self.fixed: Ints = self.velocity.get_dofs(facets[x < LENGTH * (1 - 1e-9)]).all()
        self.given = np.zeros(self.velocity.N)
        inflow = self.velocity.get_dofs(facets[x < 1e-9 * LENGTH]).all("u^1")
        height = self.velocity.doflocs[1, inflow]
        self.given[inflow] = 4 * FASTEST * height * (HEIGHT - height) / HEIGHT**2

    def convection(self, by: Floats) -> tuple[csr_matrix, csr_matrix]:
        """What a velocity carries, and its own change carried by another."""
        known = {"by": self.velocity.interpolate(by)}
        return _carried.assemble(self.velocity, **known), _carrying.assemble(self.velocity, **known)

    def step(self, u: Floats) -> tuple[Floats, Floats]:
        """Newton's next velocity and pressure; Stokes' from a velocity of 0."""
        carried, carrying = self.convection(u)
        whole = bmat([[self.viscous + carried + carrying, self.divergence.T], [self.divergence, None]], "csr")
        load = np.concatenate([carrying @ u, np.zeros(self.pressure.N)])
        start = np.concatenate([self.given, np.zeros(self.pressure.N)])
        found = skfem.solve(*skfem.condense(whole, load, x=start, D=self.fixed))
        return found[: self.velocity.N], found[self.velocity.N :]

    def force(self, u: Floats, p: Floats) -> float:
        """What pulls the cylinder along, by the momentum that is left at its vertices."""
        left = (self.viscous + self.convection(u)[0]) @ u + self.divergence.T @ p
        return -float(left[self.cylinder].sum())


def errors(mesh: MixedMesh) -> dict[str, Any]:
    """The relative error of the drag.

    Raises:
        UnsolvableError: the mesh has triangles, or Newton's iterations do not end.
    """
    if len(mesh.triangles):
        raise UnsolvableError(f"{len(mesh.triangles)} triangles, for which it is not solved")
    flow = _Flow(mesh)
    u = np.zeros(flow.velocity.N)
    for _ in range(MOST):
        before, (u, p) = u, flow.step(u)
        if np.linalg.norm(u - before) <= ENOUGH * np.linalg.norm(u):
            return {"drag": abs(PER_FORCE * flow.force(u, p) / DRAG - 1)}
    raise UnsolvableError(f"no steady flow after {MOST} iterations")


CYLINDER = Problem("Drag of a cylinder in a channel", 0.025, domain, errors, {"drag": 0.25})
