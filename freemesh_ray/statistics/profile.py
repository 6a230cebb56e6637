"""Performance profiles: the share of runs above each score."""

from __future__ import annotations

import numpy as np

from envs.types import Floats
from freemesh_ray.statistics.bootstrap import LEVEL, RESAMPLES, Interval, checked, stratified_interval


def performance_profile(
    scores: Floats, thresholds: Floats, *, resamples: int = RESAMPLES, level: float = LEVEL, seed: int = 0
) -> Interval:
    """Share of runs with a score above each threshold (score distribution of Agarwal et al., section 4.2).

    Args:
        scores: (n, m): n runs in each of m strata.
        thresholds: (k,).
        resamples, level, seed: of the bootstrap.

    Returns:
        (k,) each, in [0, 1], never rising with the threshold; the band is pointwise.
    """
    above = (checked(scores) > np.asarray(thresholds)[:, None, None]).astype(np.float64)
    return stratified_interval(above, share, resamples=resamples, level=level, seed=seed)


def share(indicators: Floats) -> Floats:
    """The mean over runs and strata: (..., n, m) -> (...)."""
    return indicators.mean(axis=(-2, -1))
