from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from freemesh_ray.mesh_geometry import lagrange


@given(st.integers(1, 6), st.lists(st.floats(-1.0, 2.0), min_size=1, max_size=5), st.booleans())
def test_polynomials_of_the_order_are_reproduced_with_their_slopes(order: int, at: list[float], bunched: bool) -> None:
    stations = lagrange.equal(order)
    if bunched:
        stations = 0.5 - 0.5 * np.cos(np.pi * stations)
    p = np.polynomial.Polynomial(np.arange(1.0, order + 2.0) * (-1.0) ** np.arange(order + 1))
    places = np.array(at)
    np.testing.assert_allclose(lagrange.values(stations, places) @ p(stations), p(places), rtol=1e-9, atol=1e-8)
    slopes = lagrange.derivatives(stations, places) @ p(stations)
    np.testing.assert_allclose(slopes, p.deriv()(places), rtol=1e-9, atol=1e-7)


@pytest.mark.parametrize("count", range(1, 7))
def test_gauss_integrates_polynomials_of_twice_the_points(count: int) -> None:
    points, weights = lagrange.gauss(count)
    for power in range(2 * count):
        assert (weights * points**power).sum() == pytest.approx(1.0 / (power + 1), rel=1e-12)
