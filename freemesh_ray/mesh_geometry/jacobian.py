"""Whether curved elements are turned over anywhere: bounds of their Jacobian determinants.

The determinant of a map of order k is a polynomial of degree 2 k - 1 in each direction. It lies between the least and
the largest of its Bernstein coefficients, those at the corners are its values there, and halving the element brings the
coefficients closer to the polynomial (Johnen, Remacle, Geuzaine: Geometrical validity of curvilinear finite elements,
J. Comput. Phys. 233, 2013). So the sign is proved, not sampled.
"""

from __future__ import annotations

from functools import lru_cache
from math import comb

import numpy as np

from envs.types import Floats, Ints
from freemesh_ray.mesh_geometry import lagrange

#: How often an element is quartered at most until its coefficients say whether the determinant is positive.
QUARTERINGS = 6

#: Elements that are looked at together.
BLOCK = 10_000


def least_jacobian(nodes: Floats, elements: Ints, stations: Floats) -> Floats:
    """(m,) bounds from below of the Jacobian determinant over its mean, the element's area; 1 for a parallelogram.

    Above 0: it is positive everywhere. Below: it is not, but for elements that are 0 within 4^-6 or so.

    Args:
        nodes: (n, 2) float64.
        elements: (m, (k + 1)^2) int64, tensor-product order.
        stations: (k + 1,) of the nodes along a side, in [0, 1].
    """
    if not len(elements):
        return np.empty(0)
    blocks = [elements[i : i + BLOCK] for i in range(0, len(elements), BLOCK)]
    return np.concatenate([_bounds(coefficients(nodes[block], stations)) for block in blocks])


def coefficients(corners: Floats, stations: Floats) -> Floats:
    """(m, 2 k, 2 k) Bernstein coefficients of the determinants of elements, (m, (k + 1)^2, 2) nodes of each."""
    grid = corners.reshape(len(corners), len(stations), len(stations), 2)
    value, slope, bernstein = _sampling(tuple(stations))
    along = np.einsum("pi,qj,mjic->mqpc", slope, value, grid, optimize=True)
    across = np.einsum("pi,qj,mjic->mqpc", value, slope, grid, optimize=True)
    determinant = along[..., 0] * across[..., 1] - along[..., 1] * across[..., 0]
    return np.einsum("ap,bq,mqp->mba", bernstein, bernstein, determinant, optimize=True)


def _bounds(found: Floats) -> Floats:
    """(m,) bounds over means of (m, d + 1, d + 1) coefficients, quartered until they say the sign."""
    mean = np.abs(found.mean(axis=(1, 2)))
    least = found.min(axis=(1, 2))
    halves = _halves(found.shape[1] - 1)
    owner = np.arange(len(found))
    for _ in range(QUARTERINGS):
        at_corners = np.full(len(least), np.inf)
        np.minimum.at(at_corners, owner, found[:, [0, 0, -1, -1], [0, -1, 0, -1]].min(axis=1))
        open_ = (least <= 0.0) & (at_corners > 0.0)
        # Of an element whose sign is open all quarters are kept: the least of them bounds it.
        kept = open_[owner]
        if not kept.any():
            break
        parts = [np.einsum("ab,cd,mbd->mac", v, h, found[kept], optimize=True) for v in halves for h in halves]
        found, owner = np.concatenate(parts), np.tile(owner[kept], 4)
        least[open_] = np.inf
        np.minimum.at(least, owner, found.min(axis=(1, 2)))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(mean > 0.0, least / mean, -np.inf)


@lru_cache(maxsize=16)
def _sampling(stations: tuple[float, ...]) -> tuple[Floats, Floats, Floats]:
    """At 2 k points of a direction: the values of its polynomials, their slopes, what makes coefficients of values."""
    at = np.array(stations)
    degree = 2 * (len(at) - 1) - 1
    points = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree)
    basis = [comb(degree, i) * points**i * (1.0 - points) ** (degree - i) for i in range(degree + 1)]
    return lagrange.values(at, points), lagrange.derivatives(at, points), np.linalg.inv(np.stack(basis, axis=1))


@lru_cache(maxsize=16)
def _halves(degree: int) -> tuple[Floats, Floats]:
    """What makes of coefficients over [0, 1] those over the first half, and over the second (de Casteljau)."""
    first = np.array([[comb(i, j) / 2.0**i if j <= i else 0.0 for j in range(degree + 1)] for i in range(degree + 1)])
    return first, first[::-1, ::-1].copy()
