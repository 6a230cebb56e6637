"""How every variant learnt: its seeds' curves with their band, and the figures of their ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from envs.types import Floats
from freemesh_ray.report.results import RETURN, Results, Trial
from freemesh_ray.statistics.bootstrap import Interval, stratified_interval
from freemesh_ray.statistics.curves import aligned, final_score, mean_over_training, steps_to
from freemesh_ray.statistics.interquartile import interquartile_mean_of_runs

STOCHASTIC = "eval_stochastic/return"
COMPLETION = "eval_deterministic/completion_rate"
QUALITY, ELEMENTS = "eval_deterministic/element_quality", "eval_deterministic/elements"

#: Figures that have a curve each, in the order of tables.
CURVES = (RETURN, STOCHASTIC, COMPLETION)
#: Figures that have a final value each.
FINALS = (*CURVES, QUALITY, ELEMENTS)


@dataclass(frozen=True)
class Band:
    """A figure over training.

    Attributes:
        steps: (t,) env steps that all seeds cover.
        seeds: (n, t) values there.
        centre: (t,) interquartile mean over the seeds with its bootstrap interval; t may be 0.
    """

    steps: Floats
    seeds: Floats
    centre: Interval


@dataclass(frozen=True)
class Learning:
    """One variant.

    Attributes:
        label: its name.
        trials: all of them.
        used: those that its figures are of: the finished ones, or before there is one those with an evaluation.
        bands: figure -> its curve.
        finals: figure -> (n,) each seed's mean over its last evaluations, in the order of ``used``.
        metric: the figure that the study's variants are judged by.
    """

    label: str
    trials: Sequence[Trial]
    used: Sequence[Trial]
    bands: dict[str, Band]
    finals: dict[str, Floats]
    metric: str

    @property
    def judged(self) -> Floats:
        """(n,) the seeds' finite final values of the metric."""
        values = self.finals[self.metric]
        return values[np.isfinite(values)]

    @property
    def final(self) -> Interval:
        """Interquartile mean of the seeds' final returns with its interval; NaN before the first evaluation."""
        return centre(self.finals[RETURN])

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
        return steps_to(band.steps, band.centre.value, threshold), each


def learnt(results: Results) -> list[Learning]:
    """Every variant in the study's order; the same intervals every time."""
    return [_learning(label, results.of(label), results.metric) for label in results.variants]


def _learning(label: str, trials: Sequence[Trial], metric: str) -> Learning:
    begun = [trial for trial in trials if trial.evaluations and trial.status != "failed"]
    used = [trial for trial in begun if trial.finished] or begun
    bands = {figure: band([trial.curve(figure) for trial in used]) for figure in CURVES}
    finals = {figure: np.array([final_score(trial.curve(figure)[1]) for trial in used]) for figure in {*FINALS, metric}}
    return Learning(label, trials, used, bands, finals, metric)


def band(curves: Sequence[tuple[Floats, Floats]]) -> Band:
    """The curves of several seeds on common steps."""
    steps, seeds = aligned(curves)
    if not seeds.size:
        nothing = np.empty(0)
        return Band(nothing, np.empty((0, 0)), Interval(nothing, nothing, nothing))
    # The curve is one stratum: whole runs are drawn, the same at every step.
    return Band(steps, seeds, stratified_interval(seeds.T[:, :, None], interquartile_mean_of_runs))


def centre(scores: Floats) -> Interval:
    """The interquartile mean of the finite scores, (n,) or (n, m), with its interval; NaN when there are none."""
    scores = scores[:, None] if scores.ndim == 1 else scores
    scores = scores[np.isfinite(scores).all(axis=1)]
    if not scores.size:
        nothing = np.array(math.nan)
        return Interval(nothing, nothing, nothing)
    return stratified_interval(scores, interquartile_mean_of_runs)


def halfway(variants: Sequence[Learning]) -> float:
    """The return that sample efficiency is measured at: midway from where training starts to the best variant's end.

    The start is the mean of all seeds' first evaluations, the end the best final interquartile mean; NaN without any.
    """
    first = [float(trial.curve(RETURN)[1][0]) for variant in variants for trial in variant.used]
    finals = [float(variant.final.value) for variant in variants if variant.used]
    return 0.5 * (float(np.mean(first)) + max(finals)) if first else math.nan
