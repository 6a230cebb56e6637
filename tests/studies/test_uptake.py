"""Trainings taken up from records: a study that another machine ran goes on here, with the same report."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from recorded_study import policy, rows, saturating

from freemesh_ray.cli import command
from freemesh_ray.config import dump
from freemesh_ray.records import parquet_file
from freemesh_ray.records.schema import FILE
from freemesh_ray.records.study_records import RecordsError
from freemesh_ray.report.one_study import write
from freemesh_ray.studies import uptake
from freemesh_ray.studies.completion_mark import FINISHED, finished
from freemesh_ray.studies.definition import Study, load
from freemesh_ray.studies.plan import variant_plan
from freemesh_ray.studies.returned import TrialResult, best_trial
from freemesh_ray.studies.runner import folder_of, planned, records_of, take_up_recorded, without_policy
from freemesh_ray.studies.study_folder import StudyFolder
from freemesh_ray.studies.training_source import training_source

SQUARE = [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]]
STUDY = {
    "study": {
        "title": "A study",
        "seeds": [1, 2, 3],
        "variants": {"usual": None, "near": {"learner.gamma": 0.9}},
        "expects": ["usual > near"],
        "metric": "eval_deterministic/return",
    },
    "settings": {"budget.env_steps": 100_000, "curriculum.stages": ["T1"]},
}


def study(home: Path, monkeypatch: pytest.MonkeyPatch, **more: object) -> Study:
    """The study of a machine whose home it is."""
    home.mkdir(exist_ok=True)
    (home / "square.json").write_text(json.dumps(SQUARE))
    monkeypatch.setenv("FREEMESH_HOME", str(home))
    monkeypatch.chdir(home)
    return load({**STUDY, "study": {**STUDY["study"], "domains": ["square.json"], **more}})


def trained(of: Study) -> StudyFolder:
    """Its folder when all was trained, by a formula, and its report is written."""
    folder = folder_of(of)
    folder.make()
    folder.claim(of, resume=False)
    plan = variant_plan(of, training_source())
    for i, trial in enumerate(plan.trials.values()):
        run = trial.folder
        run.path.mkdir(parents=True)
        at = np.arange(5_000, 100_001, 5_000)
        found = rows(at, saturating(at, 60.0 - i, 2e4, 2.0, np.random.default_rng(i)))
        run.config.write_text(dump(trial.config))
        run.evaluations.write_text("".join(json.dumps(row) + "\n" for row in found))
        policy(i).save(run.policy)
        (run.path / FINISHED).write_text(json.dumps({**found[-1], "updates": 50_000}))
    folder.write(records_of(plan, folder))
    write(folder.path, episodes=2)
    return folder


@pytest.mark.slow
def test_what_another_machine_trained_counts_as_finished_with_the_same_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = trained(study(tmp_path / "there", monkeypatch))
    records = shutil.copy(there.report / FILE, tmp_path / FILE)
    before = {
        path.name: path.read_bytes() for path in there.report.iterdir() if path.suffix in (".csv", ".png", ".svg")
    }
    shutil.rmtree(tmp_path / "there")

    here = study(tmp_path / "here", monkeypatch)
    told: list[str] = []
    take_up_recorded(planned(here)[1], uptake.read([records]), told.append)
    assert told == ["6 trainings taken from records"]
    folder, plan, found = planned(here)
    assert {record.status for record in found} == {"finished"}
    folder.make()
    folder.claim(here, resume=False)
    folder.write(found)
    text = write(folder.path, episodes=2).read_text()
    assert {name: (folder.report / name).read_bytes() for name in before} == before
    assert "6 trials from records, without their policies" in text
    assert parquet_file.read(folder.report / FILE).trainings[0].measured is not None
    for trial in plan.trials.values():
        last = finished(trial.folder)
        assert last is not None
        assert (last["env_steps"], last["updates"]) == (100_000, 50_000)
        assert not trial.folder.policy.exists()
    trials = [TrialResult.of(record, folder) for record in found]
    assert best_trial(trials, here.metric) is None
    assert without_policy(trials) == (
        "6 of 6 finished trainings are from records, without their policies: no policy is registered"
    )

    told.clear()
    take_up_recorded(planned(here)[1], uptake.read([records]), told.append)
    assert told == ["0 trainings taken from records, 6 more of them were here already"]


@pytest.mark.slow
def test_recorded_again_they_are_the_same_records(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """But for the day that they were opened on."""
    there = trained(study(tmp_path / "there", monkeypatch))
    here = study(tmp_path / "here", monkeypatch)
    folder, plan, _ = planned(here)
    uptake.take_up(plan, uptake.read([there.path]))
    folder.make()
    folder.claim(here, resume=False)
    folder.write(planned(here)[2])
    write(folder.path, episodes=2)
    one, other = (parquet_file.read(each.report / FILE) for each in (there, folder))
    assert [vars(each) | {"measured": None} for each in one.trainings] == [
        vars(each) | {"measured": None} for each in other.trainings
    ]
    assert [each.measured.figures for each in one.trainings] == [each.measured.figures for each in other.trainings]
    assert (one.study, one.source, one.domains) == (other.study, other.source, other.domains)


@pytest.mark.slow
def test_only_the_same_settings_seeds_steps_and_source_match(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    there = trained(study(tmp_path / "there", monkeypatch))
    recorded = uptake.read([there.path, there.report / FILE])
    assert len(recorded) == 6
    home = tmp_path / "here"
    more = study(home, monkeypatch, seeds=[1, 2, 9])
    plan = planned(more)[1]
    assert str(uptake.take_up(plan, recorded)) == (
        "4 trainings taken from records; 2 do not match (other settings, seed, steps or source)"
    )
    statuses = {record.name: record.status for record in planned(more)[2]}
    assert statuses == {f"{label}-{seed}": "pending" if seed == 9 else "finished"
                        for label in ("usual", "near") for seed in (1, 2, 9)}  # fmt: skip
    other = variant_plan(study(tmp_path / "third", monkeypatch), {**training_source(), "envs": "another"})
    assert len(uptake.take_up(other, recorded).taken) == 0
    longer = load({**STUDY, "settings": {**STUDY["settings"], "budget.env_steps": 200_000}})
    assert len(uptake.take_up(planned(longer)[1], recorded).taken) == 0


@pytest.mark.slow
def test_figures_of_another_domain_or_fewer_episodes_do_not_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = trained(study(tmp_path / "there", monkeypatch))
    here = study(tmp_path / "here", monkeypatch)
    folder, plan, _ = planned(here)
    uptake.take_up(plan, uptake.read([there.path]))
    folder.make()
    folder.claim(here, resume=False)
    folder.write(planned(here)[2])
    assert "its records are of 2 episodes, not 3" in write(folder.path, episodes=3).read_text()
    (tmp_path / "here" / "square.json").write_text(json.dumps([[2 * x, y] for x, y in SQUARE]))
    text = write(folder.path, episodes=2).read_text()
    assert "its records are of another domain called square, and its policy is not at hand" in text
    assert "| usual" in text


@pytest.mark.slow
def test_a_beginning_that_was_cut_short_gives_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    there = trained(study(tmp_path / "there", monkeypatch))
    here = study(tmp_path / "here", monkeypatch)
    plan = planned(here)[1]
    first = next(iter(plan.trials.values())).folder
    first.path.mkdir(parents=True)
    first.evaluations.write_text('{"env_steps": 5}\n')
    policy(1).save(first.policy)
    uptake.take_up(plan, uptake.read([there.path]))
    assert len(first.read_evaluations()) == 20
    assert not first.policy.exists()


@pytest.mark.slow
def test_the_command_says_what_is_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    there = trained(study(tmp_path / "there", monkeypatch))
    study(tmp_path / "here", monkeypatch)
    Path("a-study.yaml").write_text(dump({**STUDY, "study": {**STUDY["study"], "seeds": [1, 9]}}))
    assert command.main(["study", "a-study.yaml", "--records", str(there.path), "--dry-run"]) == 0
    shown = capsys.readouterr().out
    assert shown.count("in records") == 2
    assert shown.count("pending") == 2
    with pytest.raises(RecordsError, match=r"no records\.parquet in it"):
        uptake.read([tmp_path / "here"])
