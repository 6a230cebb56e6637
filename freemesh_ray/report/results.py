"""What a study left on disk: the study, its trials and their evaluations."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from envs.errors import PluginError
from envs.printable import printable
from envs.types import Floats
from freemesh_ray.config import ConfigError, composed, flatten, plain, read_plain
from freemesh_ray.records import measured_file, parquet_file
from freemesh_ray.records.measured import Measured
from freemesh_ray.records.study_records import RecordsError, StudyRecords, Training
from freemesh_ray.storage.json_file import read_json
from freemesh_ray.studies.completion_mark import finished
from freemesh_ray.studies.definition import Study, load
from freemesh_ray.studies.plan import default_point, point
from freemesh_ray.studies.study_folder import STATUSES, StudyError, StudyFolder, TrialRecord

#: What makes a link, a picture or HTML of a text; the paper's tables have none.
MARKUP = re.compile(r"[\[\]<`]")


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
        updates: gradient updates at its end; None where that is not known.
        measured: of its best policy, from records: the policy itself is not at hand.
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
    updates: int | None = None
    measured: Measured | None = None

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
        source: package -> digest of the code, or version, that trained; empty where that is not known.
        records: what they were read from, where it was no study's folder.
        preface: what the report says of where they come from, in Markdown; empty of one study.
        folder: of the study; None where they are of no study's folder.
        single: whether they are a single training's, which no study has.
    """

    study: Study
    trials: Sequence[TrialResult]
    source: Mapping[str, str] = field(default_factory=dict)
    records: StudyRecords | None = None
    preface: str = ""
    folder: Path | None = None
    single: bool = False

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
    trials = [_trial(folder, record, point(record.settings or {}) == own) for record in records]
    return Results(study, trials, _source(folder.source), folder=path)


def from_records(path: Path) -> Results:
    """The results in a records file.

    Raises:
        RecordsError: it is none, or damaged, or names an algorithm that cannot be had here.
    """
    records = parquet_file.read(path)
    try:
        tree = plain(node, "study") if (node := composed(records.study, "study")) is not None else None
        if not isinstance(tree, Mapping) or not is_name(records.name) or MARKUP.search(records.paper_table):
            raise RecordsError(f"{path}: holds no study: take another copy")
        study = replace(load(tree, beside=False), name=records.name)
    except (ConfigError, PluginError) as error:
        raise RecordsError(f"{path}: its study cannot be read here ({error}): take another copy") from error
    usual = default_point(study) if study.search else None
    own = None if usual is None else flatten({key: _plain(value) for key, value in usual.items()})
    trials = [_recorded(each, path, each.drawn == own) for each in records.trainings]
    if not trials or not {trial.status for trial in trials} <= set(STATUSES):
        raise RecordsError(f"{path}: holds no trial, or one in an unknown state: take another copy")
    return Results(study, trials, records.source, records)


def is_name(text: str) -> bool:
    """Whether a study of records may be called so: files are named after it."""
    return text == printable(text) == Path(text).name and 0 < len(text) <= 100 and not text.startswith(".")


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _recorded(training: Training, path: Path, default: bool) -> TrialResult:
    policy = path.parent / "nowhere" / training.run.replace("/", "-") / "policy.npz"
    return TrialResult(
        training.label, training.seed, training.run, policy, training.status, training.error, training.drawn, default,
        training.settings, training.evaluations, training.updates, training.measured,
    )  # fmt: skip


def _source(path: Path) -> dict[str, str]:
    try:
        found = read_json(path)
    except (OSError, ValueError):
        return {}
    return {str(key): str(value) for key, value in found.items()} if isinstance(found, dict) else {}


def _trial(folder: StudyFolder, record: TrialRecord, default: bool) -> TrialResult:
    run = folder.run_of(record)
    try:
        config = flatten(read_plain(run.config))
    except (AttributeError, ConfigError):
        config = {}
    updates = (finished(run) or {}).get("updates")
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
        updates if isinstance(updates, int) else None,
        None if run.policy.is_file() else measured_file.read(run.path),
    )
