"""How a report prints numbers and names."""

from __future__ import annotations

import math

from envs.types import Floats
from freemesh_ray.policies.evaluation import DETERMINISTIC, mode_and_figure
from freemesh_ray.statistics.aligned_curves import mean_and_deviation
from freemesh_ray.statistics.bootstrap import Interval


def final(metric: str) -> str:
    """A metric's final value: ``final return``, ``final stochastic score``."""
    mode, figure = mode_and_figure(metric)
    return f"final {'' if mode == DETERMINISTIC else mode + ' '}{figure.replace('_', ' ')}"


def spread(values: Floats, form: str) -> str:
    """Mean ± deviation over seeds of the finite values; of one seed its value, a dash of none."""
    known = values[[math.isfinite(value) for value in values]]
    if not len(known):
        return "-"
    mean, deviation = mean_and_deviation(known)
    return f"{mean:{form}} ± {deviation:{form}}" if len(known) > 1 else f"{mean:{form}}"


def bracketed(interval: Interval, form: str, runs: int) -> str:
    """Value [low, high]; of one seed the value alone; a dash when there is none."""
    if not math.isfinite(interval.value):
        return "-"
    if runs == 1:
        return format(interval.value, form)
    return f"{interval.value:{form}} [{interval.low:{form}}, {interval.high:{form}}]"


def thousands(steps: float) -> str:
    """Env steps in thousands: 41k."""
    return f"{steps / 1000:,.0f}k"


def span(low: float, high: float, form: str) -> str:
    """``low`` to ``high``, or one figure where they are the same."""
    first, last = format(low, form), format(high, form)
    return first if first == last else f"{first} to {last}"


def count(number: int, noun: str) -> str:
    """1 trial, 2 trials."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def hours(seconds: float) -> str:
    """A duration in the unit that suits it."""
    return f"{seconds / 3600:.1f} h" if seconds >= 3600 else f"{seconds / 60:.0f} min"
