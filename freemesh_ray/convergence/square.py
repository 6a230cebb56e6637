"""Poisson's equation on the unit square, u = sin 3 pi x sin 3 pi y."""

from __future__ import annotations

import numpy as np

from envs.types import Domain, Floats
from freemesh_ray.compare.mixed_mesh import MixedMesh
from freemesh_ray.convergence import laplace
from freemesh_ray.convergence.problem import Problem, polygon

K = 3 * np.pi


def domain(edge_length: float) -> Domain:
    """The square with sides of equal segments."""
    return polygon("square", [(0, 0), (1, 0), (1, 1), (0, 1)], edge_length)


def exact(x: Floats, y: Floats) -> Floats:
    """The solution."""
    return np.sin(K * x) * np.sin(K * y)


def gradient(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Its gradient."""
    return K * np.cos(K * x) * np.sin(K * y), K * np.sin(K * x) * np.cos(K * y)


def errors(mesh: MixedMesh) -> dict[str, float]:
    """Relative errors of the gradient and of the solution."""
    return laplace.errors(mesh, exact, gradient, lambda x, y: 2 * K**2 * exact(x, y))


SQUARE = Problem("Poisson's equation on a square", 1 / 20, domain, errors, {"H1": 0.5, "L2": 0.25})
