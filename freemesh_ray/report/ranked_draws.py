"""A search's report: its draws from the best to the worst, where the default stands, what each setting does, and what
the best do again on fresh seeds.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from freemesh_ray.formatting.markdown import Markdown, block, bold, escaped
from freemesh_ray.formatting.table import markdown, number
from freemesh_ray.plots import draw_settings
from freemesh_ray.policies.evaluation import COMPLETION, QUALITY, RETURN, metric, mode_and_figure
from freemesh_ray.report import csv_files
from freemesh_ray.report.number_text import count, final
from freemesh_ray.report.pictures import in_every_format
from freemesh_ray.report.results import Results, TrialResult
from freemesh_ray.report.sections import Picture
from freemesh_ray.statistics.aligned_curves import final_value
from freemesh_ray.studies.definition import Study

#: Metrics of a trial beside its settings -> column, format.
COLUMNS = {RETURN: ("return", ".1f"), COMPLETION: ("completed", ".0%"), QUALITY: ("eta", ".3f")}


class Ranked(NamedTuple):
    """A draw that has an evaluation.

    Attributes:
        trial: its training; of several seeds the first's.
        finals: metric -> mean over the last tenth of training and over its seeds: the study's metric, then those of
            `COLUMNS`.
        others: its trainings with the other seeds.
    """

    trial: TrialResult
    finals: dict[str, float]
    others: tuple[TrialResult, ...] = ()

    @property
    def trials(self) -> tuple[TrialResult, ...]:
        """All its trainings, one a seed."""
        return (self.trial, *self.others)


def ranking(results: Results, *, again: bool = False) -> list[Ranked]:
    """The draws by the study's metric, the best first.

    Args:
        results: of the search.
        again: the trainings on fresh seeds that confirm it, in place of its own.
    """
    by, seeds = results.study.metric, set(results.study.seeds)
    draws: dict[str, list[TrialResult]] = {}
    for trial in results.trials:
        if trial.status != "failed" and (trial.seed in seeds) != again:
            draws.setdefault(trial.label, []).append(trial)
    found = [Ranked(first, means([first, *others], by), tuple(others)) for first, *others in draws.values()]
    return sorted((one for one in found if np.isfinite(one.finals[by])), key=lambda one: -one.finals[by])


def means(trials: Sequence[TrialResult], by: str) -> dict[str, float]:
    """Metric -> mean over trainings of the mean over their last tenth."""
    return {name: float(np.mean([final_value(*each.curve(name)) for each in trials])) for name in [by, *COLUMNS]}


def default_place(ranks: Sequence[Ranked]) -> int | None:
    """Place of the first draw that has the study's own settings, from 0; None without one."""
    return next((i for i, one in enumerate(ranks) if one.trial.default), None)


def nothing_completed(ranks: Sequence[Ranked], by: str) -> bool:
    """Whether no trial completed a mesh in its last tenth, by the actions that the metric ``by`` is of."""
    completion = metric(mode_and_figure(by)[0], "completion_rate")
    return all(final_value(*trial.curve(completion)) == 0.0 for one in ranks for trial in one.trials)


def confirmation(ranks: Sequence[Ranked], again: Sequence[Ranked], study: Study) -> str:
    """What the best draws and the default do on fresh seeds, beside what they did in the search."""
    if study.search is None or study.search.confirm is None:
        return ""
    by, before = final(study.metric), {one.trial.label: one for one in ranks}
    parts = [f"## The best again on fresh seeds\n\nThe best {study.search.confirm.best} and the default."]
    if not again:
        none = ranks and nothing_completed(ranks, study.metric)
        why = "no trial completed a mesh, so that there is no best" if none else "the search is not over"
        return f"{parts[0].rpartition('The best')[0]}Not done: {why}."
    rows = []
    for one in again:
        scores = [final_value(*trial.curve(study.metric)) for trial in one.trials]
        name = Markdown(f"{bold(one.trial.label)} (default)") if one.trial.default else one.trial.label
        found = before.get(one.trial.label)
        rows.append([
            name, number(found.finals[study.metric], ".4g") if found else "-", f"{one.finals[study.metric]:.4g}",
            f"{min(scores):.4g} to {max(scores):.4g}", number(one.finals[COMPLETION], ".0%"),
            ", ".join(str(trial.seed) for trial in one.trials),
        ])  # fmt: skip
    parts.append(
        markdown(["draw", f"{by} in the search", "on fresh seeds", "of single seeds", "completed", "seeds"], rows)
    )
    usual = next((one for one in again if one.trial.default), None)
    if usual is not None:
        better = [one.trial.label for one in again if one.finals[study.metric] > usual.finals[study.metric]]
        told = (
            f"Better than the default here: {escaped(', '.join(better))}." if better else "None beats the default here."
        )
        parts.append(told)
    return "\n\n".join(parts)


def section(ranks: Sequence[Ranked], picture: Picture, study: Study) -> str:
    """The ranking in words, the picture, the best settings and the table."""
    by, default = final(study.metric), default_place(ranks)
    parts = [f"## Trials by {by}"]
    if not ranks:
        return f"{parts[0]}\n\nNo trial has an evaluation yet."
    best, finals, total = ranks[0].trial, ranks[0].finals, len(ranks)
    if nothing_completed(ranks, study.metric):
        parts.append(
            "No trial completed a mesh in the last tenth of its training: the order below says nothing, and no "
            "settings can be recommended. Give the trials more env steps, or an easier domain."
        )
    else:
        told = (
            f"The best of {count(total, 'trial')} is {escaped(best.label)} with a {by} of {finals[study.metric]:.4g}."
        )
        if default is None:
            told += " None of them has the default settings."
        else:
            usual = ranks[default].finals[study.metric]
            told += f" The default is number {default + 1} of {total}, with {usual:.4g}."
        sets = " ".join(f"--set {shlex.quote(f'{name}={value}')}" for name, value in best.settings.items())
        parts += [told, f"The best settings:\n\n{block(sets)}"]
    parts.append(picture("settings", f"{by} against each setting that was searched"))
    rows = []
    columns = {key: column for key, column in COLUMNS.items() if key != study.metric}
    for i, one in enumerate(ranks):
        trial, values = one.trial, one.finals
        name = Markdown(f"{bold(trial.label)} (default)") if i == default else trial.label
        own = [shown(value) for value in settings_of(trial, study)]
        cells = [f"{values[study.metric]:.4g}"]
        cells += [number(values[key], form) for key, (_, form) in columns.items()]
        steps = min(each.env_steps for each in one.trials)
        rows.append([f"{i + 1}", name, *own, *cells, f"{steps:,}", trial.status])
    titles = [by, *(title for title, _ in columns.values())]
    parts.append(markdown(["rank", "trial", *searched(study), *titles, "env steps", "status"], rows))
    parts.append(
        f"Figures are means over the last tenth of the training, {each_seeds(study)}: differences of a few "
        "ranks are within the noise of seeds, and the best of many trials is the luckiest, too. Trials that were "
        "stopped early are ranked by where they were stopped."
    )
    return "\n\n".join(parts)


def each_seeds(study: Study) -> str:
    """How many seeds a draw was trained with, in words."""
    return "one seed each" if len(study.seeds) == 1 else f"over {len(study.seeds)} seeds each"


def searched(study: Study) -> list[str]:
    """Names of the settings that were searched, dotted."""
    return list(study.search.space) if study.search else []


def settings_of(trial: TrialResult, study: Study) -> list[Any]:
    """A trial's values of the settings that were searched."""
    return [trial.settings.get(name, trial.config.get(name, "-")) for name in searched(study)]


def shown(value: Any) -> str:
    """A setting's value in a table: numbers to four digits."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def picture(folder: Path, ranks: Sequence[Ranked], study: Study) -> Path:
    """The metric against each setting."""
    values = zip(*(settings_of(one.trial, study) for one in ranks), strict=True)
    settings = dict(zip(searched(study), map(list, values), strict=True))
    scores = np.array([one.finals[study.metric] for one in ranks])
    return in_every_format(
        folder, "settings",
        lambda path: draw_settings(settings, scores, path, final(study.metric), default_place(ranks), study.title),
    )  # fmt: skip


def write_csv(path: Path, ranks: Sequence[Ranked], study: Study) -> Path:
    """Write the ranking."""
    default = default_place(ranks)
    rows = [
        [i + 1, one.trial.label, " ".join(str(trial.seed) for trial in one.trials), one.trial.status,
         min(trial.env_steps for trial in one.trials), int(i == default), *settings_of(one.trial, study),
         *one.finals.values()]
        for i, one in enumerate(ranks)
    ]  # fmt: skip
    metrics = dict.fromkeys([study.metric, *COLUMNS])
    header = ["rank", "trial", "seed", "status", "env_steps", "default", *searched(study), *metrics]
    return csv_files.write(path, header, rows)
