"""The report's section on what was expected and what came out, in Markdown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from freemesh_ray.formatting.markdown import Markdown, bold
from freemesh_ray.formatting.table import markdown
from freemesh_ray.report.number_text import bracketed, count
from freemesh_ray.report.outcomes import Outcome
from freemesh_ray.statistics.bootstrap import Interval
from freemesh_ray.statistics.equivalence import Difference
from freemesh_ray.statistics.power import MOST, POWER
from freemesh_ray.statistics.verdict import SIGNIFICANT, Verdict


def expectations(outcomes: Sequence[Outcome], by: str, paper: bool) -> str:
    """What was expected, by the ``paper`` or else by the study's author, and what came out by the figure ``by``."""
    equalities = any(outcome.evidence.equality for outcome in outcomes)
    return "\n\n".join([
        f"## {'What the paper expects' if paper else 'What was expected'}", *tables(outcomes, by),
        words(len(outcomes), equalities),
    ])  # fmt: skip


def tables(outcomes: Sequence[Outcome], by: str) -> list[str]:
    """How many expectations got each verdict, and the expectations: orders, then equalities."""
    tally = Counter(outcome.verdict for outcome in outcomes)
    orders = [outcome for outcome in outcomes if not outcome.evidence.equality]
    equalities = [outcome for outcome in outcomes if outcome.evidence.equality]
    parts = [", ".join(f"{tally[said]} {said}" for said in Verdict if tally[said]) + "."]
    if orders:
        header = [f"expected, by the {by}", "seeds", "P(X > Y) [95 %]", "p-value", "corrected", "verdict"]
        parts.append(markdown(header, [row(outcome, [improvement(outcome)]) for outcome in orders]))
    if equalities:
        header = [f"expected, by the {by}", "seeds", "difference [95 %]", "% of the baseline", "p-value", "corrected",
                  "verdict"]  # fmt: skip
        parts.append(markdown(header, [row(outcome, differences(outcome)) for outcome in equalities]))
    return parts


def row(outcome: Outcome, measured: Sequence[str]) -> list[str]:
    """The cells of an expectation, with what was ``measured`` of it."""
    e = outcome.evidence
    if e.comparison is None:
        return [str(e.expectation), "-", *("-" for _ in measured), "-", "-", f"{outcome.verdict}: no evaluation yet"]
    p_values = [f"{outcome.p_value:.4f}", f"{outcome.p_corrected:.3f}"] if e.complete else ["-", "-"]
    return [str(e.expectation), f"{len(e.x)} / {len(e.y)}", *measured, *p_values, verdict(outcome)]


def improvement(outcome: Outcome) -> str:
    """P(X > Y)."""
    found = outcome.evidence.comparison
    return "-" if found is None else bracketed(found.by_final, ".2f", max(found.runs))


def differences(outcome: Outcome) -> list[str]:
    """The difference of the means, and the same as a share of the baseline's mean."""
    e = outcome.evidence
    if e.comparison is None:
        return ["-", "-"]
    found: Difference = e.difference
    runs = min(e.comparison.runs)
    percent = Interval(*(100.0 * end for end in found.shares))
    return [bracketed(found.interval, "+.3g", runs), bracketed(percent, "+.1f", runs)]


def verdict(outcome: Outcome) -> Markdown:
    """The verdict, and where more seeds are asked for how many."""
    said = bold(outcome.verdict)
    if not outcome.open:
        return said
    needed = f"more than {MOST}" if outcome.seeds is None else f"about {outcome.seeds}"
    return Markdown(f"{said}; needs {needed} seeds each")


def words(number: int, equalities: bool) -> str:
    """What the words of the verdicts mean; ``number`` of expectations were judged together."""
    two_sided, equal, same = "", "", ""
    if equalities:
        two_sided, equal = ", of an equality two-sided", " (of an equality: with equal means)"
        same = (
            " The same within a tenth: the 95 % interval of the difference of the means, each seed counting once, "
            "contains zero and lies within a tenth of the mean of the one that stands second, the baseline."
        )
    return (
        f"P-values are of a permutation test, one-sided in the order that came out{two_sided}; corrected: by Holm over "
        f"the {count(number, 'expectation')} of this report, confirmations and refutations each on their own. "
        f"Confirmed, or refuted: the corrected p-value is at most {SIGNIFICANT:g}. Separated: it is above, yet every "
        "seed of one is better than every seed of the other; against it: in the order that was not expected."
        f"{same} Undecided: anything else, and always before both are finished. Seeds needed: of each side, for a "
        f"verdict with a probability of {100 * POWER:.0f} %, if scores are normal with the means and deviations seen "
        f"here{equal}, at the strictest of Holm's levels; an estimate from few seeds, not counted above {MOST}."
    )
