"""What a study leaves, for who called it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from freemesh_ray.policies.policy import Policy
from freemesh_ray.studies.study_folder import StudyFolder, TrialRecord
from freemesh_ray.training.run_folder import RunFolder


@dataclass(frozen=True)
class TrialResult:
    """One trial of a study.

    Attributes:
        label, seed: which.
        status: finished, stopped (by a scheduler) or failed.
        settings: that a search drew, by dotted key; None where the label says them.
        error: of a failed one, in a line.
        folder: where its files lie: ``folder.path``, ``folder.policy`` and more.
    """

    label: str
    seed: int
    status: str
    settings: Mapping[str, Any] | None
    error: str | None
    folder: RunFolder

    @classmethod
    def of(cls, record: TrialRecord, study: StudyFolder) -> TrialResult:
        """That of a record."""
        drawn = record.settings or None
        return cls(record.label, record.seed, record.status, drawn, record.error, study.run_of(record))

    @property
    def name(self) -> str:
        """Unique in its study."""
        return f"{self.label}-{self.seed}"

    @cached_property
    def policy(self) -> Policy | None:
        """The best policy, that of ``folder.policy``; None where it failed before it had one."""
        return Policy.load(self.folder.policy, altered=True) if self.folder.policy.is_file() else None

    @property
    def figures(self) -> Mapping[str, float]:
        """The best policy's evaluation, by metric."""
        return self.policy.about["scores"] if self.policy is not None else {}

    @cached_property
    def evaluations(self) -> list[dict[str, Any]]:
        """One entry an evaluation: ``env_steps``, ``seconds`` and its figures by metric."""
        return self.folder.read_evaluations()


@dataclass(frozen=True)
class StudyResult:
    """A study that came to its end.

    Attributes:
        folder: where its files lie: ``folder.path``, ``folder.trials`` and more.
        trials: all of them.
        best: the one with the best policy by the study's metric; None when no trial came to its end.
        page: where the tracking store shows it, behind the store's address; None where the store was not reached.
    """

    folder: StudyFolder
    trials: list[TrialResult]
    best: TrialResult | None
    page: str | None = None

    @property
    def report(self) -> list[Path]:
        """The files of its report, ``report.md`` among them."""
        return sorted(self.folder.report.iterdir()) if self.folder.report.is_dir() else []


def best_trial(trials: list[TrialResult], metric: str) -> TrialResult | None:
    """The trial whose best policy has the highest metric, of those that came to their end or were stopped."""
    over = [trial for trial in trials if trial.status in ("finished", "stopped") and trial.figures]
    return max(over, key=lambda trial: float(trial.figures[metric]), default=None)
