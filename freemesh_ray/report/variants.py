"""What came of every variant: its seeds' learning curves with their band, and the figures of their ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from envs.types import Floats
from freemesh_ray.policies.evaluation import COMPLETION, ELEMENTS, QUALITY, RETURN, STOCHASTIC_RETURN
from freemesh_ray.report.results import Results, TrialResult
from freemesh_ray.statistics.aligned_curves import aligned, final_value, mean_over_training, steps_to
from freemesh_ray.statistics.bootstrap import EVERYTHING, Interval, interquartile_interval

#: Metrics that have a curve each, in the order of tables.
CURVES = (RETURN, STOCHASTIC_RETURN, COMPLETION)
#: What rates and scores cannot leave.
SHARES = (0.0, 1.0)
#: The completion rate that counts as learnt.
COMPLETED = 0.9
#: Metrics that have a final value each.
FINALS = (*CURVES, QUALITY, ELEMENTS)


@dataclass(frozen=True)
class Band:
    """A metric over training.

    Attributes:
        steps: (t,) env steps that all seeds cover.
        seeds: (n, t) values there.
        iqm: (t,) interquartile mean over the seeds with its interval; t may be 0.
    """

    steps: Floats
    seeds: Floats
    iqm: Interval


@dataclass(frozen=True)
class VariantResult:
    """One variant.

    Attributes:
        label: its name.
        trials: all of them.
        used: those that its figures are of: the finished ones, or before there is one those with an evaluation.
        bands: metric -> its curve.
        finals: metric -> (n,) each seed's mean over the last tenth of its training, in the order of ``used``.
        metric: what the study's variants are judged by.
    """

    label: str
    trials: Sequence[TrialResult]
    used: Sequence[TrialResult]
    bands: dict[str, Band]
    finals: dict[str, Floats]
    metric: str

    @property
    def final_metric(self) -> Floats:
        """(n,) the seeds' finite final values of the metric."""
        values = self.finals[self.metric]
        return values[np.isfinite(values)]

    @property
    def final_return(self) -> Interval:
        """Interquartile mean of the seeds' final returns with its interval; NaN before the first evaluation."""
        return iqm_interval(self.finals[RETURN])

    @property
    def provisional(self) -> bool:
        """Whether its figures are of trainings that are not finished."""
        return any(not trial.finished for trial in self.used)

    @property
    def under_way(self) -> bool:
        """Whether trials may still add to its figures."""
        return any(trial.under_way for trial in self.trials)

    def mean_over_training(self) -> Floats:
        """(n,) each seed's mean return over its training: the area under its curve by its span."""
        return np.array([mean_over_training(*trial.curve(RETURN)) for trial in self.used])

    def steps_to(self, threshold: float) -> tuple[float | None, list[float | None]]:
        """Env steps until the curve of all seeds, and that of each, first reaches a return; None for never."""
        band = self.bands[RETURN]
        each = [steps_to(*trial.curve(RETURN), threshold) for trial in self.used]
        return steps_to(band.steps, band.iqm.value, threshold), each

    def to_completion(self) -> list[tuple[float, float]]:
        """Env steps and seconds until each seed's curve first reaches a completion rate of `COMPLETED`.

        Infinite where it never does; the seconds NaN where they are not known.
        """
        found = []
        for trial in self.used:
            steps, rates = trial.curve(COMPLETION)
            reached = steps_to(steps, rates, COMPLETED)
            if reached is None:
                found.append((math.inf, math.inf))
            else:
                found.append((reached, float(np.interp(reached, steps, trial.curve("seconds")[1]))))
        return found


def variant_results(results: Results) -> list[VariantResult]:
    """Every variant in the study's order; the same intervals every time."""
    return [_result(label, results.of(label), results.study.metric) for label in results.labels]


def _result(label: str, trials: Sequence[TrialResult], metric: str) -> VariantResult:
    begun = [trial for trial in trials if trial.evaluations and trial.status != "failed"]
    used = [trial for trial in begun if trial.finished] or begun
    bands = {
        name: band([trial.curve(name) for trial in used], SHARES if name == COMPLETION else EVERYTHING)
        for name in CURVES
    }
    finals = {name: np.array([final_value(*trial.curve(name)) for trial in used]) for name in {*FINALS, metric}}
    return VariantResult(label, trials, used, bands, finals, metric)


def band(curves: Sequence[tuple[Floats, Floats]], bounds: tuple[float, float] = EVERYTHING) -> Band:
    """The curves of several seeds on common steps, of a metric within ``bounds``."""
    steps, seeds = aligned(curves)
    if not seeds.size:
        nothing = np.empty(0)
        return Band(nothing, np.empty((0, 0)), Interval(nothing, nothing, nothing))
    # Whole runs are drawn, the same at every step.
    return Band(steps, seeds, interquartile_interval(seeds.T[:, :, None], bounds=bounds))


def iqm_interval(scores: Floats, bounds: tuple[float, float] = EVERYTHING) -> Interval:
    """The interquartile mean of the finite scores, (n,) or (n, m), with its interval; NaN when there are none.

    Whole rows are left out, and drawn: a seed's scores on all domains. Scores are within ``bounds``.
    """
    scores = scores[:, None] if scores.ndim == 1 else scores
    scores = scores[np.isfinite(scores).all(axis=1)]
    if not scores.size:
        nothing = np.array(math.nan)
        return Interval(nothing, nothing, nothing)
    return interquartile_interval(scores, bounds=bounds)


def return_threshold(variants: Sequence[VariantResult]) -> float:
    """The return at which sample efficiency is measured: half the best variant's final interquartile mean.

    Where that is not above 0, midway to it from the mean of all seeds' first evaluations; NaN without any.
    """
    first = [float(trial.curve(RETURN)[1][0]) for variant in variants for trial in variant.used]
    if not first:
        return math.nan
    best = max(float(variant.final_return.value) for variant in variants if variant.used)
    return 0.5 * (best + (0.0 if best > 0.0 else float(np.mean(first))))
