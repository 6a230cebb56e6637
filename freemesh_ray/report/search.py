"""A search's report: its trials from the best to the worst, where the default stands, and what each setting does."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from freemesh_ray import config
from freemesh_ray.formatting.figures import cell, count, final
from freemesh_ray.formatting.table import markdown, number
from freemesh_ray.plots import draw_settings
from freemesh_ray.report import numbers
from freemesh_ray.report.learning import COMPLETION, QUALITY, RETURN
from freemesh_ray.report.pictures import both
from freemesh_ray.report.results import Results, Trial
from freemesh_ray.report.sections import Picture
from freemesh_ray.statistics.curves import LAST, final_score

#: Figures of a trial beside its settings -> column, format.
COLUMNS = {RETURN: ("return", ".1f"), COMPLETION: ("completed", ".0%"), QUALITY: ("eta", ".3f")}


@dataclass(frozen=True)
class Ranked:
    """A search's trials that have an evaluation, the best first.

    Attributes:
        trials: with the final figures of each, by figure.
        names: of the settings that were searched, dotted.
        default: place of the trial whose settings are the defaults, from 0; None without one.
    """

    trials: Sequence[tuple[Trial, dict[str, float]]]
    names: Sequence[str]
    default: int | None


def ranked(results: Results) -> Ranked:
    """The trials by the study's metric: the mean of their last evaluations."""
    scored = []
    for trial in results.trials:
        figures = {figure: final_score(trial.curve(figure)[1]) for figure in [results.metric, *COLUMNS]}
        if trial.status != "failed" and np.isfinite(figures[results.metric]):
            scored.append((trial, figures))
    scored.sort(key=lambda entry: -entry[1][results.metric])
    names = list(dict.fromkeys(name for trial in results.trials for name in trial.settings))
    usual = config.flatten(config.load()) | dict(results.settings)
    places = [i for i, (trial, _) in enumerate(scored) if is_default(trial, usual)]
    return Ranked(scored, names, places[0] if places else None)


def is_default(trial: Trial, usual: dict[str, Any]) -> bool:
    """Whether a trial was given nothing but what holds without the search."""
    return all(usual.get(name) == value for name, value in trial.settings.items())


def section(found: Ranked, picture: Picture, results: Results) -> str:
    """The ranking in words, the picture, the best settings and the table."""
    if not found.trials:
        return f"## Trials by {final(results.metric)}\n\nNo trial has an evaluation yet."
    (best, figures), total = found.trials[0], len(found.trials)
    by = final(results.metric)
    parts = [f"## Trials by {by}"]
    told = f"The best of {count(total, 'trial')} is {best.label} with a {by} of {figures[results.metric]:.4g}."
    if found.default is None:
        told += " None of them has the default settings."
    else:
        usual = found.trials[found.default][1][results.metric]
        told += f" The default is number {found.default + 1} of {total}, with {usual:.4g}."
    parts.append(told)
    if best.settings:
        sets = " ".join(f"--set {shlex.quote(f'{name}={value}')}" for name, value in best.settings.items())
        parts.append(f"The best settings:\n\n```\n{sets}\n```")
    if drawn(found):
        parts.append(picture("settings", f"{by} against each setting that was searched"))
    rows = []
    columns = {key: column for key, column in COLUMNS.items() if key != results.metric}
    for i, (trial, values) in enumerate(found.trials):
        name = f"**{cell(trial.label)}** (default)" if i == found.default else cell(trial.label)
        own = [cell(shown(value_of(trial, setting, results))) for setting in found.names]
        cells = [f"{values[results.metric]:.4g}"]
        cells += [number(values[key], form) for key, (_, form) in columns.items()]
        rows.append([f"{i + 1}", name, *own, *cells, f"{trial.env_steps:,}", trial.status])
    titles = [by, *(title for title, _ in columns.values())]
    parts.append(markdown(["rank", "trial", *found.names, *titles, "env steps", "status"], rows))
    parts.append(
        f"Figures are means of the last {LAST} evaluations, one seed each: differences of a few "
        "ranks are within the noise of a seed, and the best of many trials is the luckiest, too. Trials that were "
        "stopped early are ranked by where they were stopped."
    )
    return "\n\n".join(parts)


def value_of(trial: Trial, name: str, results: Results) -> Any:
    """What a trial's setting was: as it was searched, or as it is for all."""
    return trial.settings.get(name, trial.config.get(name, results.settings.get(name, "-")))


def shown(value: Any) -> str:
    """A setting's value in a table: numbers to four digits."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def drawn(found: Ranked) -> bool:
    """Whether there is something to draw."""
    return bool(found.trials and found.names)


def picture(folder: Path, found: Ranked, results: Results) -> Path:
    """The metric against each setting."""
    settings = {name: [value_of(trial, name, results) for trial, _ in found.trials] for name in found.names}
    scores = np.array([figures[results.metric] for _, figures in found.trials])
    return both(
        folder, "settings",
        lambda path: draw_settings(settings, scores, path, final(results.metric), found.default, results.title),
    )  # fmt: skip


def table(path: Path, found: Ranked, results: Results) -> Path:
    """Write the ranking."""
    rows = [
        [i + 1, trial.label, trial.seed, trial.status, trial.env_steps, int(i == found.default),
         *(value_of(trial, name, results) for name in found.names), *figures.values()]
        for i, (trial, figures) in enumerate(found.trials)
    ]  # fmt: skip
    figures = dict.fromkeys([results.metric, *COLUMNS])
    return numbers.write(
        path, ["rank", "trial", "seed", "status", "env_steps", "default", *found.names, *figures], rows
    )
