"""Expectations and what came of them, judged together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from envs.types import Floats
from freemesh_ray.report.pairwise import Comparison, compare
from freemesh_ray.report.transfer import Transfer
from freemesh_ray.report.variants import VariantResult
from freemesh_ray.statistics.equivalence import Difference, difference
from freemesh_ray.statistics.permutation import holm, p_value, two_sided
from freemesh_ray.statistics.power import seeds_to_equate, seeds_to_separate
from freemesh_ray.statistics.verdict import SIGNIFICANT, Verdict, equality_verdict, order_verdict
from freemesh_ray.studies.definition import SAME, Expectation


@dataclass(frozen=True)
class Evidence:
    """An expectation, and what was measured of it.

    Attributes:
        expectation: it.
        x, y: (n_x,), (n_y,) final values of the metric, one a seed; they may be empty.
        comparison: None where one of the two has no evaluation yet.
        complete: whether both are finished. Looking again and again while runs come in would find an order by chance
            sooner or later.
    """

    expectation: Expectation
    x: Floats
    y: Floats
    comparison: Comparison | None
    complete: bool

    @property
    def equality(self) -> bool:
        """Whether the two are expected to score the same."""
        return self.expectation.relation == SAME

    @property
    def difference(self) -> Difference:
        """Of the means, of which ``comparison`` must be."""
        return difference(self.x, self.y)

    @property
    def p_for(self) -> float:
        """One-sided p-value of the expected order; 1 until both are finished."""
        return p_value(self.x, self.y) if self.complete else 1.0

    @property
    def p_against(self) -> float:
        """One-sided p-value of the other order; of an equality that of a difference, two-sided."""
        if not self.complete:
            return 1.0
        return two_sided(self.x, self.y) if self.equality else p_value(self.y, self.x)


@dataclass(frozen=True)
class Outcome:
    """What the runs say on an expectation.

    Attributes:
        evidence: what it is judged by.
        p_value: of the order that came out; of an equality that of a difference.
        p_corrected: the same by Holm, over all that were judged together.
        verdict: always undecided until both variants are finished.
        seeds: of each side, that would decide it; None: more than `power.MOST`, or nothing to say it by.
    """

    evidence: Evidence
    p_value: float
    p_corrected: float
    verdict: Verdict
    seeds: int | None = None

    @property
    def open(self) -> bool:
        """Whether more seeds are asked for: no decision, of two or more finished seeds each."""
        e = self.evidence
        decided = self.verdict in (Verdict.CONFIRMED, Verdict.REFUTED, Verdict.SAME)
        return e.complete and not decided and min(len(e.x), len(e.y)) > 1


def evidence(expects: Sequence[Expectation], variants: Sequence[VariantResult], transfer: Transfer) -> list[Evidence]:
    """What a study measured of each expectation, by the final value of its metric."""
    by_label = {variant.label: variant for variant in variants}
    found = []
    for expected in expects:
        x, y = by_label[expected.x], by_label[expected.y]
        known = bool(x.final_metric.size and y.final_metric.size)
        complete = known and not any(variant.under_way or variant.provisional for variant in (x, y))
        comparison = compare(x, y, transfer) if known else None
        found.append(Evidence(expected, x.final_metric, y.final_metric, comparison, complete))
    return found


def judged(found: Sequence[Evidence]) -> list[Outcome]:
    """The verdicts, their p-values corrected by Holm over all expectations that are given.

    What confirms an order and what refutes an expectation are corrected each on their own: of either kind, chance alone
    gives one or more with a probability of `SIGNIFICANT` at most. Expectations not measured yet count, so that the
    correction does not change with what has come in.
    """
    confirms = iter(holm([each.p_for for each in found if not each.equality]))
    refutes = holm([each.p_against for each in found])
    return [
        _judged(each, 1.0 if each.equality else next(confirms), against, SIGNIFICANT / len(found))
        for each, against in zip(found, refutes, strict=True)
    ]


def _judged(each: Evidence, favours: float, against: float, strictest: float) -> Outcome:
    """The verdict, by corrected p-values; ``strictest`` is the level of the first of Holm's steps."""
    if not each.complete:
        return Outcome(each, 1.0, 1.0, Verdict.UNDECIDED)
    if each.equality:
        said = equality_verdict(each.x, each.y, against, each.difference.same)
    else:
        said = order_verdict(each.x, each.y, favours, against)
    ahead = not each.equality and each.p_for <= each.p_against
    outcome = Outcome(each, each.p_for if ahead else each.p_against, favours if ahead else against, said)
    return replace(outcome, seeds=_seeds(each, strictest)) if outcome.open else outcome


def _seeds(each: Evidence, level: float) -> int | None:
    """Seeds of each side that would decide it."""
    if not each.equality:
        return seeds_to_separate(each.x, each.y, level)
    found = each.difference
    if abs(found.interval.value) < found.margin:
        return seeds_to_equate(each.x, each.y, found.margin)
    return seeds_to_separate(each.x, each.y, 0.5 * level)
