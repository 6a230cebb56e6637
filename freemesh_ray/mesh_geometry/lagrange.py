"""Polynomials through values at stations of [0, 1], along one direction of an element."""

from __future__ import annotations

import numpy as np

from envs.types import Floats


def equal(order: int) -> Floats:
    """(order + 1,) stations as far apart as each other, as Gmsh, VTK and Abaqus have them."""
    return np.arange(order + 1) / order


def values(stations: Floats, places: Floats) -> Floats:
    """(p, k + 1): what each of the k + 1 polynomials, 1 at its station and 0 at the others, is at (p,) places."""
    factors = factors_of(stations, places)
    return np.stack([np.prod(np.delete(row, i, axis=-1), axis=-1) for i, row in enumerate(factors)], axis=-1)


def derivatives(stations: Floats, places: Floats) -> Floats:
    """(p, k + 1): their derivatives at (p,) places."""
    factors = factors_of(stations, places)
    found = np.zeros((len(places), len(stations)))
    for i, row in enumerate(factors):
        for j in range(len(stations)):
            if j != i:
                others = np.prod(np.delete(row, [i, j], axis=-1), axis=-1)
                found[:, i] += others / (stations[i] - stations[j])
    return found


def factors_of(stations: Floats, places: Floats) -> Floats:
    """(k + 1, p, k + 1): [i, :, j] is (x - station j) / (station i - station j); what j = i is means nothing."""
    apart = stations[:, None] - stations[None, :]
    np.fill_diagonal(apart, 1.0)
    return (places[None, :, None] - stations[None, None, :]) / apart[:, None, :]


def gauss(count: int) -> tuple[Floats, Floats]:
    """Gauss's points of [0, 1] and their weights, (count,) each."""
    points, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (points + 1.0), 0.5 * weights
