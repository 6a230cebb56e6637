"""What a study left on disk: its description, its trials and their evaluations.

studies/NAME/study.yaml    the resolved study
             trials.json   one entry a trial: label, seed, run folder, status
RUN/evaluations.jsonl      one line an evaluation (freemesh_ray.training.run_folder)
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from envs.types import Floats
from freemesh_ray.config import ConfigError, flatten, read_plain
from freemesh_ray.studies.study_folder import Entry, StudyFolder
from freemesh_ray.training.run_folder import RunError, RunFolder, evaluated_at

#: The paper's learning curves: mean return of ten evaluation episodes every 10,000 steps.
RETURN = "eval_deterministic/return"


class ResultsError(RunError):
    """A study whose results cannot be read; one line with the file, what is wrong and the fix."""


@dataclass(frozen=True)
class Trial:
    """One training of the study.

    Attributes:
        label: of its variant.
        seed: of the training.
        run: where its files lie; some or all may be missing yet.
        status: one of `STATUSES`.
        error: why it failed; empty otherwise.
        settings: dotted key -> value that a search gave it; empty without a search.
    """

    label: str
    seed: int
    run: RunFolder
    status: str
    error: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def finished(self) -> bool:
        """Whether it took its whole budget."""
        return self.status == "finished"

    @property
    def under_way(self) -> bool:
        """Whether it may still add to the results."""
        return self.status in ("running", "pending")

    @cached_property
    def evaluations(self) -> list[dict[str, Any]]:
        """One entry an evaluation, in the order of their steps; a damaged line, as a kill leaves it, is left out."""
        try:
            lines = self.run.evaluations.read_text(encoding="utf-8", errors="replace").splitlines()
        except OSError:
            return []
        return [json.loads(line) for line in sorted(lines, key=evaluated_at) if math.isfinite(evaluated_at(line))]

    @cached_property
    def config(self) -> dict[str, Any]:
        """Dotted key -> value of the run's resolved configuration; empty when there is none."""
        try:
            return flatten(read_plain(self.run.config))
        except (AttributeError, ConfigError):
            return {}

    @property
    def env_steps(self) -> int:
        """Env steps at the last evaluation; 0 before the first."""
        return int(self.evaluations[-1]["env_steps"]) if self.evaluations else 0

    @property
    def seconds(self) -> float:
        """Wall clock of the training up to its last evaluation."""
        return number(self.evaluations[-1].get("seconds", 0.0)) if self.evaluations else 0.0

    def curve(self, figure: str) -> tuple[Floats, Floats]:
        """Env steps and a figure of all evaluations, each (t,); NaN where an evaluation lacks it."""
        steps = np.array([row["env_steps"] for row in self.evaluations], dtype=np.float64)
        return steps, np.array([number(row.get(figure)) for row in self.evaluations], dtype=np.float64)


def number(value: Any) -> float:
    """A figure as a float; NaN where it is none."""
    try:
        return float(value) if isinstance(value, int | float) else math.nan
    except OverflowError:
        return math.nan


@dataclass(frozen=True)
class Expectation:
    """What the paper claims of two variants.

    Attributes:
        better, worse: their labels.
    """

    better: str
    worse: str

    def __str__(self) -> str:
        return f"{self.better} > {self.worse}"


@dataclass(frozen=True)
class Results:
    """A study and its trials.

    Attributes:
        folder: of the study; its name is the study's.
        title: of the figure.
        paper: where the figure or table stands in the paper; may be empty.
        finding: what the paper finds; may be empty.
        expects: comparisons by the metric's final value that the paper's finding amounts to.
        variants: label -> dotted settings that differ, in the study's order.
        seeds: of the trials of each variant.
        domains: what every trained policy is evaluated on.
        settings: dotted settings common to all trials.
        metric: the figure of an evaluation that variants, or a search's trials, are judged by.
        search: whether it is a search: one trial a label, with settings of its own.
        trials: all of them, in the study's order.
    """

    folder: Path
    title: str
    paper: str
    finding: str
    expects: Sequence[Expectation]
    variants: Mapping[str, Mapping[str, Any]]
    seeds: Sequence[int]
    domains: Sequence[str]
    settings: Mapping[str, Any]
    metric: str
    search: bool
    trials: Sequence[Trial]

    @property
    def name(self) -> str:
        """The study's name."""
        return self.folder.resolve().name

    @property
    def unfinished(self) -> list[Trial]:
        """Trials that may still add to the results."""
        return [trial for trial in self.trials if trial.under_way]

    def of(self, label: str) -> list[Trial]:
        """The trials of a variant."""
        return [trial for trial in self.trials if trial.label == label]


def read(folder: Path) -> Results:
    """The results that lie in ``folder``.

    Raises:
        ResultsError: no such study, none of its trials was begun, or a file that is not what it should be.
    """
    description, tree = folder / "study.yaml", _description(folder)
    about, settings = tree["study"], tree.get("settings") or {}
    trials = _trials(folder)
    try:
        variants: dict[str, Mapping[str, Any]] = {
            str(label): flatten(own or {}) for label, own in (about.get("variants") or {}).items()
        }
        for trial in trials:
            variants.setdefault(trial.label, trial.settings)
        return Results(
            folder=folder,
            title=str(about.get("title") or folder.resolve().name),
            paper=str(about.get("paper") or ""),
            finding=str(about.get("finding") or ""),
            expects=[_expectation(str(text), variants, description) for text in about.get("expects") or []],
            variants=variants,
            seeds=[int(seed) for seed in about.get("seeds") or []],
            domains=[str(domain) for domain in about.get("domains") or []],
            settings=flatten(settings),
            metric=str(about.get("metric") or RETURN),
            search=bool(about.get("search")),
            trials=trials,
        )
    except (AttributeError, TypeError, ValueError, OverflowError, RecursionError) as error:
        if isinstance(error, ResultsError):
            raise
        raise ResultsError(f"{description}: is not a study's ({error}): let `freemesh study` write it anew") from error


def _description(folder: Path) -> dict[str, Any]:
    path = folder / "study.yaml"
    try:
        with path.open("rb"):
            pass
        tree = read_plain(path)
    except OSError:
        there = sorted(entry.parent.name for entry in folder.parent.glob("*/study.yaml"))
        known = f"there {'is' if len(there) == 1 else 'are'} {', '.join(there)}" if there else "there are none"
        raise ResultsError(
            f"{folder}: no such study: {known} in {folder.parent}; `freemesh study NAME` begins one"
        ) from None
    except ConfigError as error:
        raise ResultsError(f"{path}: is not valid YAML: let `freemesh study` write it anew") from error
    if not isinstance(tree, dict) or not isinstance(tree.get("study"), dict):
        raise ResultsError(f"{path}: has no section study: let `freemesh study` write it anew")
    return tree


def _trials(folder: Path) -> list[Trial]:
    path = StudyFolder(folder).trials
    try:
        trials = [_trial(entry, folder) for entry in StudyFolder(folder).read()]
    except (RunError, ValueError, TypeError, AttributeError, RecursionError) as error:
        reason = str(error).partition(": ")[2] if isinstance(error, RunError) else repr(error)
        raise ResultsError(f"{path}: {reason}") from error
    if not trials:
        raise ResultsError(f"{path}: no trial yet: begin with `freemesh study {folder.resolve().name}`")
    return trials


def _trial(entry: Entry, folder: Path) -> Trial:
    run, settings = RunFolder(folder / entry.run), flatten(entry.settings or {})
    return Trial(str(entry.label), int(entry.seed), run, entry.status, entry.error or "", settings)


def _expectation(text: str, labels: Mapping[str, Any], path: Path) -> Expectation:
    better, above, worse = (part.strip() for part in text.partition(">"))
    for label in (better, worse):
        if not above or label not in labels:
            raise ResultsError(f"{path}: study.expects: {text!r}: write A > B, of the labels {', '.join(labels)}")
    return Expectation(better, worse)
