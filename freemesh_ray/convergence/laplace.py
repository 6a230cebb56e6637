"""Poisson's equation with a known solution: the errors of bilinear elements."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import skfem
from skfem.helpers import dot, grad

from envs.types import Floats
from freemesh_ray.compare.mixed_mesh import MixedMesh
from freemesh_ray.convergence.bases import bases, integral, matrix, solved, vector

#: A function of x and y.
Scalar = Callable[[Floats, Floats], Floats]
#: From x and y to the two components of a gradient.
Gradient = Callable[[Floats, Floats], tuple[Floats, Floats]]


@skfem.BilinearForm
def _stiffness(u, v, w):  # type: ignore[no-untyped-def]
    return dot(grad(u), grad(v))


def errors(mesh: MixedMesh, exact: Scalar, gradient: Gradient, source: Scalar | None) -> dict[str, float]:
    """Relative errors of the solution of - Laplace u = source whose boundary values are the exact solution's.

    Args:
        mesh: of the domain.
        exact: the solution; it is taken at the boundary's vertices.
        gradient: its gradient.
        source: None for none.

    Returns:
        ``H1``: of the gradient; ``L2``: of the solution.
    """
    on = bases(mesh)
    x, y = mesh.vertices.T
    force = skfem.LinearForm(lambda v, w: v * source(*w.x) if source else 0 * v)
    u = solved(matrix(_stiffness, on), exact(x, y), vector(force, on), np.unique(mesh.segments))

    def missed(w):  # type: ignore[no-untyped-def]
        gx, gy = gradient(*w.x)
        return (w.u.grad[0] - gx) ** 2 + (w.u.grad[1] - gy) ** 2

    def whole(w):  # type: ignore[no-untyped-def]
        gx, gy = gradient(*w.x)
        return gx**2 + gy**2

    of = {
        "missed": missed,
        "whole": whole,
        "off": lambda w: (w.u - exact(*w.x)) ** 2,
        "size": lambda w: exact(*w.x) ** 2,
    }
    sums = {name: integral(skfem.Functional(form), on, u) for name, form in of.items()}
    return {"H1": (sums["missed"] / sums["whole"]) ** 0.5, "L2": (sums["off"] / sums["size"]) ** 0.5}
