"""The permutation test of two algorithms' runs, and Holm's correction where several are made."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import comb

import numpy as np
from scipy.stats import rankdata

from envs.types import Floats

#: Permutations of the runs that are enumerated at most, for an exact p-value; of more, as many are drawn.
PERMUTATIONS = 20_000


def p_value(x: Floats, y: Floats, seed: int = 0) -> float:
    """How often runs of equal algorithms would favour x as clearly or more: one-sided permutation test of P(X > Y).

    All permutations are enumerated where there are at most `PERMUTATIONS` (exact), else as many are drawn. With three
    runs against three the least that it can be is 1/20, with ten against three 1/286.

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


def two_sided(x: Floats, y: Floats, seed: int = 0) -> float:
    """How often runs of equal algorithms would differ as clearly or more, in either order: twice the smaller side."""
    return min(1.0, 2.0 * min(p_value(x, y, seed), p_value(y, x, seed)))


def holm(p_values: Sequence[float]) -> list[float]:
    """p-values corrected for their number: with a level on all, how likely one is below it by chance is at most that.

    Holm (1979), *A simple sequentially rejective multiple test procedure*, Scandinavian Journal of Statistics 6. The
    smallest of k is multiplied by k, the next by k - 1, and so on; none is smaller than the one before, nor above 1.
    """
    p = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(p, kind="stable")
    steps = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)) if len(p) else p
    corrected = np.empty_like(p)
    corrected[order] = np.minimum(steps, 1.0)
    return corrected.tolist()
