"""Variants against each other: the probability that a run of one beats a run of the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from freemesh_ray.report.learning import Learning, centre
from freemesh_ray.report.results import Expectation
from freemesh_ray.report.transfer import Transfer
from freemesh_ray.statistics.bootstrap import Interval
from freemesh_ray.statistics.improvement import Verdict, chance, improvement_interval, verdict

#: More pairs than a reader takes in.
MANY = 15


@dataclass(frozen=True)
class Comparison:
    """X against Y.

    Attributes:
        x, y: labels.
        runs: of x and of y.
        by_final: P(X > Y) by the final value of the metric.
        chance: how often equal variants would come out in this order by it, as clearly or more.
        by_score: P(X > Y) by the score on the evaluation domains; None without any.
    """

    x: str
    y: str
    runs: tuple[int, int]
    by_final: Interval
    chance: float
    by_score: Interval | None


@dataclass(frozen=True)
class Outcome:
    """An expectation and what the runs say.

    Attributes:
        expectation: of the paper.
        comparison: None where one of the two has no evaluation yet.
        verdict: undecided without a comparison.
    """

    expectation: Expectation
    comparison: Comparison | None
    verdict: Verdict


def compared(variants: Sequence[Learning], transfer: Transfer) -> list[Comparison]:
    """All pairs of variants with evaluations, the one with the higher final metric first."""
    known = [variant for variant in variants if variant.judged.size]
    ranked = sorted(known, key=lambda variant: -float(centre(variant.judged).value))
    return [compare(x, y, transfer) for x, y in combinations(ranked, 2)]


def telling(comparisons: Sequence[Comparison]) -> list[Comparison]:
    """What to show of all pairs: those of more than one run; where they are many, those of the best variant."""
    found = [each for each in comparisons if max(each.runs) > 1]
    return found if len(found) <= MANY else [each for each in found if each.x == comparisons[0].x]


def compare(x: Learning, y: Learning, transfer: Transfer) -> Comparison:
    """Two variants that have evaluations."""
    a, b = x.judged, y.judged
    scores = [transfer.of(variant.label, "score", "deterministic") for variant in (x, y)]
    by_score = improvement_interval(*scores) if all(each.size for each in scores) else None
    by_final = improvement_interval(a[:, None], b[:, None])
    by_chance = chance(a, b) if by_final.value >= 0.5 else chance(b, a)
    return Comparison(x.label, y.label, (len(a), len(b)), by_final, by_chance, by_score)


def outcomes(expects: Sequence[Expectation], variants: Sequence[Learning], transfer: Transfer) -> list[Outcome]:
    """What the runs say on each expectation, by the final value of the metric."""
    by_label: Mapping[str, Learning] = {variant.label: variant for variant in variants}
    found = []
    for expectation in expects:
        x, y = by_label[expectation.better], by_label[expectation.worse]
        if not x.judged.size or not y.judged.size:
            found.append(Outcome(expectation, None, Verdict.UNDECIDED))
            continue
        # Looking again and again while runs come in would find an order by chance sooner or later.
        early = any(variant.under_way or variant.provisional for variant in (x, y))
        said = Verdict.UNDECIDED if early else verdict(x.judged, y.judged)
        found.append(Outcome(expectation, compare(x, y, transfer), said))
    return found
