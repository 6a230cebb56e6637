"""A solved problem's error falls at the order's rate where sides are curved, and does not where they are chords."""

from __future__ import annotations

import numpy as np
import pytest
from curved_meshes import blob, inside, jacobians, straight, unit_circle
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

from freemesh_ray.mesh_geometry import lagrange
from freemesh_ray.mesh_geometry.high_order import HighOrder, high_order


def solution(p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """u = (1 - r^2) exp(x), its gradient, and -div grad u; u is 0 on the unit circle."""
    x, y = p[..., 0], p[..., 1]
    e, w = np.exp(x), 1 - x * x - y * y
    return w * e, np.stack([(w - 2 * x) * e, -2 * y * e], axis=-1), -(w - 4 * x - 4) * e


def solved(mesh: HighOrder) -> tuple[float, float]:
    """The errors in L2 and in the gradient of the problem solved with u = 0 on the boundary, by its own nodes."""
    k = mesh.order
    points, weights = lagrange.gauss(k + 2)
    value, slope = lagrange.values(mesh.stations, points), lagrange.derivatives(mesh.stations, points)
    shape = (len(points) ** 2, (k + 1) ** 2)
    u = np.einsum("pi,qj->qpji", value, value).reshape(shape)
    local = np.stack([
        np.einsum("pi,qj->qpji", slope, value).reshape(shape), np.einsum("pi,qj->qpji", value, slope).reshape(shape)
    ])  # fmt: skip
    places, jacobian, determinant = jacobians(mesh, points)
    gradient = np.einsum("dgn,mgdc->mgnc", local, np.linalg.inv(jacobian))
    scale = np.outer(weights, weights).ravel() * determinant
    exact, slopes, load = solution(places)
    stiffness = np.einsum("mg,mgac,mgbc->mab", scale, gradient, gradient, optimize=True)
    n, e = len(mesh.nodes), mesh.elements
    rows, columns = np.repeat(e, e.shape[1], axis=1), np.tile(e, (1, e.shape[1]))
    whole = coo_matrix((stiffness.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n)).tocsr()
    right = np.bincount(e.ravel(), (np.einsum("mg,gn->mn", scale * load, u)).ravel(), minlength=n)
    free = np.ones(n, dtype=bool)
    free[boundary_nodes(mesh)] = False
    found = np.zeros(n)
    found[free] = spsolve(whole[free][:, free].tocsc(), right[free])
    off = found[e] @ u.T - exact
    tilted = np.einsum("mn,mgnc->mgc", found[e], gradient) - slopes
    return float(np.sqrt((scale * off**2).sum())), float(np.sqrt((scale[..., None] * tilted**2).sum()))


def boundary_nodes(mesh: HighOrder) -> np.ndarray:
    k = mesh.order
    g = mesh.grid
    every = np.concatenate([g[:, 0], g[:, :, k], g[:, k], g[:, :, 0]])
    _, which, counts = np.unique(np.sort(every, axis=1), axis=0, return_inverse=True, return_counts=True)
    return np.unique(every[counts[which.ravel()] == 1])


def rate(order: int, with_curves: bool, coarse: int = 4, fine: int = 8) -> np.ndarray:
    """By what power of the size the two errors fall."""
    meshes = [inside(unit_circle(), n) for n in (coarse, fine)]
    errors = [np.array(solved(high_order(mesh if with_curves else straight(mesh), order))) for mesh in meshes]
    return np.log(errors[0] / errors[1]) / np.log(fine / coarse)


@pytest.mark.parametrize("order", [2, 3, 4])
def test_errors_fall_at_the_orders_rates_with_curved_sides(order: int) -> None:
    in_l2, in_h1 = rate(order, with_curves=True)
    assert in_l2 >= order + 1 - 0.35
    assert in_h1 >= order - 0.2


@pytest.mark.parametrize("order", [2, 3, 4])
def test_and_at_second_order_with_chords(order: int) -> None:
    in_l2, in_h1 = rate(order, with_curves=False)
    assert in_l2 <= 2.1
    assert in_h1 <= 1.6


def test_scikit_fem_solves_the_elements_of_nine_nodes_with_the_same_error() -> None:
    skfem = pytest.importorskip("skfem")
    import meshio
    from skfem.helpers import dot, grad
    from skfem.io import from_meshio

    mesh = high_order(inside(unit_circle(), 4), 2)
    nine = mesh.elements[:, [0, 2, 8, 6, 1, 5, 7, 3, 4]]
    read = from_meshio(meshio.Mesh(mesh.nodes, [("quad9", nine)]))
    basis = skfem.Basis(read, skfem.ElementQuad2(), intorder=7)

    @skfem.BilinearForm
    def stiffness(u, v, _):  # type: ignore[no-untyped-def]
        return dot(grad(u), grad(v))

    @skfem.LinearForm
    def load(v, w):  # type: ignore[no-untyped-def]
        return solution(np.moveaxis(w.x, 0, -1))[2] * v

    @skfem.Functional
    def squared(w):  # type: ignore[no-untyped-def]
        return (w.u - solution(np.moveaxis(w.x, 0, -1))[0]) ** 2

    found = skfem.solve(*skfem.condense(stiffness.assemble(basis), load.assemble(basis), D=basis.get_dofs().flatten()))
    error = float(np.sqrt(squared.assemble(basis, u=basis.interpolate(found))))
    assert error == pytest.approx(solved(mesh)[0], rel=1e-3)


def test_interpolation_on_a_spline_has_the_full_order() -> None:
    """A smooth function through the nodes of curved elements, at twice as many."""
    for order in (2, 3, 4):
        errors = []
        for n in (7, 14):
            mesh = high_order(inside(blob(), n, core=0.4), order)
            points, weights = lagrange.gauss(order + 2)
            places, _, determinant = jacobians(mesh, points)
            value = lagrange.values(mesh.stations, points)
            u = np.einsum("pi,qj->qpji", value, value).reshape(len(points) ** 2, -1)
            off = solution(mesh.nodes)[0][mesh.elements] @ u.T - solution(places)[0]
            errors.append(np.sqrt((np.outer(weights, weights).ravel() * determinant * off**2).sum()))
        assert np.log2(errors[0] / errors[1]) >= order + 1 - 0.35
