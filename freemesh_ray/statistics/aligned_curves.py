"""Learning curves: brought to common steps, and what they say in single figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from envs.types import Floats

#: One run's curve: steps and values, of one length.
Curve = tuple[ArrayLike, ArrayLike]

#: Share of the training whose evaluations are a run's final value. One evaluation of ten episodes is noisy, and the
#: best one would reward noise; a longer share would measure how fast a run learnt.
FINAL_SHARE = 0.1


def aligned(curves: Sequence[Curve]) -> tuple[Floats, Floats]:
    """Curves of several runs on common steps: interpolated where all have values, nowhere beyond.

    Args:
        curves: of each run; steps may differ and be in any order, values that are not finite are left out.

    Returns:
        Steps (t,), rising, all those of any run that every run covers; values (runs, t). Runs without a single finite
        value are left out; t is 0 where the others have no step in common.
    """
    clean = [cleaned(*curve) for curve in curves]
    clean = [(x, y) for x, y in clean if len(x)]
    if not clean:
        return np.empty(0), np.empty((0, 0))
    first, last = max(x[0] for x, _ in clean), min(x[-1] for x, _ in clean)
    grid = np.unique(np.concatenate([x for x, _ in clean]))
    grid = grid[(grid >= first) & (grid <= last)]
    return grid, np.array([np.interp(grid, x, y) for x, y in clean])


def cleaned(steps: ArrayLike, values: ArrayLike) -> tuple[Floats, Floats]:
    """The finite points of a curve in the order of their steps, each (t,)."""
    x, y = np.asarray(steps, dtype=np.float64), np.asarray(values, dtype=np.float64)
    known = np.isfinite(x) & np.isfinite(y)
    order = np.argsort(x[known], kind="stable")
    return x[known][order], y[known][order]


def final_value(steps: ArrayLike, values: ArrayLike) -> float:
    """Mean of the evaluations of the last tenth of a training, from 90 % of its steps on; NaN when there are none.

    Args:
        steps: (t,), of the evaluations, rising; the training ends with the last one.
        values: (t,).
    """
    x, y = np.asarray(steps, dtype=np.float64), np.asarray(values, dtype=np.float64)
    return float(y[x >= (1.0 - FINAL_SHARE) * x[-1]].mean()) if len(x) else float("nan")


def steps_to(steps: ArrayLike, values: ArrayLike, threshold: float) -> float | None:
    """Sample efficiency: the steps at which a curve first reaches a value; None when it never does.

    Between two evaluations the curve is taken as straight. A curve that begins there gives its first step.

    Args:
        steps: (t,), rising.
        values: (t,).
        threshold: the value to reach.
    """
    x, y = np.asarray(steps, dtype=np.float64), np.asarray(values, dtype=np.float64)
    reached = np.flatnonzero(y >= threshold)
    if not len(reached):
        return None
    i = int(reached[0])
    if i == 0:
        return float(x[0])
    return float(x[i - 1] + (x[i] - x[i - 1]) * (threshold - y[i - 1]) / (y[i] - y[i - 1]))


def mean_over_training(steps: ArrayLike, values: ArrayLike) -> float:
    """Area under a curve by its span (trapezoidal rule), in the values' unit; of a single point its value.

    Args:
        steps: (t,), rising, t >= 1.
        values: (t,).
    """
    x, y = np.asarray(steps, dtype=np.float64), np.asarray(values, dtype=np.float64)
    return float(np.trapezoid(y, x) / (x[-1] - x[0])) if len(x) > 1 else float(y[0])


def mean_and_deviation(values: ArrayLike) -> tuple[float, float]:
    """Mean and sample deviation (n - 1) over runs; the deviation of one run is NaN."""
    y = np.asarray(values, dtype=np.float64)
    return float(y.mean()), float(y.std(ddof=1)) if len(y) > 1 else float("nan")
