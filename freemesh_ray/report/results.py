"""What a study left on disk: the study, its trials and their evaluations."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from envs.types import Floats
from freemesh_ray.config import ConfigError, flatten, read_plain
from freemesh_ray.studies.definition import Study
from freemesh_ray.studies.plan import default_point, point
from freemesh_ray.studies.study_folder import StudyError, StudyFolder, TrialRecord


@dataclass(frozen=True)
class TrialResult:
    """One training of the study.

    Attributes:
        label: of its variant.
        seed: of the training.
        run: name of its run folder.
        policy: file of its best policy, which may be missing yet.
        status: one of `study_folder.STATUSES`.
        error: why it failed; empty otherwise.
        settings: dotted key -> value that a search gave it; empty without a search.
        default: whether a search gave it the study's own settings.
        config: dotted key -> value of its resolved configuration; empty when there is none.
        evaluations: figures of each, in the order of their steps.
    """

    label: str
    seed: int
    run: str
    policy: Path
    status: str
    error: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    default: bool = False
    config: Mapping[str, Any] = field(default_factory=dict)
    evaluations: Sequence[Mapping[str, Any]] = ()

    @property
    def finished(self) -> bool:
        """Whether it took its whole budget."""
        return self.status == "finished"

    @property
    def under_way(self) -> bool:
        """Whether it may still add to the results."""
        return self.status in ("running", "pending")

    @property
    def env_steps(self) -> int:
        """Env steps at the last evaluation; 0 before the first."""
        return int(self.evaluations[-1]["env_steps"]) if self.evaluations else 0

    @property
    def seconds(self) -> float:
        """Wall clock of the training up to its last evaluation."""
        return number(self.evaluations[-1].get("seconds", 0.0)) if self.evaluations else 0.0

    def curve(self, metric: str) -> tuple[Floats, Floats]:
        """Env steps and a metric of all evaluations, each (t,); NaN where an evaluation lacks it."""
        steps = np.array([row["env_steps"] for row in self.evaluations], dtype=np.float64)
        return steps, np.array([number(row.get(metric)) for row in self.evaluations], dtype=np.float64)


def number(value: Any) -> float:
    """A figure as a float; NaN where it is none."""
    try:
        return float(value) if isinstance(value, int | float) else math.nan
    except OverflowError:
        return math.nan


@dataclass(frozen=True)
class Results:
    """A study and what came of it.

    Attributes:
        study: as it was begun.
        trials: all of them, in the study's order.
    """

    study: Study
    trials: Sequence[TrialResult]

    @property
    def labels(self) -> list[str]:
        """Of the variants, in the study's order; of a search, of its trials."""
        return list(dict.fromkeys([*self.study.variants, *(trial.label for trial in self.trials)]))

    @property
    def unfinished(self) -> list[TrialResult]:
        """Trials that may still add to the results."""
        return [trial for trial in self.trials if trial.under_way]

    def of(self, label: str) -> list[TrialResult]:
        """The trials of a variant."""
        return [trial for trial in self.trials if trial.label == label]


def read(path: Path) -> Results:
    """The results that lie in the folder ``path``.

    Raises:
        StudyError: no such study, none of its trials was begun, or the list of its trials is damaged.
        ConfigError: its definition is damaged.
    """
    folder = StudyFolder(path)
    study, records = folder.study(), folder.read()
    if not records:
        raise StudyError(f"{folder.trials}: no trial yet: begin with `freemesh study {study.name}`")
    own = default_point(study) if study.search else None
    return Results(study, [_trial(folder, record, point(record.settings or {}) == own) for record in records])


def _trial(folder: StudyFolder, record: TrialRecord, default: bool) -> TrialResult:
    run = folder.run_of(record)
    try:
        config = flatten(read_plain(run.config))
    except (AttributeError, ConfigError):
        config = {}
    return TrialResult(
        record.label,
        record.seed,
        run.path.name,
        run.policy,
        record.status,
        record.error or "",
        flatten(record.settings or {}),
        default,
        config,
        run.read_evaluations(),
    )
