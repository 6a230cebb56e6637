"""Whether two algorithms score the same within a tenth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from envs.types import Floats
from freemesh_ray.statistics.bootstrap import LEVEL, Interval

#: Of the baseline's mean score: how far an algorithm that scores the same may be from it.
MARGIN = 0.1


class Difference(NamedTuple):
    """How far the mean score of an algorithm lies above a baseline's.

    Attributes:
        interval: of the difference, in the scores' unit; NaN ends where a side has one run.
        margin: `MARGIN` times the magnitude of the baseline's mean.
    """

    interval: Interval
    margin: float

    @property
    def same(self) -> bool:
        """Whether the interval contains zero and lies within the margin."""
        _, low, high = self.interval
        return bool(-self.margin <= low <= 0.0 <= high <= self.margin)

    @property
    def shares(self) -> Interval:
        """The interval as shares of the magnitude of the baseline's mean; not finite where that is 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return Interval(*(np.divide(end, self.margin / MARGIN) for end in self.interval))


def difference(x: Floats, baseline: Floats, *, level: float = LEVEL) -> Difference:
    """The difference of two means, with Welch's t-interval (1947): the runs are the units, their spreads may differ.

    Args:
        x: (n_x,) scores of an algorithm, one a run.
        baseline: (n_y,) those of the baseline.
        level: confidence, in (0, 1).
    """
    value, margin = np.asarray(x.mean() - baseline.mean()), MARGIN * abs(float(baseline.mean()))
    if min(len(x), len(baseline)) < 2:
        nothing = np.array(np.nan)
        return Difference(Interval(value, nothing, nothing), margin)
    parts = np.array([runs.var(ddof=1) / len(runs) for runs in (x, baseline)])
    if not parts.any():
        return Difference(Interval(value, value, value), margin)
    freedom = parts.sum() ** 2 / np.sum(parts**2 / (len(x) - 1, len(baseline) - 1))
    half = student.ppf(0.5 * (1 + level), freedom) * np.sqrt(parts.sum())
    return Difference(Interval(value, value - half, value + half), margin)
