"""What the tracking store tells of a study as a whole: the report's tables, and curves of the variants over seeds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from freemesh_ray import config
from freemesh_ray.formatting.markdown import block, code
from freemesh_ray.plots.series import colour
from freemesh_ray.policies.evaluation import DETERMINISTIC, mode_and_figure
from freemesh_ray.report import ranked_draws, sections
from freemesh_ray.report.expectations import tables
from freemesh_ray.report.number_text import final
from freemesh_ray.report.outcomes import evidence, judged
from freemesh_ray.report.results import Results, read
from freemesh_ray.report.transfer import Transfer
from freemesh_ray.report.variants import (
    CURVES,
    FINALS,
    SHARES,
    Band,
    VariantResult,
    band,
    iqm_interval,
    return_threshold,
    variant_results,
)
from freemesh_ray.statistics.aligned_curves import mean_and_deviation
from freemesh_ray.statistics.bootstrap import EVERYTHING, Interval

#: Figures that lie in [0, 1].
RATES = ("completion_rate", "element_quality", "score")
#: Draws of a search whose figures are told.
DRAWS = 50
#: Of a variant's figures, those that its chart is drawn of.
SHOWN = ("return", "completion_rate", "element_quality")


@dataclass(frozen=True)
class VariantSummary:
    """A variant over its seeds.

    Attributes:
        colour: of its curves, as in the report's pictures.
        settings: dotted key -> value: what it sets.
        step: env steps at the end of its longest training.
        figures: name -> value: the report's table of final figures, unrounded; what is not known yet is left out.
        curves: name -> (env steps, value) of the interquartile mean; with ``_low`` and ``_high`` of its interval.
    """

    colour: str
    settings: Mapping[str, str]
    step: int
    figures: Mapping[str, float]
    curves: Mapping[str, Sequence[tuple[int, float]]]


@dataclass(frozen=True)
class StudySummary:
    """A study over all its trials.

    Attributes:
        text: what it is, its tables and how to run it again, in Markdown without pictures.
        step: env steps at the end of its longest training.
        figures: name with the variant's label -> value.
        variants: label -> over its seeds; none of a search.
        curves: names of the curves, the study's metric first.
        seeds: metrics of its trainings that have a curve, the study's metric first.
        finals: names of the final figures to compare, the study's metric first.
    """

    text: str
    step: int
    figures: Mapping[str, float]
    variants: Mapping[str, VariantSummary]
    curves: Sequence[str]
    seeds: Sequence[str]
    finals: Sequence[str]


def summary(folder: Path) -> StudySummary:
    """What came of the study in a folder; no policy is evaluated for it.

    Raises:
        StudyError, ConfigError: there is no such study, or its results cannot be read.
    """
    results = read(folder)
    step = max((trial.env_steps for trial in results.trials), default=0)
    seeds = list(dict.fromkeys([results.study.metric, *CURVES]))
    if results.study.search:
        return StudySummary(_of_search(results), step, _draws(results), {}, [], seeds, [])
    variants = variant_results(results)
    found = {variant.label: _variant(results, variant, place) for place, variant in enumerate(variants)}
    figures = {f"{name}/{label}": value for label, each in found.items() for name, value in each.figures.items()}
    curves = [f"iqm/{short(name)}" for name in seeds]
    finals = [f"final/{name}" for name in dict.fromkeys([short(results.study.metric), *SHOWN])]
    return StudySummary(_of_variants(results, variants), step, figures, found, curves, seeds, finals)


def short(metric: str) -> str:
    """A metric's name among the figures: ``return``, ``stochastic_return``."""
    mode, figure = mode_and_figure(metric)
    return figure if mode == DETERMINISTIC else f"{mode}_{figure}"


def _of_variants(results: Results, variants: Sequence[VariantResult]) -> str:
    """The report's opening, verdicts and final figures."""
    study = results.study
    said = judged(evidence(study.expects, variants, Transfer([], {}, {}, {})))
    parts = [sections.opening(results)]
    if said:
        parts += ["## Verdicts", *tables(said, final(study.metric))]
    parts += [
        "## Final figures", sections.final_table(variants, return_threshold(variants)),
        "± deviation over seeds; IQM: interquartile mean over seeds. The runs below with the variants' names have its "
        f"curve, {code('iqm/...')}, with the ends of its 95 % interval.",
        _again(results),
    ]  # fmt: skip
    return "\n\n".join(parts)


def _of_search(results: Results) -> str:
    """The report's opening and ranking."""
    ranks, again = ranked_draws.ranking(results), ranked_draws.ranking(results, again=True)
    nothing = ranked_draws.section(ranks, lambda name, what: "", results.study)
    parts = [
        sections.opening(results),
        _again(results),
        ranked_draws.confirmation(ranks, again, results.study),
        nothing,
    ]
    return "\n\n".join(part for part in parts if part)


def _again(results: Results) -> str:
    """How to run it again."""
    name = f"{results.study.name}.yaml"
    return (
        f"## Again\n\nThe artifact {code('study.yaml')} is the whole study. Save it as {code(name)}, check out the "
        f"commit that the tag {code('commit')} names, and\n\n{block(f'freemesh study {name}')}"
    )


def _variant(results: Results, variant: VariantResult, place: int) -> VariantSummary:
    """A variant's figures and curves; those of the study's metric among them."""
    metric = results.study.metric
    bands = dict(variant.bands)
    if metric not in bands:
        bands[metric] = band([trial.curve(metric) for trial in variant.used], _bounds(metric))
    curves: dict[str, list[tuple[int, float]]] = {}
    for name, each in bands.items():
        lines = _points(each)
        curves |= {f"iqm/{short(name)}{end}": line for end, line in lines.items() if line}
    values = config.flatten(config.values(results.study.variants.get(variant.label, ())))
    settings = {key: str(value) for key, value in values.items()}
    step = max((trial.env_steps for trial in variant.used), default=0)
    return VariantSummary(colour(place), settings, step, _figures(variant, metric), curves)


def _points(of: Band) -> dict[str, list[tuple[int, float]]]:
    """A band's lines, by the end of their names; the ends of an interval that there is not are left out."""
    steps = of.steps.astype(int).tolist()
    lines = {"": of.iqm.value, "_low": of.iqm.low, "_high": of.iqm.high}
    return {
        end: [(step, value) for step, value in zip(steps, line.tolist(), strict=True) if math.isfinite(value)]
        for end, line in lines.items()
    }


def _bounds(metric: str) -> tuple[float, float]:
    """Within which a metric lies."""
    return SHARES if mode_and_figure(metric)[1] in RATES else EVERYTHING


def _figures(variant: VariantResult, metric: str) -> dict[str, float]:
    """The final figures of a variant: means over its seeds, the interquartile mean of the study's metric, and more."""
    found: dict[str, float] = {}
    for name in dict.fromkeys([metric, *FINALS]):
        values = variant.finals[name][[math.isfinite(value) for value in variant.finals[name]]]
        if len(values):
            found[f"final/{short(name)}"] = mean_and_deviation(values)[0]
    iqm: Interval = iqm_interval(variant.finals[metric], _bounds(metric))
    ends = {"iqm": iqm.value, "iqm_low": iqm.low, "iqm_high": iqm.high}
    found |= {f"final/{short(metric)}_{end}": float(value) for end, value in ends.items()}
    found["final/seeds"] = len(variant.used)
    return {name: value for name, value in found.items() if math.isfinite(value)}


def _draws(results: Results) -> dict[str, float]:
    """The figures of a search's best draws."""
    return {
        f"final/{short(name)}/{one.trial.label}": value
        for one in ranked_draws.ranking(results)[:DRAWS]
        for name, value in one.finals.items()
        if math.isfinite(value)
    }
