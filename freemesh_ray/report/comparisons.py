"""Variants against each other: the probability that a run of one beats a run of the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from envs.types import Floats
from freemesh_ray.report.learning import RETURN, Learning
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
        by_return: P(X > Y) by the final return.
        chance: how often equal variants would come out in this order as clearly or more, by the final return.
        by_score: P(X > Y) by the score on the evaluation domains; None without any.
    """

    x: str
    y: str
    runs: tuple[int, int]
    by_return: Interval
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
    """All pairs of variants with evaluations, the one with the higher final return first."""
    ranked = sorted(
        (variant for variant in variants if final(variant).size), key=lambda variant: -float(variant.final.value)
    )
    return [compare(x, y, transfer) for x, y in combinations(ranked, 2)]


def telling(comparisons: Sequence[Comparison]) -> list[Comparison]:
    """What to show of all pairs: those of more than one run; where they are many, those of the best variant."""
    found = [each for each in comparisons if max(each.runs) > 1]
    return found if len(found) <= MANY else [each for each in found if each.x == comparisons[0].x]


def compare(x: Learning, y: Learning, transfer: Transfer) -> Comparison:
    """Two variants that have evaluations."""
    a, b = final(x), final(y)
    scores = [transfer.of(variant.label, "score", "deterministic") for variant in (x, y)]
    by_score = improvement_interval(*scores) if all(each.size for each in scores) else None
    by_return = improvement_interval(a[:, None], b[:, None])
    by_chance = chance(a, b) if by_return.value >= 0.5 else chance(b, a)
    return Comparison(x.label, y.label, (len(a), len(b)), by_return, by_chance, by_score)


def outcomes(expects: Sequence[Expectation], variants: Sequence[Learning], transfer: Transfer) -> list[Outcome]:
    """What the runs say on each expectation, by the final return."""
    by_label: Mapping[str, Learning] = {variant.label: variant for variant in variants}
    found = []
    for expectation in expects:
        x, y = by_label[expectation.better], by_label[expectation.worse]
        if not final(x).size or not final(y).size:
            found.append(Outcome(expectation, None, Verdict.UNDECIDED))
            continue
        # Looking again and again while runs come in would find an order by chance sooner or later.
        early = any(variant.under_way or variant.provisional for variant in (x, y))
        said = Verdict.UNDECIDED if early else verdict(final(x), final(y))
        found.append(Outcome(expectation, compare(x, y, transfer), said))
    return found


def final(variant: Learning) -> Floats:
    """(n,) the finite final returns of a variant's seeds."""
    scores = variant.finals[RETURN]
    return scores[np.isfinite(scores)]
