"""The report's text, section by section, in Markdown."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from envs.types import Floats
from freemesh_ray import config
from freemesh_ray.config import Layer
from freemesh_ray.formatting.markdown import bold, code, escaped
from freemesh_ray.formatting.table import markdown
from freemesh_ray.policies.evaluation import COMPLETION, ELEMENTS, MODES, QUALITY, RETURN, STOCHASTIC_RETURN
from freemesh_ray.records.schema import FILE
from freemesh_ray.report.machine import machine
from freemesh_ray.report.number_text import bracketed, count, hours, span, spread, thousands
from freemesh_ray.report.pairwise import Comparison
from freemesh_ray.report.results import Results, TrialResult, number
from freemesh_ray.report.transfer import Transfer
from freemesh_ray.report.variants import COMPLETED, SHARES, VariantResult, iqm_interval, return_threshold

#: From a picture's name and description to its place in the text.
Picture = Callable[[str, str], str]


def opening(results: Results) -> str:
    """What the study is about, what the paper finds, and whether all of it was run."""
    study = results.study
    lines = [f"# {escaped(study.title)}"]
    about = [f"**In the paper:** {escaped(study.paper)}."] if study.paper else []
    known = bold("Its finding:" if study.paper else "Known before:")
    about += [f"{known} {escaped(study.finding)}"] if study.finding else []
    lines += ["  \n".join(about)] if about else []
    statuses = Counter(trial.status for trial in results.trials)
    if results.unfinished:
        told = ", ".join(f"{number} {status}" for status, number in statuses.items())
        lines.append(
            f"**Not finished yet:** of {count(len(results.trials), 'trial')} {told}. Figures and verdicts may change."
        )
    elif statuses["failed"] or statuses["stopped"]:
        reasons = {"failed": "failed, left out of all figures", "stopped": "stopped before the end of their budget"}
        missing = "; ".join(f"{statuses[status]} {what}" for status, what in reasons.items() if statuses[status])
        lines.append(f"Of {count(len(results.trials), 'trial')}: {missing} (see Trials).")
    return "\n\n".join(lines)


def probability(comparison: Comparison) -> str:
    """P(X > Y) by the metric's final value."""
    return bracketed(comparison.by_final, ".2f", max(comparison.runs))


def what_was_run(results: Results, commits: Iterable[str]) -> str:
    """Trials, budget, machine and source, of so many commits."""
    trials = results.trials
    done = sum(trial.finished for trial in trials)
    lines = [f"{count(len(trials), 'trial')}, {done} of them finished"]
    if not results.study.search:
        seeds = dict.fromkeys(trial.seed for trial in trials)
        lines[0] += f": {count(len(results.labels), 'variant')}, seeds {', '.join(map(str, seeds))}"
    if budget := settings(trials, "budget.env_steps"):
        lines.append(f"budget {span(min(budget), max(budget), ',.0f')} env steps a trial{shorter(budget, results)}")
    if updates := settings(trials, "learner.updates_per_step"):
        lines.append(f"{span(min(updates), max(updates), 'g')} gradient updates an env step")
    if interval := settings(trials, "evaluation.interval"):
        lines.append(f"evaluated every {span(min(interval), max(interval), ',.0f')} env steps")
    if seconds := sum(trial.seconds for trial in trials):
        lines.append(f"{hours(seconds)} of training, summed over the trials")
    if known := sorted(set(commits)):
        lines.append(f"source: commit {escaped(', '.join(map(short, known)))}")
    if measured := sum(trial.measured is not None for trial in trials):
        told = "its policy" if measured == 1 else "their policies"
        lines.append(f"{count(measured, 'trial')} from records, without {told}")
    if not results.preface:
        lines.append(f"all of it is in {code(FILE)}: {code(f'freemesh report --from {FILE}')} makes this report anew")
    recorded = f", of records that were made on {escaped(results.records.machine)}" if results.records else ""
    lines.append(f"this report was made on {machine()}{recorded}")
    return "## What was run\n\n" + "\n".join(f"- {line}" for line in lines)


def settings(trials: Sequence[TrialResult], key: str) -> list[float]:
    """The distinct numbers that a setting has in the trials' configurations."""
    found = {number(trial.config.get(key)) for trial in trials}
    return sorted(value for value in found if math.isfinite(value))


def shorter(budget: Sequence[float], results: Results) -> str:
    """How the budget compares with the paper's, where the study is of it, and how much of it the trials took."""
    paper = config.load(["train_paper"])["budget"]["env_steps"]
    said = f", shorter than the paper's {paper:,}" if results.study.paper and min(budget) < paper else ""
    taken = [trial.env_steps for trial in results.trials if trial.finished]
    if taken and min(taken) < min(budget):
        said += f"; finished trials took {span(min(taken), max(taken), ',.0f')}"
    return said


def short(commit: str) -> str:
    """A commit as people write it."""
    name, dash, dirty = commit.partition("-")
    return f"{name[:10]}{dash}{dirty}"


def curves(variants: Sequence[VariantResult], picture: Picture) -> str:
    """The learning curves and the table of their ends."""
    threshold = return_threshold(variants)
    partly = ""
    if any(len(variant.used) < len(variant.trials) or variant.provisional for variant in variants):
        partly = " Figures are of finished trials; *: none is finished, of those that were begun, provisional."
    return (
        f"## Learning\n\n{picture('curves', 'return and completion rate against environment steps')}\n\n"
        f"{final_table(variants, threshold)}\n\n"
        f"Of deterministic evaluation episodes, where nothing else is said; ± is the deviation over seeds. A seed's "
        "final figure is the mean of its evaluations in the last tenth of its training. IQM: interquartile mean over "
        "seeds, with its 95 % interval (one seed has none). Steps: until the IQM curve reaches a return of "
        f"{threshold:.1f}, half the best variant's final IQM (where that is not above 0: midway to it from the first "
        "evaluations); in brackets the seeds that do and when. Steps and time to "
        f"{100 * COMPLETED:.0f} % completed: until a seed's curve first reaches this completion rate, the median over "
        f"seeds, those that never do counted as the longest; in brackets how many do.{partly}"
    )


def final_table(variants: Sequence[VariantResult], threshold: float) -> str:
    """The ends of the learning curves, and when each first reached a return of ``threshold``: a line a variant."""
    header = ["variant", "seeds", "final return", "IQM [95 %]", "stochastic", "mean over training",
              "completed", "eta", "elements", f"steps to {threshold:.1f}",
              f"steps to {100 * COMPLETED:.0f} % completed", "time"]  # fmt: skip
    rows = [
        [
            mark(variant),
            f"{len(variant.used)} of {len(variant.trials)}",
            spread(variant.finals[RETURN], ".1f"),
            bracketed(variant.final_return, ".1f", len(variant.used)),
            spread(variant.finals[STOCHASTIC_RETURN], ".1f"),
            spread(variant.mean_over_training(), ".1f"),
            spread(100 * variant.finals[COMPLETION], ".0f") + ("" if not variant.used else " %"),
            spread(variant.finals[QUALITY], ".3f"),
            spread(variant.finals[ELEMENTS], ".0f"),
            reached(variant, threshold),
            *completed(variant),
        ]
        for variant in variants
    ]
    return markdown(header, rows)


def completed(variant: VariantResult) -> list[str]:
    """When a variant's seeds first complete nearly all episodes: steps and time, medians over seeds."""
    if not variant.used:
        return ["-", "-"]
    found = variant.to_completion()
    known = sum(math.isfinite(steps) for steps, _ in found)
    steps, seconds = (float(np.median(each)) for each in zip(*found, strict=True))
    share = f" ({known} of {len(found)})" if len(found) > 1 else ""
    return [
        f"{thousands(steps) if math.isfinite(steps) else 'never'}{share}",
        hours(seconds) if math.isfinite(seconds) else "-",
    ]


def mark(variant: VariantResult) -> str:
    """A variant's label, with a star where its figures are provisional."""
    return f"{variant.label}*" if variant.provisional else variant.label


def reached(variant: VariantResult, threshold: float) -> str:
    """When a variant first reaches a return."""
    if not variant.used or math.isnan(threshold):
        return "-"
    curve, each = variant.steps_to(threshold)
    if len(each) == 1:
        return "never" if curve is None else thousands(curve)
    known = [steps for steps in each if steps is not None]
    when = f": {span(min(known) / 1000, max(known) / 1000, ',.0f')}k" if known else ""
    return f"{'never' if curve is None else thousands(curve)} ({len(known)} of {len(each)}{when})"


def domains(variants: Sequence[VariantResult], transfer: Transfer, episodes: int, picture: Picture) -> str:
    """Every policy on every domain."""
    parts = [f"## Every policy on {count(len(transfer.domains), 'domain')}"]
    if transfer.figures:
        parts.append(picture("profile", "share of runs and domains above a score"))
        parts += [domain_table(variants, transfer, mode) for mode in MODES]
        parts.append(
            "Completion rate, and mean element quality eta of the cut elements, of each trial's best policy, in "
            f"{count(episodes, 'episode')} on each domain: mean ± deviation over seeds. Deterministic: the policy's "
            "mean action, drawn only after a rejected one; stochastic: every action drawn. Score, in [0, 1]: mean over "
            "episodes of eta, 0 where the mesh is not complete; its line is the IQM over seeds and domains with the "
            "95 % interval, a seed's scores on all domains drawn together."
        )
    if transfer.skipped:
        told = [f"- {escaped(f'{name}: {why}')}" for name, why in transfer.skipped.items()]
        parts.append("\n".join(["Left out:\n", *told]))
    return "\n\n".join(parts)


def domain_table(variants: Sequence[VariantResult], transfer: Transfer, mode: str) -> str:
    """Completion and quality of one mode of acting: a line a domain, a column a variant, the score at the end."""
    known = [variant for variant in variants if transfer.of(variant.label, "score", mode).size]
    done = {v.label: transfer.of(v.label, "completion_rate", mode) for v in known}
    eta = {v.label: transfer.of(v.label, "element_quality", mode) for v in known}
    scores = {v.label: transfer.of(v.label, "score", mode) for v in known}
    rows = [
        [name, *(completion_and_quality(done[v.label][:, j], eta[v.label][:, j]) for v in known)]
        for j, name in enumerate(transfer.domains)
    ]
    rows.append(
        ["score", *(bracketed(iqm_interval(scores[v.label], SHARES), ".3f", len(scores[v.label])) for v in known)]
    )
    return markdown([mode, *(mark(variant) for variant in known)], rows)


def completion_and_quality(done: Floats, eta: Floats) -> str:
    """Completion rate and quality in one cell."""
    return f"{100 * np.mean(done):.0f} %, {spread(eta, '.3f')}"


def pairs(comparisons: Sequence[Comparison], every: int, by: str, picture: Picture) -> str:
    """Variants against each other, by the figure that ``by`` names; ``every`` is how many pairs there are."""
    fewer = f" All {every} pairs are in comparisons.csv." if len(comparisons) < every else ""
    rows = [
        [
            f"{found.x} > {found.y}",
            f"{found.runs[0]} / {found.runs[1]}",
            probability(found),
            f"{found.p_value:.4f}",
            f"{found.p_corrected:.3f}",
            "-" if found.by_score is None else bracketed(found.by_score, ".2f", max(found.runs)),
        ]
        for found in comparisons
    ]
    header = ["X > Y", "seeds", f"by {by} [95 %]", "p-value", "corrected", "by score on the domains [95 %]"]
    return (
        f"## Pair by pair\n\n{picture('improvement', 'probability of improvement, pair by pair')}\n\n"
        f"{markdown(header, rows)}\n\nProbability that a run of X beats a run of Y, ties counting half; the variant "
        f"with the higher IQM of the {by} stands first. P-value: how often equal variants would differ as clearly "
        f"or more (two-sided permutation test); corrected: by Holm over all {every} pairs. These pairs were not set "
        f"beforehand: they have no verdict.{fewer}"
    )


def trials(results: Results) -> str:
    """Every trial, and what went wrong with those that failed."""
    rows = [
        [trial.label, str(trial.seed), trial.status, f"{trial.env_steps:,}", hours(trial.seconds), code(trial.run)]
        for trial in results.trials
    ]
    parts = [
        "## Trials",
        markdown(["trial" if results.study.search else "variant", "seed", "status", "env steps", "time", "run"], rows),
    ]
    if differing := differences(results.study.variants):
        parts.append(differing)
    failed = [trial for trial in results.trials if trial.error]
    if failed:
        told = "\n".join(f"- {escaped(f'{trial.label}, seed {trial.seed}: {trial.error}')}" for trial in failed)
        parts.append(f"What went wrong:\n\n{told}")
    return "\n\n".join(parts)


def differences(variants: Mapping[str, Layer]) -> str:
    """What the variants set; empty when nothing."""
    if not any(variants.values()):
        return ""
    told = []
    for label, layer in variants.items():
        own = config.flatten(config.values(layer))
        told.append(f"- {escaped(label)}: " + ", ".join(code(f"{key}={value}") for key, value in own.items()))
    return "Settings of the variants:\n\n" + "\n".join(told)


METHOD = """\
## Method

Interquartile means, score profiles and probabilities of improvement after Agarwal, Schwarzer, Castro, Courville and
Bellemare (2021), *Deep reinforcement learning at the edge of the statistical precipice*. Intervals are others than
theirs, because theirs cover less than they say where seeds are few. The seed is the unit everywhere: what one policy
scores on all domains is drawn together.

- Interquartile means and the bands of curves: the value plus and minus Student's t (n - 1 degrees of freedom) times the
  bootstrap standard error, 2,000 resamples of whole seeds; over domains times √(n / (n - 1)), too (Hesterberg 2015).
- Profiles: Wilson's interval, pointwise. Probabilities of improvement: Newcombe's (2006). With several domains the
  variance is that of whole seeds.
- Differences of means: Welch's t-interval.

Simulated with normal scores, intervals of 95 % of 5 and of 10 seeds cover 93 to 97 %. Of 3 seeds those of interquartile
means do, too, at the price of their width; those of differences cover 93 to 98 %, of a probability of improvement 89
to 98 %. Profiles do on the average over the scores; at a single score, where few seeds take few values, it may be 84 to
100 %.

Curves are interpolated between evaluations and drawn where all seeds of a variant have values. All numbers of the
pictures are in the CSV files."""
