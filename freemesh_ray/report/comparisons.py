"""Variants against each other: the probability that a run of one beats a run of the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from freemesh_ray.policies.evaluation import DETERMINISTIC
from freemesh_ray.report.transfer import Transfer
from freemesh_ray.report.variants import VariantResult, iqm_interval
from freemesh_ray.statistics.bootstrap import Interval
from freemesh_ray.statistics.improvement import Verdict, improvement_interval, p_value, verdict

#: More pairs than a reader takes in.
MANY = 15


@dataclass(frozen=True)
class Comparison:
    """X against Y.

    Attributes:
        x, y: labels.
        runs: of x and of y.
        by_final: P(X > Y) by the final value of the metric.
        p_value: how often equal variants would come out in this order by it, as clearly or more.
        by_score: P(X > Y) by the score on the evaluation domains; None without any.
    """

    x: str
    y: str
    runs: tuple[int, int]
    by_final: Interval
    p_value: float
    by_score: Interval | None


@dataclass(frozen=True)
class Outcome:
    """What was expected of two variants, and what the runs say.

    Attributes:
        better, worse: their labels, as expected.
        comparison: None where one of the two has no evaluation yet.
        verdict: undecided without a comparison.
    """

    better: str
    worse: str
    comparison: Comparison | None
    verdict: Verdict


def all_pairs(variants: Sequence[VariantResult], transfer: Transfer) -> list[Comparison]:
    """All pairs of variants with evaluations, the one with the higher final metric first."""
    known = [variant for variant in variants if variant.final_metric.size]
    ranked = sorted(known, key=lambda variant: -float(iqm_interval(variant.final_metric).value))
    return [compare(x, y, transfer) for x, y in combinations(ranked, 2)]


def pairs_to_show(comparisons: Sequence[Comparison]) -> list[Comparison]:
    """What to show of all pairs: those of more than one run; where they are many, those of the best variant."""
    found = [each for each in comparisons if max(each.runs) > 1]
    return found if len(found) <= MANY else [each for each in found if each.x == comparisons[0].x]


def compare(x: VariantResult, y: VariantResult, transfer: Transfer) -> Comparison:
    """Two variants that have evaluations."""
    a, b = x.final_metric, y.final_metric
    scores = [transfer.of(variant.label, "score", DETERMINISTIC) for variant in (x, y)]
    by_score = improvement_interval(*scores) if all(each.size for each in scores) else None
    by_final = improvement_interval(a[:, None], b[:, None])
    p = p_value(a, b) if by_final.value >= 0.5 else p_value(b, a)
    return Comparison(x.label, y.label, (len(a), len(b)), by_final, p, by_score)


def outcomes(
    expects: Sequence[tuple[str, str]], variants: Sequence[VariantResult], transfer: Transfer
) -> list[Outcome]:
    """What the runs say on each pair (better, worse) that is expected, by the final value of the metric."""
    by_label: Mapping[str, VariantResult] = {variant.label: variant for variant in variants}
    found = []
    for better, worse in expects:
        x, y = by_label[better], by_label[worse]
        if not x.final_metric.size or not y.final_metric.size:
            found.append(Outcome(better, worse, None, Verdict.UNDECIDED))
            continue
        # Looking again and again while runs come in would find an order by chance sooner or later.
        early = any(variant.under_way or variant.provisional for variant in (x, y))
        said = Verdict.UNDECIDED if early else verdict(x.final_metric, y.final_metric)
        found.append(Outcome(better, worse, compare(x, y, transfer), said))
    return found
