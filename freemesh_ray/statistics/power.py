"""How many seeds a comparison would need, if what a few of them show is what is the case."""

from __future__ import annotations

import numpy as np
from scipy.stats import mannwhitneyu, norm
from scipy.stats import t as student

from envs.types import Floats
from freemesh_ray.statistics.bootstrap import LEVEL

#: How likely as many seeds as are said reach a verdict.
POWER = 0.8
#: More seeds of each than this are not counted.
MOST = 100
#: Trainings of each that are simulated.
SIMULATIONS = 1000
#: Runs of each above which the test of a simulation is approximate.
EXACT = 25


def seeds_to_separate(x: Floats, y: Floats, level: float, seed: int = 0) -> int | None:
    """Seeds of each side with which the one that is ahead passes the one-sided permutation test, at `POWER`.

    Simulated: scores are normal, as far apart as the means, with the pooled deviation.

    Args:
        x, y: (n_x,), (n_y,) scores, one a run, at least two of each.
        level: that the p-value must not exceed.
        seed: of the simulation.

    Returns:
        At least 2, or None: more than `MOST`.
    """
    freedom = len(x) + len(y) - 2
    spread = np.sqrt(((len(x) - 1) * x.var(ddof=1) + (len(y) - 1) * y.var(ddof=1)) / freedom)
    apart = abs(x.mean() - y.mean())
    random = np.random.default_rng(seed)
    ahead, behind = spread * random.normal(size=(2, SIMULATIONS, MOST)) + np.array([apart, 0.0])[:, None, None]

    def enough(n: int) -> bool:
        method = "exact" if n <= EXACT else "asymptotic"
        p = mannwhitneyu(ahead[:, :n], behind[:, :n], alternative="greater", axis=1, method=method).pvalue
        return bool(np.mean(p <= level) >= POWER)

    if not apart or not enough(MOST):
        return None
    low, high = 1, MOST  # too few, enough
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


def seeds_to_equate(x: Floats, baseline: Floats, margin: float) -> int | None:
    """Seeds of each side with which equal means come out as the same, at `POWER`: `equivalence.Difference.same`.

    With n seeds the standard error is e = sqrt((s_x^2 + s_y^2) / n), and the interval is the difference plus and minus
    t e. The difference must lie within both margin - t e and t e; it is normal, with mean 0 and deviation e.

    Args:
        x, baseline: (n_x,), (n_y,) scores, one a run, at least two of each.
        margin: how far the means may lie apart.

    Returns:
        At least 2, or None: more than `MOST`.
    """
    n = np.arange(2, MOST + 1)
    error = np.sqrt((x.var(ddof=1) + baseline.var(ddof=1)) / n)
    half = student.ppf(0.5 * (1 + LEVEL), 2 * n - 2) * error
    enough = np.minimum(half, margin - half) >= norm.ppf(0.5 * (1 + POWER)) * error
    return int(n[np.argmax(enough)]) if enough.any() else None
