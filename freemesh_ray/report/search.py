"""A search's report: its trials from the best to the worst, where the default stands, and what each setting does."""

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
from freemesh_ray.report.formats import count, final
from freemesh_ray.report.pictures import in_every_format
from freemesh_ray.report.results import Results, TrialResult
from freemesh_ray.report.sections import Picture
from freemesh_ray.statistics.curves import final_value
from freemesh_ray.studies.definition import Study

#: Metrics of a trial beside its settings -> column, format.
COLUMNS = {RETURN: ("return", ".1f"), COMPLETION: ("completed", ".0%"), QUALITY: ("eta", ".3f")}


class Ranked(NamedTuple):
    """A trial that has an evaluation.

    Attributes:
        trial: it.
        finals: metric -> mean over the last tenth of its training: the study's metric, then those of `COLUMNS`.
    """

    trial: TrialResult
    finals: dict[str, float]


def ranking(results: Results) -> list[Ranked]:
    """The trials by the study's metric, the best first."""
    by = results.study.metric
    found = [
        Ranked(trial, {name: final_value(*trial.curve(name)) for name in [by, *COLUMNS]})
        for trial in results.trials
        if trial.status != "failed"
    ]
    return sorted((one for one in found if np.isfinite(one.finals[by])), key=lambda one: -one.finals[by])


def default_place(ranks: Sequence[Ranked]) -> int | None:
    """Place of the first trial that has the study's own settings, from 0; None without one."""
    return next((i for i, (trial, _) in enumerate(ranks) if trial.default), None)


def nothing_completed(ranks: Sequence[Ranked], by: str) -> bool:
    """Whether no trial completed a mesh in its last tenth, by the actions that the metric ``by`` is of."""
    completion = metric(mode_and_figure(by)[0], "completion_rate")
    return all(final_value(*trial.curve(completion)) == 0.0 for trial, _ in ranks)


def section(ranks: Sequence[Ranked], picture: Picture, study: Study) -> str:
    """The ranking in words, the picture, the best settings and the table."""
    by, default = final(study.metric), default_place(ranks)
    parts = [f"## Trials by {by}"]
    if not ranks:
        return f"{parts[0]}\n\nNo trial has an evaluation yet."
    (best, finals), total = ranks[0], len(ranks)
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
    for i, (trial, values) in enumerate(ranks):
        name = Markdown(f"{bold(trial.label)} (default)") if i == default else trial.label
        own = [shown(value) for value in settings_of(trial, study)]
        cells = [f"{values[study.metric]:.4g}"]
        cells += [number(values[key], form) for key, (_, form) in columns.items()]
        rows.append([f"{i + 1}", name, *own, *cells, f"{trial.env_steps:,}", trial.status])
    titles = [by, *(title for title, _ in columns.values())]
    parts.append(markdown(["rank", "trial", *searched(study), *titles, "env steps", "status"], rows))
    parts.append(
        "Figures are means over the last tenth of the training, one seed each: differences of a few "
        "ranks are within the noise of a seed, and the best of many trials is the luckiest, too. Trials that were "
        "stopped early are ranked by where they were stopped."
    )
    return "\n\n".join(parts)


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
    values = zip(*(settings_of(trial, study) for trial, _ in ranks), strict=True)
    settings = dict(zip(searched(study), map(list, values), strict=True))
    scores = np.array([finals[study.metric] for _, finals in ranks])
    return in_every_format(
        folder, "settings",
        lambda path: draw_settings(settings, scores, path, final(study.metric), default_place(ranks), study.title),
    )  # fmt: skip


def write_csv(path: Path, ranks: Sequence[Ranked], study: Study) -> Path:
    """Write the ranking."""
    default = default_place(ranks)
    rows = [
        [i + 1, trial.label, trial.seed, trial.status, trial.env_steps, int(i == default),
         *settings_of(trial, study), *finals.values()]
        for i, (trial, finals) in enumerate(ranks)
    ]  # fmt: skip
    metrics = dict.fromkeys([study.metric, *COLUMNS])
    header = ["rank", "trial", "seed", "status", "env_steps", "default", *searched(study), *metrics]
    return csv_files.write(path, header, rows)
