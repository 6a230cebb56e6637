"""Probability of improvement: how likely a run of one algorithm beats a run of another."""

from __future__ import annotations

from enum import StrEnum
from itertools import combinations
from math import comb

import numpy as np
from scipy.stats import rankdata

from envs.types import Floats
from freemesh_ray.statistics.bootstrap import LEVEL, RESAMPLES, Interval, checked, draws, percentile_interval

#: Permutations of the runs that are enumerated at most, for an exact p-value; of more, as many are drawn.
PERMUTATIONS = 20_000
#: A verdict needs a one-sided p-value of at most this.
SIGNIFICANT = 0.05


class Verdict(StrEnum):
    """What the runs say on an expectation."""

    CONFIRMED = "confirmed"
    REFUTED = "refuted"
    UNDECIDED = "undecided"


def probability_of_improvement(x: Floats, y: Floats) -> Floats:
    """P(X > Y): for each stratum U / (n_x n_y), Mann and Whitney's, ties counting half; then the mean over strata.

    Agarwal et al., section 4.3.

    Args:
        x: (..., n_x, m) scores of one algorithm.
        y: (..., n_y, m) scores of the other on the same strata.

    Returns:
        (...) float64 in [0, 1]; that of (y, x) is 1 minus it.
    """
    ahead = np.sign(x[..., :, None, :] - y[..., None, :, :])
    return 0.5 + 0.5 * ahead.mean(axis=(-3, -2, -1))


def improvement_interval(
    x: Floats, y: Floats, *, resamples: int = RESAMPLES, level: float = LEVEL, seed: int = 0
) -> Interval:
    """P(X > Y) with its stratified bootstrap interval; both algorithms' runs are drawn anew, each on its own.

    Args:
        x: (n_x, m) scores of one algorithm.
        y: (n_y, m) scores of the other on the same strata.
        resamples, level, seed: of the bootstrap.

    Raises:
        ValueError: scores that are not finite, or of different strata.
    """
    x, y = checked(x), checked(y)
    if x.shape[1] != y.shape[1]:
        raise ValueError(f"scores on {x.shape[1]} and {y.shape[1]} strata: give the same for both")
    random, strata = np.random.default_rng(seed), np.arange(x.shape[1])
    drawn = (scores[draws(random, resamples, scores), strata] for scores in (x, y))
    return percentile_interval(probability_of_improvement(x, y), probability_of_improvement(*drawn), level)


def p_value(x: Floats, y: Floats, seed: int = 0) -> float:
    """How often runs of equal algorithms would favour x as clearly or more: one-sided permutation test of P(X > Y).

    All permutations are enumerated where there are at most `PERMUTATIONS` (exact), else as many are drawn. With three
    runs against three the least that it can be is 1/20.

    Args:
        x: (n_x,) scores of one algorithm.
        y: (n_y,) scores of the other.
        seed: of the draws.
    """
    ranks = rankdata(np.concatenate([x, y]))  # P(X > Y) rises with the sum of x's ranks
    observed = ranks[: len(x)].sum()
    if comb(len(ranks), len(x)) <= PERMUTATIONS:
        orders = np.array(list(combinations(ranks, len(x))))
        return float(np.mean(orders.sum(axis=1) >= observed))
    drawn = np.random.default_rng(seed).permuted(np.tile(ranks, (PERMUTATIONS, 1)), axis=1)[:, : len(x)]
    # The permutation that was observed counts, too (Phipson and Smyth 2010).
    return float((1 + np.sum(drawn.sum(axis=1) >= observed)) / (1 + PERMUTATIONS))


def verdict(x: Floats, y: Floats, *, seed: int = 0) -> Verdict:
    """Whether runs confirm that x is better than y.

    Confirmed: the interval of P(X > Y) lies wholly above one half. Refuted: wholly below. Percentile intervals of very
    few runs are too narrow, so that the p-value must also be at most `SIGNIFICANT`.

    Args:
        x: (n_x,) scores of the one expected to be better.
        y: (n_y,) scores of the other.
        seed: of the draws.
    """
    interval = improvement_interval(x[:, None], y[:, None], seed=seed)
    if interval.low > 0.5 and p_value(x, y, seed) <= SIGNIFICANT:
        return Verdict.CONFIRMED
    if interval.high < 0.5 and p_value(y, x, seed) <= SIGNIFICANT:
        return Verdict.REFUTED
    return Verdict.UNDECIDED
