"""Variants against each other: the probability that a run of one beats a run of the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from freemesh_ray.policies.evaluation import DETERMINISTIC
from freemesh_ray.report.transfer import Transfer
from freemesh_ray.report.variants import VariantResult, iqm_interval
from freemesh_ray.statistics.bootstrap import Interval
from freemesh_ray.statistics.improvement import improvement_interval
from freemesh_ray.statistics.permutation import holm, two_sided

#: More pairs than a reader takes in.
MANY = 15


@dataclass(frozen=True)
class Comparison:
    """X against Y.

    Attributes:
        x, y: labels.
        runs: of x and of y.
        by_final: P(X > Y) by the final value of the metric.
        p_value: how often equal variants would differ by it as clearly or more, in either order.
        p_corrected: the same by Holm, over all pairs; of a single pair, ``p_value``.
        by_score: P(X > Y) by the score on the evaluation domains; None without any.
    """

    x: str
    y: str
    runs: tuple[int, int]
    by_final: Interval
    p_value: float
    p_corrected: float
    by_score: Interval | None


def all_pairs(variants: Sequence[VariantResult], transfer: Transfer) -> list[Comparison]:
    """All pairs of variants with evaluations, the one with the higher final metric first."""
    known = [variant for variant in variants if variant.final_metric.size]
    ranked = sorted(known, key=lambda variant: -float(iqm_interval(variant.final_metric).value))
    found = [compare(x, y, transfer) for x, y in combinations(ranked, 2)]
    corrected = holm([each.p_value for each in found])
    return [replace(each, p_corrected=p) for each, p in zip(found, corrected, strict=True)]


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
    p = two_sided(a, b)
    return Comparison(x.label, y.label, (len(a), len(b)), by_final, p, p, by_score)
