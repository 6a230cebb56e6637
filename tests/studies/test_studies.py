"""Studies of a fake algorithm on a real Ray: shared runs, failures, kills, resumption, searches."""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from process_tree import running

from freemesh_ray.report.one_study import write
from freemesh_ray.storage.lock import held
from freemesh_ray.studies.study_folder import StudyFolder
from freemesh_ray.tracking import mlflow_store, sync

pytestmark = pytest.mark.slow

SCRIPT = Path(__file__).parents[1] / "fake_study.py"
SETTINGS = {
    "curriculum.stages": ["T1"],
    "runners.count": 0,
    "budget.env_steps": 600,
    "budget.minutes": None,
    "evaluation.interval": 200,
    "tracking.enabled": False,
}


def written(folder: Path, name: str, study: dict, **settings: object) -> Path:
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump({"study": {"title": "A test", **study}, "settings": {**SETTINGS, **settings}}))
    return path


def environment(folder: Path, pause: float = 0.0) -> dict[str, str]:
    return {**os.environ, "FAKE_LOG": str(folder / "log"), "FAKE_PAUSE": str(pause)}


def command(path: Path, *options: str) -> list[str]:
    return [sys.executable, str(SCRIPT), str(path), *options]


def run(path: Path, *options: str, code: int = 0) -> str:
    done = subprocess.run(
        command(path, *options), cwd=path.parent, env=environment(path.parent), capture_output=True, text=True,
        timeout=300,
    )  # fmt: skip
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout


def log(folder: Path) -> list[str]:
    path = folder / "log"
    return path.read_text().splitlines() if path.is_file() else []


def statuses(folder: Path, name: str) -> dict[str, str]:
    entries = StudyFolder(folder / "studies" / name).read()
    return {f"{entry.label}-{entry.seed}": entry.status for entry in entries}


def evaluated(folder: Path, name: str) -> list[list[int]]:
    study = StudyFolder(folder / "studies" / name)
    paths = [study.path / entry.run / "evaluations.jsonl" for entry in study.read()]
    return [[json.loads(line)["env_steps"] for line in path.read_text().splitlines()] for path in paths]


def killed_when(path: Path, ready: Callable[[], bool], how: signal.Signals = signal.SIGKILL, pause: float = 0.1) -> int:
    """Start a study and end it by a signal as soon as ``ready()``; its exit code."""
    process = subprocess.Popen(
        command(path), cwd=path.parent, env=environment(path.parent, pause), stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )  # fmt: skip
    give_up = time.monotonic() + 200
    while not ready():
        assert process.poll() is None, "it ended before it was killed"
        assert time.monotonic() < give_up
        time.sleep(0.05)
    process.send_signal(how)
    return process.wait(timeout=100)


def test_what_a_study_has_trained_no_other_trains_again_and_a_failure_sinks_neither(tmp_path: Path) -> None:
    batches = {"small": {"learner.batch_size": 8}, "usual": None}
    first = written(tmp_path, "first", {"variants": batches, "seeds": [1, 2]})
    assert "4/4" in run(first)
    assert statuses(tmp_path, "first") == dict.fromkeys(("small-1", "small-2", "usual-1", "usual-2"), "finished")
    assert evaluated(tmp_path, "first") == [[200, 400, 600]] * 4
    assert not list((tmp_path / "studies" / "first" / "tune").glob("*/checkpoint_*"))  # no replay buffers are left
    assert Counter(log(tmp_path)) == {f"begin {size}/{seed}": 1 for size in (8, 256) for seed in (1, 2)}

    unlucky = {"unlucky": {"learner.batch_size": 13}, "usual": {"learner.batch_size": 256}}
    second = written(tmp_path, "second", {"variants": unlucky, "seeds": [1], "retries": 2})
    output = run(second)
    assert statuses(tmp_path, "second") == {"unlucky-1": "failed", "usual-1": "finished"}
    entries = StudyFolder(tmp_path / "studies" / "second").read()
    assert [entry.shared for entry in entries] == [False, True]
    assert "batches of thirteen bring bad luck" in (entries[0].error or "")
    assert "batches of thirteen bring bad luck" in output
    later = Counter(log(tmp_path))
    assert later["begin 256/1"] == 1  # not again
    assert later["fail 13/1"] == 3  # tried, and tried again twice


def test_what_is_recorded_is_not_trained_again(tmp_path: Path) -> None:
    """On another machine, whose study has one more seed."""
    there, here = tmp_path / "there", tmp_path / "here"
    there.mkdir()
    here.mkdir()
    variants = {"small": {"learner.batch_size": 8}, "usual": None}
    run(written(there, "first", {"variants": variants, "seeds": [1, 2]}))
    place = there / "studies" / "first"
    write(place, episodes=2)
    figures = evaluated(there, "first")
    path = written(here, "first", {"variants": variants, "seeds": [1, 2, 3]})
    output = run(path, str(place / "report"))
    assert "4 trainings taken from records" in output
    assert "6 trials of 600 env steps, 4 of them trained before" in output
    assert "4 of 6 finished trainings are from records, without their policies: the best is chosen among the" in output
    assert Counter(log(here)) == {f"begin {size}/3": 1 for size in (8, 256)}
    assert set(statuses(here, "first").values()) == {"finished"}
    assert evaluated(here, "first") == [figures[0]] * 6
    write(here / "studies" / "first", episodes=2)
    theirs, ours = (
        list(csv.DictReader((each / "report" / "final.csv").open())) for each in (place, here / "studies/first")
    )
    for row in [*theirs, *ours]:  # the return to reach is half the best variant's, and another with more seeds
        del row[next(key for key in row if re.fullmatch(r"steps_to_[-\d.]+", key))]
    assert [row for row in ours if row["seed"] != "3"] == theirs
    assert "0 trainings taken from records, 4 more of them were here already" in run(path, "--resume", str(place))


def test_two_studies_at_once_train_what_both_need_once(tmp_path: Path, blank_database: Path) -> None:
    shutil.copy(blank_database, tmp_path / "mlflow.db")
    study = {"variants": {"usual": {"learner.batch_size": 256}}, "seeds": [1]}
    paths = [written(tmp_path, name, study, **{"tracking.enabled": True}) for name in ("first", "second")]
    processes = [
        subprocess.Popen(
            command(path), cwd=tmp_path, env=environment(tmp_path, 0.3), stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True,
        )
        for path in paths
    ]  # fmt: skip
    for process in processes:
        output, _ = process.communicate(timeout=300)
        assert process.returncode == 0, output
    assert Counter(log(tmp_path))["begin 256/1"] == 1
    assert [statuses(tmp_path, name) for name in ("first", "second")] == [{"usual-1": "finished"}] * 2
    assert evaluated(tmp_path, "first") == evaluated(tmp_path, "second") == [[200, 400, 600]]
    sync(tmp_path, f"sqlite:///{tmp_path / 'mlflow.db'}")
    client = mlflow_store.connect(f"sqlite:///{tmp_path / 'mlflow.db'}")
    runs = client.search_runs([client.get_experiment_by_name("freemesh").experiment_id])
    names = {run.info.run_id: run.info.run_name for run in runs}
    above = [names[run.data.tags["mlflow.parentRunId"]] for run in runs if "mlflow.parentRunId" in run.data.tags]
    assert sorted(above) == ["first", "second"], "the training is listed in both"


def test_two_processes_do_not_run_one_study(tmp_path: Path) -> None:
    path = written(tmp_path, "twice", {"variants": {"small": {"learner.batch_size": 8}}, "seeds": [1]})
    folder = tmp_path / "studies" / "twice"
    folder.mkdir(parents=True)
    with held(folder, "wait for its end"):
        second = subprocess.run(
            command(path, "--resume"), cwd=tmp_path, env=environment(tmp_path), capture_output=True, text=True,
            timeout=300,
        )  # fmt: skip
    assert second.returncode != 0
    line = second.stderr.splitlines()[-1]
    assert f"studies/twice: process {os.getpid()} on " in line
    assert line.endswith("wait for its end")


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_a_study_though_its_trials_are_amid_a_step(how: signal.Signals, tmp_path: Path) -> None:
    path = written(tmp_path, "long", {"variants": {"small": {"learner.batch_size": 8}}, "seeds": [1]})
    with running(command(path)[1:], tmp_path, environment(tmp_path, 1000.0)) as study:
        study.until(lambda: "begin 8/1" in log(tmp_path), 300, "begins")
        study.until(lambda: statuses(tmp_path, "long") == {"small-1": "running"}, 60, "is known to run")
        began = time.monotonic()
        study.process.send_signal(how)
        assert study.ended(120) != 0
        print(f"{time.monotonic() - began:.1f} s")
    assert study.output.splitlines()[-1].startswith("KeyboardInterrupt")
    assert statuses(tmp_path, "long") == {"small-1": "running"}


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_study_goes_on_where_it_was(how: signal.Signals, tmp_path: Path) -> None:
    path = written(
        tmp_path, "killed", {"variants": {"small": {"learner.batch_size": 8}, "usual": None}, "seeds": [1, 2]}
    )

    def ready() -> bool:
        known = statuses(tmp_path, "killed")
        saved = list((tmp_path / "studies" / "killed" / "tune").glob("*/checkpoint_*/progress.json"))
        return sum(status == "finished" for status in known.values()) >= 1 and len(saved) >= 2

    assert killed_when(path, ready, how) != 0
    finished = {name for name, status in statuses(tmp_path, "killed").items() if status == "finished"}
    before = Counter(log(tmp_path))
    run(path, "--resume")
    assert set(statuses(tmp_path, "killed").values()) == {"finished"}
    assert evaluated(tmp_path, "killed") == [[200, 400, 600]] * 4
    after = Counter(log(tmp_path))
    sizes = {"small": 8, "usual": 256}
    for name in finished:
        label, _, seed = name.rpartition("-")
        key = f"begin {sizes[label]}/{seed}"
        assert after[key] == before[key]  # not run again
    begun = "already holds a study"
    again = subprocess.run(command(path), cwd=tmp_path, env=environment(tmp_path), capture_output=True, text=True)
    assert again.returncode
    assert begun in again.stderr


def test_a_killed_search_keeps_its_trials_and_its_searcher(tmp_path: Path) -> None:
    pytest.importorskip("optuna")
    space = {"learner.batch_size": {"choice": [8, 16, 32]}, "learner.gamma": {"uniform": [0.9, 0.99]}}
    search = {"trials": 6, "scheduler": "asha", "grace": 200, "reduction": 2, "space": space}
    study = {"search": search, "seeds": [1], "metric": "eval_stochastic/invalid"}
    path = written(tmp_path, "search", study, **{"learner.batch_size": 16, "learner.gamma": 0.95})

    def entries() -> list:
        return StudyFolder(tmp_path / "studies" / "search").read()

    killed_when(path, lambda: sum(entry.status in ("finished", "stopped") for entry in entries()) >= 2)
    before = {entry.run: entry for entry in entries()}
    run(path, "--resume")
    after = {entry.run: entry for entry in entries()}
    assert len(after) == 6
    assert {entry.status for entry in after.values()} <= {"finished", "stopped"}
    for key, entry in before.items():
        assert after[key].settings == entry.settings
    defaults = [entry for entry in after.values() if entry.label == "default"]
    assert [entry.settings for entry in defaults] == [{"learner.batch_size": 16, "learner.gamma": 0.95}]
    gammas = [entry.settings["learner.gamma"] for entry in after.values()]
    assert len(set(gammas)) == 6
    assert all(0.9 <= gamma <= 0.99 for gamma in gammas)


def test_population_based_training_changes_settings_within_their_space(tmp_path: Path) -> None:
    search = {
        "trials": 3,
        "scheduler": "pbt",
        "perturbation": 200,
        "space": {"learner.gamma": {"uniform": [0.9, 0.99]}},
    }
    path = written(tmp_path, "pbt", {"search": search, "seeds": [1], "metric": "eval_stochastic/invalid"})
    run(path)
    entries = StudyFolder(tmp_path / "studies" / "pbt").read()
    assert [entry.status for entry in entries] == ["finished"] * 3
    assert all(0.9 <= entry.settings["learner.gamma"] <= 0.99 for entry in entries)
    assert any(line.startswith("restore") for line in log(tmp_path))


def test_finished_trials_go_on_where_they_ended_when_a_study_is_extended(tmp_path: Path) -> None:
    study = {"variants": {"small": {"learner.batch_size": 8}}, "seeds": [1]}
    path = written(tmp_path, "longer", study)
    run(path)
    (short,) = (tmp_path / "runs").iterdir()
    assert [place.name for place in (short / "checkpoints").iterdir()] == ["step_000000600"]
    written(tmp_path, "longer", {**study, "seeds": [1, 2]}, **{"budget.env_steps": 1000})
    run(path, "--resume")
    assert statuses(tmp_path, "longer") == {"small-1": "finished", "small-2": "finished"}
    assert evaluated(tmp_path, "longer") == [[200, 400, 600, 800, 1000]] * 2
    assert "restore 8/1 600" in log(tmp_path)
    assert not any(line.startswith("restore 8/2") for line in log(tmp_path))
    assert not (short / "checkpoints").exists()  # the longer one's are kept
    assert sorted((tmp_path / "runs").glob("*/checkpoints/*/state.npz"))
    other = written(tmp_path, "other", study, **{"budget.env_steps": 1400})
    run(other)
    assert "restore 8/1 1000" in log(tmp_path)  # of another study, too
    assert evaluated(tmp_path, "other") == [[200, 400, 600, 800, 1000, 1200, 1400]]


def test_a_search_is_scored_over_seeds_its_best_are_confirmed_and_trials_are_added(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("optuna")
    space = {"learner.gamma": {"uniform": [0.9, 0.99]}}
    search = {"trials": 2, "scheduler": "none", "space": space, "confirm": {"best": 1, "seeds": [5, 6]}}
    study = {"search": search, "seeds": [1, 2], "metric": "eval_stochastic/element_quality"}
    path = written(tmp_path, "seeds", study, **{"learner.batch_size": 16})
    folder = StudyFolder(tmp_path / "studies" / "seeds")

    monkeypatch.setenv("FAKE_COMPLETION", "0")
    assert "nothing to confirm: no draw completed a mesh" in run(path)
    own = folder.read()
    assert [entry.status for entry in own] == ["finished"] * 4
    assert [entry.seed for entry in own] == [1, 2, 1, 2]
    assert evaluated(tmp_path, "seeds") == [[200, 400, 600]] * 4
    labels = {entry.label for entry in own}
    (drawn,) = labels - {"default"}
    assert re.fullmatch(r"gamma 0\.9\d* \(\w{4}\)", drawn)
    assert sum("gamma-0.9" in entry.run for entry in own) == 2
    gammas = {entry.label: entry.settings["learner.gamma"] for entry in own}

    monkeypatch.setenv("FAKE_COMPLETION", "1")
    written(tmp_path, "seeds", {**study, "search": {**search, "trials": 3}}, **{"learner.batch_size": 16})
    before = Counter(log(tmp_path))
    assert "again on 2 fresh seeds: 5, 6" in run(path, "--resume")
    after = folder.read()
    assert after[:4] == own  # they are not drawn again
    began = Counter(log(tmp_path)) - before
    assert [began[f"begin 16/{seed}"] for seed in (1, 2)] == [1, 1]
    again = [entry for entry in after if entry.seed in (5, 6)]
    assert {entry.status for entry in again} == {"finished"}
    assert "default" in {entry.label for entry in again}
    assert len(again) == 2 * len({entry.label for entry in again}) == sum(began[f"begin 16/{seed}"] for seed in (5, 6))
    assert all(
        entry.settings["learner.gamma"] == gammas.get(entry.label, entry.settings["learner.gamma"]) for entry in again
    )
