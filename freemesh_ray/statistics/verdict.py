"""What the runs say on an expectation."""

from __future__ import annotations

from enum import StrEnum

from envs.types import Floats

#: The level: how likely at most chance alone confirms one or more of the expectations that are judged together, and how
#: likely at most it refutes one or more.
SIGNIFICANT = 0.05


class Verdict(StrEnum):
    """What the runs say on an expectation."""

    CONFIRMED = "confirmed"
    SAME = "the same within a tenth"
    REFUTED = "refuted"
    SEPARATED = "separated"
    OPPOSED = "separated against it"
    UNDECIDED = "undecided"


def order_verdict(x: Floats, y: Floats, p_for: float, p_against: float) -> Verdict:
    """Whether runs confirm that x is better than y.

    Confirmed, or refuted: the corrected p-value is at most `SIGNIFICANT`. Separated, or separated against it: it is
    above, yet every run of one side is better than every run of the other, of two or more each.

    Args:
        x: (n_x,) scores of the one expected to be better, one a run.
        y: (n_y,) scores of the other.
        p_for, p_against: one-sided p-values of x above y and of y above x, corrected for the number of expectations.
    """
    if p_for <= SIGNIFICANT:
        return Verdict.CONFIRMED
    if p_against <= SIGNIFICANT:
        return Verdict.REFUTED
    if separated(x, y):
        return Verdict.SEPARATED
    return Verdict.OPPOSED if separated(y, x) else Verdict.UNDECIDED


def equality_verdict(x: Floats, y: Floats, p_against: float, same: bool) -> Verdict:
    """Whether runs confirm that x scores the same as y.

    Args:
        x, y: (n_x,), (n_y,) scores, one a run.
        p_against: two-sided p-value of a difference, corrected for the number of expectations.
        same: what `equivalence.Difference.same` says.
    """
    if p_against <= SIGNIFICANT:
        return Verdict.REFUTED
    if same:
        return Verdict.SAME
    return Verdict.OPPOSED if separated(x, y) or separated(y, x) else Verdict.UNDECIDED


def separated(x: Floats, y: Floats) -> bool:
    """Whether every run of x is better than every run of y, and there are two or more of each."""
    return min(len(x), len(y)) > 1 and bool(x.min() > y.max())
