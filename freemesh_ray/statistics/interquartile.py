"""The interquartile mean: the mean of the middle half of the runs."""

from __future__ import annotations

import numpy as np

from envs.types import Floats


def interquartile_mean(values: Floats) -> Floats:
    """Mean of the middle half of the values along the last axis (Agarwal et al., section 4.3).

    Each of n values has the mass 1/n; a quarter of the mass is cut off at either end, so that at most two values count
    in part: of three, the outer ones count a quarter of the middle one. Where 4 divides n it is
    ``scipy.stats.trim_mean(values, 0.25)``, which elsewhere takes off less than a quarter.

    Args:
        values: (..., n), n >= 1, finite.

    Returns:
        (...) float64, between the least and the largest value.
    """
    ordered = np.sort(np.asarray(values, dtype=np.float64), axis=-1)
    return ordered @ weights(ordered.shape[-1])


def interquartile_mean_of_runs(scores: Floats) -> Floats:
    """The interquartile mean of all n m scores together: (..., n, m) -> (...)."""
    return interquartile_mean(scores.reshape(*scores.shape[:-2], -1))


def weights(n: int) -> Floats:
    """(n,) float64, sum 1: how much the values count, from the least to the largest.

    Value i covers [i, i + 1] of [0, n]; its weight is its overlap with the middle half, [n / 4, 3 n / 4].
    """
    ends = np.clip(np.arange(n + 1), 0.25 * n, 0.75 * n)
    return np.diff(ends) / (0.5 * n)
