"""Tracking through a real MLflow server that is killed in the middle of a study."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from processes import ROOT, Server

from freemesh_ray.policies.policy import DEFAULT
from freemesh_ray.tracking import MLflowRun, mlflow_store, sync

pytestmark = pytest.mark.slow

#: A trial, as a process of its own; it goes on whenever a line comes in, and its store is gone when it ends.
TRIAL = """
import sys
from pathlib import Path
from freemesh_ray.tracking import MLflowRun
folder, uri, parent, seed = sys.argv[1:]
with MLflowRun(folder, uri=uri, experiment="killed", name=f"trial-{seed}", params={"seed": seed}, parent=parent) as run:
    for step in range(200):
        run.metrics({"loss": step / 7, "return": -step}, step)
    print(run.wait(float(sys.stdin.readline())), flush=True)
    sys.stdin.readline()
    for step in range(200, 400):
        run.metrics({"loss": step / 7, "return": -step}, step)
    Path(folder, "mesh.svg").write_text("<svg/>")
    run.artifact(Path(folder, "mesh.svg"))
"""
STEPS = {"study": 3000, "trial-0": 400, "trial-1": 400, "trial-2": 400}


@dataclass
class Story:
    """What happened: the study saw its server die and come back, its trials saw it die or never saw it.

    Attributes:
        client: of the server, up again.
        runs: by name, before `sync`, and after.
        delivered: what two calls of `sync` in a row returned.
        slowest: seconds that the slowest call of ``metrics`` took.
    """

    client: Any
    before: dict[str, Any]
    after: dict[str, Any]
    delivered: tuple[int, int]
    slowest: float


@pytest.fixture(scope="module")
def story(served_store: Server, tmp_path_factory: pytest.TempPathFactory) -> Story:
    folder, slowest = tmp_path_factory.mktemp("study"), 0.0
    trials: list[subprocess.Popen[str]] = []

    def record(study: MLflowRun, first: int) -> None:
        nonlocal slowest
        for step in range(first, first + 1000):
            begin = time.perf_counter()
            study.metrics({"loss": step / 7, "return": -step}, step)
            slowest = max(slowest, time.perf_counter() - begin)

    def begin(seed: int, seconds: int) -> None:
        arguments = [str(folder / f"trial-{seed}"), served_store.url, str(study.id), str(seed)]
        trial = subprocess.Popen(
            [sys.executable, "-c", TRIAL, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )
        assert trial.stdin is not None
        trial.stdin.write(f"{seconds}\n")
        trial.stdin.flush()
        trials.append(trial)

    def at_work() -> list[str]:
        return [trial.stdout.readline().strip() for trial in trials if trial.stdout]

    try:
        with MLflowRun(folder, uri=served_store.url, experiment="killed", name="study", flush_seconds=60) as study:
            record(study, 0)
            begin(0, 60)
            begin(1, 60)
            assert study.wait(60)
            assert "None" not in at_work()
            served_store.kill()
            record(study, 1000)
            begin(2, 0)
            for trial in trials:
                trial.communicate("\n", timeout=60)
            study.model(DEFAULT, name="killed")
            served_store.start()
            record(study, 2000)
    finally:
        for trial in trials:
            trial.kill()
    client = mlflow_store.connect(served_store.url)
    before = runs(client)
    delivered = sync(folder, served_store.url), sync(folder, served_store.url)
    return Story(client, before, runs(client), delivered, slowest)


def runs(client: Any) -> dict[str, Any]:
    experiment = client.get_experiment_by_name("killed")
    return {run.info.run_name: run for run in client.search_runs([experiment.experiment_id])}


def history(client: Any, run: Any, key: str) -> list[tuple[int, float]]:
    return sorted((metric.step, metric.value) for metric in client.get_metric_history(run.info.run_id, key))


def test_a_server_that_comes_back_gets_everything_within_the_run_and_once(story: Story):
    study = story.before["study"]
    assert study.info.status == "FINISHED"
    assert history(story.client, study, "loss") == [(step, step / 7) for step in range(STEPS["study"])]
    assert history(story.client, study, "return") == [(step, -step) for step in range(STEPS["study"])]
    version = story.client.get_model_version_by_alias("killed", "best")
    assert (str(version.version), version.run_id) == ("1", study.info.run_id)


def test_a_server_that_stays_away_gets_everything_by_sync_and_once(story: Story):
    assert story.delivered[0] > 0
    assert story.delivered[1] == 0
    assert story.before["trial-0"].info.status == "RUNNING"
    assert "trial-2" not in story.before
    assert set(story.after) == set(STEPS)
    for name, steps in STEPS.items():
        assert story.after[name].info.status == "FINISHED"
        assert history(story.client, story.after[name], "loss") == [(step, step / 7) for step in range(steps)]
        assert history(story.client, story.after[name], "return") == [(step, -step) for step in range(steps)]
    for name in STEPS.keys() - {"study"}:
        (artifact,) = story.client.list_artifacts(story.after[name].info.run_id)
        assert artifact.path == "mesh.svg"


def test_the_database_holds_no_number_twice(story: Story, served_store: Server):
    with sqlite3.connect(served_store.log.parent / "mlflow.db") as database:
        for run_id, name in ((run.info.run_id, name) for name, run in story.after.items()):
            (rows,) = database.execute("select count(*) from metrics where run_uuid = ?", (run_id,)).fetchone()
            assert rows == 2 * STEPS[name]


def test_trials_of_processes_of_their_own_hang_below_the_study(story: Story):
    parents = {name: run.data.tags.get("mlflow.parentRunId") for name, run in story.after.items()}
    study = story.after["study"].info.run_id
    assert parents == {"study": None, "trial-0": study, "trial-1": study, "trial-2": study}


def test_a_server_that_is_stopped_holds_up_nothing_and_gets_everything_once(
    served_store: Server, tmp_path: Path
) -> None:
    """It accepts connections (the kernel does), and answers none."""
    with MLflowRun(tmp_path, uri=served_store.url, experiment="stopped", name="run", flush_seconds=1) as run:
        run.metrics({"loss": 0.0}, 0)
        assert run.wait(60)
        os.killpg(served_store.pid, signal.SIGSTOP)
        try:
            for step in range(1, 1000):
                run.metrics({"loss": step / 7}, step)
            run.close()
            # It is over, and nobody has let the server go on.
            (journal,) = tmp_path.rglob("*.jsonl")
            assert journal.read_text().count('"metrics"') == 1000
        finally:
            os.killpg(served_store.pid, signal.SIGCONT)
    client = mlflow_store.connect(served_store.url)
    deadline = time.monotonic() + 300
    while True:  # the run's own thread may be amid a request that the server has begun to answer
        sync(tmp_path, served_store.url)
        (found,) = client.search_runs([client.get_experiment_by_name("stopped").experiment_id])
        if found.info.status == "FINISHED":
            break
        assert time.monotonic() < deadline
        time.sleep(1)
    assert history(client, found, "loss") == [(step, step / 7) for step in range(1000)]


def test_no_record_waited_for_the_dead_server(story: Story):
    assert story.slowest < 1
