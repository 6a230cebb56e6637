"""Laplace's equation on an L-shape: the solution r^(2/3) sin(2 phi / 3) is singular at the re-entrant corner."""

from __future__ import annotations

import numpy as np

from envs.types import Domain, Floats
from freemesh_ray.compare.mixed_mesh import MixedMesh
from freemesh_ray.convergence import laplace
from freemesh_ray.convergence.problem import Problem, polygon

EXPONENT = 2 / 3


def domain(edge_length: float) -> Domain:
    """[-1, 1]^2 without its quarter x > 0, y < 0, with sides of equal segments."""
    return polygon("l-shape", [(-1, -1), (0, -1), (0, 0), (1, 0), (1, 1), (-1, 1)], edge_length)


def polar(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """The distance from the corner, and the angle from the side along x, in [0, 2 pi)."""
    return np.hypot(x, y), np.arctan2(y, x) % (2 * np.pi)


def exact(x: Floats, y: Floats) -> Floats:
    """The solution."""
    r, phi = polar(x, y)
    return r**EXPONENT * np.sin(EXPONENT * phi)


def gradient(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Its gradient, away from the corner."""
    r, phi = polar(x, y)
    size, turned = EXPONENT * r ** (EXPONENT - 1), (EXPONENT - 1) * phi
    return size * np.sin(turned), size * np.cos(turned)


def errors(mesh: MixedMesh) -> dict[str, float]:
    """Relative errors of the gradient and of the solution."""
    return laplace.errors(mesh, exact, gradient, None)


L_SHAPE = Problem("Laplace's equation on an L-shape", 1 / 8, domain, errors, {"H1": 2**-EXPONENT, "L2": 4**-EXPONENT})
