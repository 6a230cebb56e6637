"""A study's results as records: the inverse of `results.from_records`."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

from freemesh_ray.config import dump
from freemesh_ray.policies.evaluation import MODES, metric
from freemesh_ray.records.measured import Measured
from freemesh_ray.records.study_records import StudyRecords, Training
from freemesh_ray.report.best_meshes import Cut
from freemesh_ray.report.machine import machine
from freemesh_ray.report.results import Results, TrialResult
from freemesh_ray.report.transfer import Transfer
from freemesh_ray.studies.definition import Study

#: Settings that say where things lie, and how a store is reached: they are nobody else's business.
PRIVATE = ("name", "paths.", "tracking.")


def recorded(results: Results, evaluated: Transfer, cut: Cut, paper_table: str, episodes: int) -> StudyRecords:
    """The records of results; those that were read from records are these.

    Args:
        results: of the study.
        evaluated: its policies on its domains.
        cut: the meshes of each variant's best policy.
        paper_table: measured with the policies.
        episodes: of each policy on each domain.
    """
    if results.records is not None:
        return results.records
    trainings = []
    for trial in results.trials:
        key = (trial.label, trial.seed)
        there = key in evaluated.policies or key in evaluated.measured
        measured = _measured(key, evaluated, cut, episodes) if there else None
        trainings.append(_training(trial, measured))
    return StudyRecords(
        results.study.name, _definition(results.study), trainings, episodes, evaluated.digests, evaluated.skipped,
        paper_table, results.source, version("freemesh-ray"), machine(), newest(results),
    )  # fmt: skip


def newest(results: Results) -> str:
    """The day of the newest evaluation, in UTC, as 2026-01-31; empty without any."""
    files = [trial.policy.with_name("evaluations.jsonl") for trial in results.trials]
    times = [path.stat().st_mtime for path in files if path.is_file()]
    return datetime.fromtimestamp(max(times), UTC).strftime("%Y-%m-%d") if times else ""


def _measured(key: tuple[str, int], evaluated: Transfer, cut: Cut, episodes: int) -> Measured:
    figures = {
        domain: {
            metric(mode, figure): value
            for mode in MODES
            for figure, value in evaluated.figures[*key, domain, mode].items()
        }
        for domain in evaluated.domains
    }
    meshes = {domain: meshes[key] for domain, meshes in cut.items() if key in meshes}
    return Measured(episodes, figures, evaluated.digests, meshes, evaluated.commits.get(key, ""))


def _training(trial: TrialResult, measured: Measured | None) -> Training:
    return Training(
        trial.label, trial.seed, trial.run, trial.status, trial.error, trial.settings, _public(trial.config),
        trial.evaluations, trial.updates, measured,
    )  # fmt: skip


def _definition(study: Study) -> str:
    """The study as its file has it, without settings that are private."""
    tree = study.tree()
    tree["settings"] = _public(tree["settings"])
    if "variants" in tree["study"]:
        tree["study"]["variants"] = {label: _public(each) for label, each in tree["study"]["variants"].items()}
    return dump(tree)


def _public(settings: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in settings.items() if not str(key).startswith(PRIVATE)}
