"""Intervals by the stratified percentile bootstrap."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from envs.types import Floats, Ints

RESAMPLES, LEVEL = 2000, 0.95
#: Scores that are resampled at a time, 8 bytes each: bounds the memory.
AT_A_TIME = 4_000_000

#: From scores (..., n, m) to their figure (...).
Statistic = Callable[[Floats], Floats]


class Interval(NamedTuple):
    """A statistic and where it lies.

    Attributes:
        value: of the scores themselves, (...) float64; a float-like array of no axes for a single figure.
        low, high: ends of the interval, of the same shape. Equal to ``value`` when there is one run only.
    """

    value: Floats
    low: Floats
    high: Floats


def stratified_interval(
    scores: Floats, statistic: Statistic, *, resamples: int = RESAMPLES, level: float = LEVEL, seed: int = 0
) -> Interval:
    """A statistic with its stratified percentile bootstrap interval (Agarwal et al., section 4.1 and appendix A.3).

    In each stratum n runs are drawn with replacement from its n; the interval reaches from the (1 - level) / 2 to the
    (1 + level) / 2 quantile of the statistic over the resamples. Leading axes share the draws.

    Args:
        scores: (..., n, m): n runs in each of m strata, n >= 1, finite.
        statistic: (..., n, m) -> (...), free to treat the leading axes at once.
        resamples: how many, >= 1.
        level: confidence, in (0, 1).
        seed: of the draws; the same seed gives the same interval.

    Raises:
        ValueError: no run, or a score that is not finite.
    """
    scores = checked(scores)
    random = np.random.default_rng(seed)
    strata = np.arange(scores.shape[-1])
    step = max(1, AT_A_TIME // scores.size)
    found = []
    for begin in range(0, resamples, step):
        drawn = draws(random, min(step, resamples - begin), scores)
        found.append(statistic(scores[..., drawn, strata]))
    return percentile_interval(statistic(scores), np.concatenate(found, axis=-1), level)


def draws(random: np.random.Generator, count: int, scores: Floats) -> Ints:
    """(count, n, m) int64: which run takes each place in each resample."""
    n, m = scores.shape[-2:]
    return random.integers(n, size=(count, n, m))


def percentile_interval(value: Floats, resampled: Floats, level: float) -> Interval:
    """The value with quantiles of its resamples, the last axis of ``resampled``."""
    low, high = np.quantile(resampled, [0.5 * (1 - level), 0.5 * (1 + level)], axis=-1)
    return Interval(np.asarray(value), low, high)


def checked(scores: Floats) -> Floats:
    """The scores as float64.

    Raises:
        ValueError: no run or no stratum, or a score that is not finite.
    """
    scores = np.asarray(scores, dtype=np.float64)
    if scores.ndim < 2 or not scores.size:
        raise ValueError(f"scores have shape {scores.shape}: give (runs, strata), at least one of each")
    if not np.isfinite(scores).all():
        raise ValueError("scores are not all finite: leave such runs out")
    return scores
