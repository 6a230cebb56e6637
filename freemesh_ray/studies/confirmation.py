"""A search's best draws, and its default, trained again on fresh seeds: the best of many is the luckiest, too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from freemesh_ray.policies.evaluation import metric, mode_and_figure
from freemesh_ray.statistics.aligned_curves import final_value
from freemesh_ray.studies.definition import Study
from freemesh_ray.studies.plan import DEFAULT, Trial, VariantPlan, placed
from freemesh_ray.studies.study_folder import StudyFolder, TrialRecord


def of_search(study: Study, records: Sequence[TrialRecord]) -> list[TrialRecord]:
    """The trainings of a study without those that confirm a search, which have fresh seeds."""
    return [record for record in records if study.search is None or record.seed in study.seeds]


def draws(study: Study, records: Sequence[TrialRecord]) -> dict[str, list[TrialRecord]]:
    """Label -> the trainings of a draw, one a seed."""
    found: dict[str, list[TrialRecord]] = {}
    for record in of_search(study, records):
        found.setdefault(record.label, []).append(record)
    return found


def score(folder: StudyFolder, records: Sequence[TrialRecord], figure: str) -> float:
    """A draw's figure at its end: the mean over its seeds; NaN where one has none."""
    rows = [folder.run_of(record).read_evaluations() for record in records]
    steps = [[row["env_steps"] for row in each] for each in rows]
    values = [[row.get(figure, np.nan) for row in each] for each in rows]
    return float(np.mean([final_value(*curve) for curve in zip(steps, values, strict=True)]))


def chosen(study: Study, folder: StudyFolder, records: Sequence[TrialRecord]) -> list[TrialRecord]:
    """A training of each draw that is confirmed: of the finished ones the best, the best first, and the default.

    Nothing where no draw completed a mesh at its end: there is no best then.
    """
    assert study.search is not None
    assert study.search.confirm is not None
    over = {
        label: each
        for label, each in draws(study, records).items()
        if all(record.status == "finished" for record in each)
    }
    completion = metric(mode_and_figure(study.metric)[0], "completion_rate")
    if not any(score(folder, each, completion) > 0 for each in over.values()):
        return []
    scores = {label: score(folder, each, study.metric) for label, each in over.items()}
    ranked = sorted((label for label in over if np.isfinite(scores[label])), key=lambda label: -scores[label])
    best = ranked[: study.search.confirm.best]
    return [over[label][0] for label in dict.fromkeys([*best, *(label for label in ranked if label == DEFAULT)])]


def confirmation_plan(
    study: Study, folder: StudyFolder, records: Sequence[TrialRecord], source: Mapping[str, str]
) -> VariantPlan:
    """The trainings that confirm a search which is over."""
    assert study.search is not None
    found: dict[str, Trial] = {}
    for record in chosen(study, folder, records) if study.search.confirm else []:
        drawn = record.settings or {}
        for seed in study.search.confirm.seeds if study.search.confirm else []:
            trial = Trial(record.label, seed, placed(study.trial_config(None, seed, drawn), source), drawn)
            found[trial.name] = trial
    return VariantPlan(found)
