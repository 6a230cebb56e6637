"""Probability of improvement: how likely a run of one algorithm beats a run of another."""

from __future__ import annotations

import numpy as np

from envs.types import Floats
from freemesh_ray.statistics.bootstrap import LEVEL, Interval, checked
from freemesh_ray.statistics.score_interval import design_effect, score_interval


def probability_of_improvement(x: Floats, y: Floats) -> Floats:
    """P(X > Y): for each domain U / (n_x n_y), Mann and Whitney's, ties counting half; then the mean over domains.

    Agarwal et al., section 4.3.

    Args:
        x: (..., n_x, m) scores of one algorithm.
        y: (..., n_y, m) scores of the other on the same domains.

    Returns:
        (...) float64 in [0, 1]; that of (y, x) is 1 minus it.
    """
    return wins(x, y).mean(axis=(-2, -1))


def wins(x: Floats, y: Floats) -> Floats:
    """(..., n_x, n_y): the share of domains on which each run of x beats each of y, ties counting half."""
    return 0.5 + 0.5 * np.sign(x[..., :, None, :] - y[..., None, :, :]).mean(axis=-1)


def improvement_interval(x: Floats, y: Floats, *, level: float = LEVEL) -> Interval:
    """P(X > Y) with its interval.

    On one domain it is that of Newcombe (2006, *Confidence intervals for an effect size measure based on the
    Mann-Whitney statistic*, part 2, Statistics in Medicine 25, method 5). On several, its variance is that of whole
    runs (`design_effect`; DeLong 1988). One run against one has none: it is the value itself.

    Args:
        x: (..., n_x, m) scores of one algorithm.
        y: (..., n_y, m) scores of the other on the same domains.
        level: confidence, in (0, 1).

    Raises:
        ValueError: scores that are not finite, or of different domains.
    """
    x, y = checked(x), checked(y)
    domains, n = x.shape[-1], (x.shape[-2], y.shape[-2])
    if domains != y.shape[-1]:
        raise ValueError(f"scores on {domains} and {y.shape[-1]} domains: give the same for both")
    value = probability_of_improvement(x, y)
    if n == (1, 1):
        return Interval(value, value, value)
    if domains == 1 or min(n) == 1:
        return score_interval(value, lambda p: newcombe_variance(p, *n), level=level)
    own = wins(x, y)
    estimated = own.mean(axis=-1).var(axis=-1, ddof=1) / n[0] + own.mean(axis=-2).var(axis=-1, ddof=1) / n[1]
    effect = design_effect(estimated, newcombe_variance(value, *n), domains)
    return score_interval(value, lambda p: newcombe_variance(p, *n), effect=effect, freedom=sum(n) - 2, level=level)


def newcombe_variance(p: Floats, n_x: int, n_y: int) -> Floats:
    """Variance of U / (n_x n_y) where P(X > Y) is p."""
    others = 0.5 * (n_x + n_y) - 1.0
    return p * (1.0 - p) * (1.0 + others * ((1.0 - p) / (2.0 - p) + p / (1.0 + p))) / (n_x * n_y)
