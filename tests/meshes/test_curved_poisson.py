"""A solved problem's error falls at the order's rate where sides are curved, and does not where they are chords."""

from __future__ import annotations

import numpy as np
import pytest
from curved_meshes import blob, inside, jacobians, straight, unit_circle
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

from envs.mesh import Mesh
from freemesh_ray.meshes import lagrange
from freemesh_ray.meshes.high_order import HighOrder, high_order


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
