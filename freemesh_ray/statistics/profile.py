"""Performance profiles: the share of runs above each score."""

from __future__ import annotations

import numpy as np

from envs.types import Floats
from freemesh_ray.statistics.bootstrap import LEVEL, Interval, checked
from freemesh_ray.statistics.score_interval import design_effect, score_interval


def performance_profile(scores: Floats, thresholds: Floats, *, level: float = LEVEL) -> Interval:
    """Share of runs with a score above each threshold (score distribution of Agarwal et al., section 4.2).

    Args:
        scores: (..., n, m): n runs on each of m domains.
        thresholds: (k,).
        level: confidence of the band.

    Returns:
        (..., k) each, in [0, 1], never rising with the threshold; the band is pointwise: Wilson's interval, with
        several domains that of whole runs (`design_effect`, one for all thresholds). One run has none: it is the share
        itself.
    """
    scores = checked(scores)
    n, m = scores.shape[-2:]
    of_runs = (scores[..., None, :, :] > np.asarray(thresholds)[:, None, None]).mean(axis=-1)  # (..., k, n)
    value = of_runs.mean(axis=-1)
    if n == 1:
        return Interval(value, value, value)
    estimated, assumed = of_runs.var(axis=-1, ddof=1) / n, value * (1.0 - value) / n
    effect = design_effect(estimated.sum(axis=-1, keepdims=True), assumed.sum(axis=-1, keepdims=True), m)
    return score_interval(value, lambda p: p * (1.0 - p) / n, effect=effect, level=level)


def share(indicators: Floats) -> Floats:
    """The mean over runs and domains: (..., n, m) -> (...)."""
    return indicators.mean(axis=(-2, -1))
