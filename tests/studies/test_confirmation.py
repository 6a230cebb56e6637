"""Which draws of a search are trained again on fresh seeds, and what the report says of it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from freemesh_ray.report.ranked_draws import confirmation, ranking
from freemesh_ray.report.results import Results, read
from freemesh_ray.studies.confirmation import chosen, confirmation_plan
from freemesh_ray.studies.definition import Study, load
from freemesh_ray.studies.study_folder import StudyFolder, TrialRecord

SEARCH = {
    "study": {
        "title": "A search",
        "seeds": [1, 2],
        "metric": "eval_stochastic/score",
        "search": {
            "trials": 4,
            "space": {"learner.gamma": {"uniform": [0.5, 0.99]}},
            "confirm": {"best": 2, "seeds": [7, 8, 9]},
        },
    },
    "settings": {"learner.gamma": 0.9},
}
#: Draw -> gamma and its seeds' scores: the lucky one is best with one seed only.
DRAWS = {
    "default": (0.9, [0.3, 0.3]), "good": (0.8, [0.6, 0.7]), "lucky": (0.7, [0.9, 0.1]), "fair": (0.6, [0.5, 0.6]),
}  # fmt: skip


def searched(folder: Path, completed: float = 1.0) -> tuple[Study, StudyFolder]:
    place = StudyFolder(folder / "a-search")
    place.make()
    study = place.claim(load(SEARCH), resume=False)
    records = []
    for label, (gamma, scores) in DRAWS.items():
        for seed, score in zip(study.seeds, scores, strict=True):
            record = TrialRecord(label, seed, f"runs/{label}-{seed}", "finished", {"learner.gamma": gamma})
            evaluated(place, record, score, completed)
            records.append(record)
    place.write(records)
    return study, place


def evaluated(place: StudyFolder, record: TrialRecord, score: float, completed: float = 1.0) -> None:
    run = place.run_of(record)
    run.path.mkdir(parents=True)
    figures = {f"eval_{mode}/{name}": value
               for mode in ("deterministic", "stochastic")
               for name, value in (("score", score), ("completion_rate", completed), ("return", 1.0),
                                   ("element_quality", score))}  # fmt: skip
    run.evaluations.write_text(json.dumps({"env_steps": 100, **figures}) + "\n")


def test_the_best_by_the_mean_over_seeds_and_the_default_are_chosen(tmp_path: Path) -> None:
    study, folder = searched(tmp_path)
    assert [record.label for record in chosen(study, folder, folder.read())] == ["good", "fair", "default"]
    plan = confirmation_plan(study, folder, folder.read(), {})
    assert list(plan.trials) == [f"{label}-{seed}" for label in ("good", "fair", "default") for seed in (7, 8, 9)]
    assert plan.trials["good-7"].config["learner"]["gamma"] == 0.8
    assert len({trial.folder.path for trial in plan.trials.values()}) == 9


@pytest.mark.parametrize("status", ["stopped", "failed"])
def test_what_did_not_come_to_its_end_is_not_chosen(status: str, tmp_path: Path) -> None:
    study, folder = searched(tmp_path)
    records = folder.read()
    next(record for record in records if record.label == "good").status = status
    assert [record.label for record in chosen(study, folder, records)] == ["fair", "lucky", "default"]


def test_nothing_is_chosen_where_nothing_completed_and_the_report_says_so(tmp_path: Path) -> None:
    study, folder = searched(tmp_path, completed=0.0)
    assert chosen(study, folder, folder.read()) == []
    assert "no trial completed a mesh" in told(read(folder.path))


def told(results: Results) -> str:
    return confirmation(ranking(results), ranking(results, again=True), results.study)


def test_the_report_ranks_draws_by_their_mean_and_tells_what_was_confirmed(tmp_path: Path) -> None:
    study, folder = searched(tmp_path)
    ranks = ranking(read(folder.path))
    assert [one.trial.label for one in ranks] == ["good", "fair", "lucky", "default"]
    assert ranks[0].finals[study.metric] == pytest.approx(0.65)
    again = [
        TrialRecord(label, seed, f"runs/{label}-{seed}", "finished", {"learner.gamma": DRAWS[label][0]})
        for label in ("good", "default")
        for seed in (7, 8)
    ]
    for record in again:
        evaluated(folder, record, 0.5 if record.label == "good" else 0.4)
    folder.write([*folder.read(), *again])
    results = read(folder.path)
    assert [one.trial.label for one in ranking(results)] == ["good", "fair", "lucky", "default"]
    text = told(results)
    assert "| good | 0.65 | 0.5 | 0.5 to 0.5 | 100% | 7, 8 |" in " ".join(text.split())
    assert "Better than the default here: good." in text
