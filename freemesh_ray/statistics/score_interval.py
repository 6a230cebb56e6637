"""Intervals of shares and probabilities, which are bounded and whose spread is known from their value."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from envs.types import Floats
from freemesh_ray.statistics.bootstrap import LEVEL, Interval

#: Halvings of [0, 1] in search of an end, to 1e-12.
HALVINGS = 40


def score_interval(
    value: Floats,
    variance: Callable[[Floats], Floats],
    *,
    effect: Floats | float = 1.0,
    freedom: int | None = None,
    level: float = LEVEL,
) -> Interval:
    """All probabilities p that a value is not too far from: |value - p| <= q sqrt(effect variance(p)) (Wilson 1927).

    It is no point where the value is 0 or 1, as an interval from the spread of the runs would be.

    Args:
        value: (...), in [0, 1].
        variance: (...) -> (...): of the value, where its expectation is p.
        effect: (...), what the variance is multiplied by, see `design_effect`.
        freedom: degrees of freedom of an estimated ``effect``: q is Student's quantile; None: the normal's.
        level: confidence, in (0, 1).
    """
    value, tail = np.asarray(value, dtype=np.float64), 0.5 * (1 + level)
    quantile = float(norm.ppf(tail) if freedom is None else student.ppf(tail, freedom))
    ends = []
    for bound in (0.0, 1.0):
        near, far = value.copy(), np.full_like(value, bound)
        for _ in range(HALVINGS):
            middle = 0.5 * (near + far)
            holds = np.abs(value - middle) <= quantile * np.sqrt(effect * variance(middle))
            near, far = np.where(holds, middle, near), np.where(holds, far, middle)
        ends.append(near)
    return Interval(value, *ends)


def design_effect(estimated: Floats, assumed: Floats, domains: int) -> Floats:
    """The variance of a figure of whole runs by what it would be on one domain (Kish 1965), in [1 / domains, 1].

    Scores of one run on several domains say more than its score on one, and less than those of as many runs.

    Args:
        estimated: (...), the variance from the spread of whole runs.
        assumed: (...), that on one domain.
        domains: how many, >= 1.

    Returns:
        (...); 1 where nothing is known, as ``assumed`` is 0.
    """
    known = assumed > 0.0
    return np.clip(np.where(known, estimated, 1.0) / np.where(known, assumed, 1.0), 1.0 / domains, 1.0)
