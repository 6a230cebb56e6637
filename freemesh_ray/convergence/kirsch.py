"""Kirsch's plate with a hole under tension, plane stress: what engineers try a mesher on first."""

from __future__ import annotations

import numpy as np
import skfem
from skfem.helpers import ddot, eye, sym_grad, trace

from envs.types import Domain, Floats
from freemesh_ray.compare.mixed_mesh import MixedMesh
from freemesh_ray.convergence.bases import bases, integral, matrix, solved
from freemesh_ray.convergence.problem import Problem, circle, polygon

#: Half the plate's side, the hole's radius, and the material.
HALF, RADIUS, YOUNG, POISSON = 4.0, 1.0, 1.0, 0.3
SHEAR = YOUNG / (2 * (1 + POISSON))
#: Lame's first number in plane stress.
LAMBDA = YOUNG * POISSON / (1 - POISSON**2)
KOLOSOV = (3 - POISSON) / (1 + POISSON)


def domain(edge_length: float) -> Domain:
    """The plate: sides of equal segments, the hole's vertices on the circle."""
    corners = [(-HALF, -HALF), (HALF, -HALF), (HALF, HALF), (-HALF, HALF)]
    return polygon("plate", corners, edge_length, circle((0.0, 0.0), RADIUS, edge_length))


def displacement(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Of an infinite plate under a tension of 1 along x."""
    r, phi = np.hypot(x, y) / RADIUS, np.arctan2(y, x)
    size = RADIUS / (8 * SHEAR)
    along = r * (KOLOSOV + 1) * np.cos(phi) + 2 / r * ((1 + KOLOSOV) * np.cos(phi) + np.cos(3 * phi))
    across = r * (KOLOSOV - 3) * np.sin(phi) + 2 / r * ((1 - KOLOSOV) * np.sin(phi) + np.sin(3 * phi))
    return size * (along - 2 / r**3 * np.cos(3 * phi)), size * (across - 2 / r**3 * np.sin(3 * phi))


def stress(x: Floats, y: Floats) -> Floats:
    """(2, 2, ...): of the infinite plate."""
    r, phi = np.hypot(x, y) / RADIUS, np.arctan2(y, x)
    two, four = r**-2, 1.5 * r**-4
    xx = 1 - two * (1.5 * np.cos(2 * phi) + np.cos(4 * phi)) + four * np.cos(4 * phi)
    yy = -two * (0.5 * np.cos(2 * phi) - np.cos(4 * phi)) - four * np.cos(4 * phi)
    xy = -two * (0.5 * np.sin(2 * phi) + np.sin(4 * phi)) + four * np.sin(4 * phi)
    return np.array([[xx, xy], [xy, yy]])


def hooke(strain: Floats) -> Floats:
    """Stress of a strain, (2, 2, ...)."""
    found: Floats = 2 * SHEAR * strain + LAMBDA * eye(trace(strain), 2)
    return found


def energy(of: Floats) -> Floats:
    """Twice the strain energy density of a stress, (2, 2, ...)."""
    strain = ((1 + POISSON) * of - POISSON * eye(trace(of), 2)) / YOUNG
    found: Floats = ddot(of, strain)
    return found


@skfem.BilinearForm
def _stiffness(u, v, w):  # type: ignore[no-untyped-def]
    return ddot(hooke(sym_grad(u)), sym_grad(v))


def errors(mesh: MixedMesh) -> dict[str, float]:
    """The relative error in the energy norm; the outer sides move as the infinite plate does, the hole is free."""
    on = bases(mesh, components=2)
    given = np.stack(displacement(*mesh.vertices.T), axis=1).ravel()
    edge = np.unique(mesh.segments)
    outer = edge[np.abs(mesh.vertices[edge]).max(axis=1) > HALF * (1 - 1e-9)]
    fixed = np.concatenate([2 * outer, 2 * outer + 1])
    u = solved(matrix(_stiffness, on), given, np.zeros(len(given)), fixed)
    missed = skfem.Functional(lambda w: energy(hooke(sym_grad(w.u)) - stress(*w.x)))
    whole = skfem.Functional(lambda w: energy(stress(*w.x)))
    return {"energy": (integral(missed, on, u) / integral(whole, on, u)) ** 0.5}


KIRSCH = Problem("Kirsch's plate with a hole", 0.5, domain, errors, {"energy": 0.5})
