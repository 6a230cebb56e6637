"""Tracking against a real sqlite store, against none at all, and through killed and resumed processes."""

from __future__ import annotations

import json
import logging
import math
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from checkout import ROOT

from freemesh_ray.config import flatten, load
from freemesh_ray.tracking import MLflowRun, TrackingError, absolute, mlflow_store, page, share, sync
from freemesh_ray.tracking import mlflow_run as recording
from freemesh_ray.tracking.journal import Journal
from freemesh_ray.tracking.provenance import provenance
from freemesh_ray.tracking.uploader import Uploader

pytestmark = pytest.mark.slow

REFUSING = "http://127.0.0.1:9"


@pytest.fixture
def uri(blank_database: Path, tmp_path: Path) -> str:
    shutil.copy(blank_database, tmp_path / "mlflow.db")
    return f"sqlite:///{tmp_path / 'mlflow.db'}"


@pytest.fixture
def silent_server() -> Iterator[str]:
    """The address of a server that takes connections and never answers."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"http://127.0.0.1:{server.getsockname()[1]}"


def started(folder: Path, uri: str, **changes: Any) -> MLflowRun:
    return MLflowRun(folder, **({"uri": uri, "experiment": "test", "name": "one"} | changes))


def client(uri: str) -> Any:
    return mlflow_store.mlflow_client()(uri)


def runs(uri: str) -> list[Any]:
    mlflow = client(uri)
    return mlflow.search_runs([experiment.experiment_id for experiment in mlflow.search_experiments()])


def only_run(uri: str) -> Any:
    (run,) = runs(uri)
    return run


def history(uri: str, key: str) -> list[tuple[int, float]]:
    return sorted((m.step, m.value) for m in client(uri).get_metric_history(only_run(uri).info.run_id, key))


# ---- what arrives ----------------------------------------------------------------------------------------------------


def test_every_metric_arrives_once_and_the_run_is_finished(tmp_path: Path, uri: str):
    with started(tmp_path / "run", uri) as run:
        for step in range(0, 3000, 2):
            run.metrics({"loss": step / 7, "return": -step}, step)
    assert history(uri, "loss") == [(step, step / 7) for step in range(0, 3000, 2)]
    assert history(uri, "return") == [(step, -step) for step in range(0, 3000, 2)]
    found = only_run(uri)
    assert (found.info.status, found.info.run_name, found.info.run_id) == ("FINISHED", "one", run.run_id)


def test_the_configuration_arrives_as_params_and_where_it_ran_as_tags(tmp_path: Path, uri: str):
    params = flatten(load()) | {"long": "x" * 900, "empty": "", **{f"many.{i}": i for i in range(250)}}
    with started(tmp_path / "run", uri, params=params, tags={"study": "a"}):
        pass
    data = only_run(uri).data
    assert data.params == {key: str(value)[:500] for key, value in params.items()}
    assert data.tags["study"] == "a"
    assert provenance().items() <= data.tags.items()
    assert data.tags["commit"] == data.tags["mlflow.source.git.commit"]


def test_the_metric_that_comes_first_is_of_an_evaluation(tmp_path: Path, uri: str):
    with started(tmp_path / "run", uri) as run:
        for step in range(1, 4):
            run.metrics({"train/stage": 0, "learner/alpha": 1 / step}, step)
        run.metrics({"eval_deterministic/return": 5.0}, 3)
        run.metrics({"train/stage": 1}, 4)
    assert list(only_run(uri).data.metrics) == ["eval_deterministic/return", "train/stage", "learner/alpha"]
    assert history(uri, "train/stage") == [(1, 0), (2, 0), (3, 0), (4, 1)]
    assert history(uri, "learner/alpha") == [(1, 1), (2, 1 / 2), (3, 1 / 3)]


def test_a_run_without_an_evaluation_has_all_its_metrics(tmp_path: Path, uri: str):
    with started(tmp_path / "run", uri) as run:
        run.metrics({"train/stage": 0}, 1)
        run.metrics({}, 2)
    assert history(uri, "train/stage") == [(1, 0)]
    with started(tmp_path / "run", uri, resume=True) as again:
        again.metrics({"train/stage": 1}, 2)
        assert '"train/stage": 1.0' in next((tmp_path / "run" / "tracking").glob("*.jsonl")).read_text()
    assert history(uri, "train/stage") == [(1, 0), (2, 1)]


def test_a_runs_page_is_known_from_its_folder(tmp_path: Path, uri: str):
    assert page(tmp_path) is None
    with started(tmp_path / "run", uri) as run:
        pass
    assert page(tmp_path / "run") == run.page == f"#/experiments/1/runs/{run.run_id}/model-metrics"


@pytest.mark.parametrize("text", ["javascript:x", "#/x\x1b[2J", "", 5, "#/" + "x" * 501])
def test_a_state_with_another_page_is_none(text: Any, tmp_path: Path, uri: str):
    with started(tmp_path / "run", uri):
        pass
    (about,) = (tmp_path / "run" / "tracking").glob("*.json")
    about.write_text(json.dumps(json.loads(about.read_text()) | {"page": text}))
    assert page(tmp_path / "run") is None


def test_artifacts_lie_beside_the_database(tmp_path: Path, uri: str):
    with started(tmp_path / "run", uri) as run:
        (tmp_path / "run" / "mesh.svg").write_text("<svg/>")
        run.artifact(tmp_path / "run" / "mesh.svg", "meshes")
        run.artifact(tmp_path / "run" / "mesh.svg")
        run.artifact(tmp_path / "run" / "absent.png")
        run.metrics({"after": 1}, 1)
    place = tmp_path / "mlartifacts" / str(run.run_id) / "artifacts"
    assert only_run(uri).info.artifact_uri == place.as_uri()
    assert {path.relative_to(place).as_posix() for path in place.rglob("*.svg")} == {"meshes/mesh.svg", "mesh.svg"}
    assert history(uri, "after") == [(1, 1)]


@pytest.mark.parametrize(
    ("error", "status"),
    [(RuntimeError("boom"), "FAILED"), (KeyboardInterrupt(), "KILLED"), (SystemExit(1), "FAILED"),
     (SystemExit(0), "FINISHED")],
)  # fmt: skip
def test_how_a_run_ends_is_its_status(tmp_path: Path, uri: str, error: BaseException, status: str):
    with pytest.raises(type(error)), started(tmp_path / "run", uri):
        raise error
    assert only_run(uri).info.status == status


def test_a_metric_is_there_before_the_run_ends(tmp_path: Path, uri: str):
    with started(tmp_path / "run", uri) as run:
        run.metrics({"loss": 1.0}, 1)
        assert run.wait(10) is not None
        deadline = time.monotonic() + 10
        while not history(uri, "loss") and time.monotonic() < deadline:
            time.sleep(0.1)
        assert history(uri, "loss") == [(1, 1.0)]
        assert only_run(uri).info.status == "RUNNING"


def test_numbers_of_every_kind_and_odd_names_do_no_harm(tmp_path: Path, uri: str):
    class Odd:
        def __float__(self) -> float:
            return 2.5

    odd = {"nan": math.nan, "inf": -math.inf, "odd": Odd(), "text": "fast", "none": None, "*?/../a//b": 1, "é" * 300: 1}
    with started(tmp_path / "run", uri) as run:
        run.metrics(odd, 1)  # type: ignore[arg-type]
        run.metrics({"good": 1.0}, 1)
        run.metrics({"good": 1.0}, "no step")  # type: ignore[arg-type]
    metrics = only_run(uri).data.metrics
    assert math.isnan(metrics["nan"])
    assert metrics["inf"] < -1e308
    assert metrics["odd"] == 2.5
    assert metrics["a/b"] == 1
    assert metrics["good"] == 1.0
    assert set(metrics) == {"nan", "inf", "odd", "a/b", "good", "_" * 250}


def test_many_threads_may_record(tmp_path: Path, uri: str):
    with started(tmp_path / "run", uri) as run:
        threads = [
            threading.Thread(
                target=lambda base: [run.metrics({"x": base + i}, base + i) for i in range(100)], args=(k,)
            )
            for k in range(0, 800, 100)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert history(uri, "x") == [(i, i) for i in range(800)]


def test_runs_of_one_store_may_begin_at_the_same_time(tmp_path: Path, uri: str):
    many = [started(tmp_path / f"run{i}", uri, name=f"{i}") for i in range(4)]
    for i, run in enumerate(many):
        run.metrics({"x": i}, 0)
    for run in many:
        run.close()
    assert sorted((run.info.run_name, run.info.status, run.data.metrics["x"]) for run in runs(uri)) == [
        (f"{i}", "FINISHED", i) for i in range(4)
    ]


def test_processes_may_make_a_store_together(tmp_path: Path):
    uri = f"sqlite:///{tmp_path}/new/mlflow.db"
    code = (
        "import sys; from freemesh_ray.tracking import MLflowRun\n"
        "with MLflowRun(sys.argv[1], uri=sys.argv[2], experiment='test', name='x', flush_seconds=30) as run: pass\n"
        "sys.exit(run.run_id is None)"
    )
    root = ROOT
    both = [subprocess.Popen([sys.executable, "-c", code, f"{tmp_path}/{i}", uri], cwd=root) for i in range(2)]
    assert [process.wait(300) for process in both] == [0, 0]
    assert [run.info.status for run in runs(uri)] == ["FINISHED", "FINISHED"]


def test_a_disabled_run_does_nothing(tmp_path: Path, uri: str):
    with started(tmp_path / "run", uri, enabled=False) as run:
        run.metrics({"x": 1}, 1)
        run.artifact(tmp_path)
        assert run.wait(10) is None
    assert not (tmp_path / "run").exists()
    assert runs(uri) == []


def test_importing_the_module_does_not_import_mlflow():
    code = "import sys, freemesh_ray.tracking; sys.exit('mlflow' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False, cwd=ROOT).returncode == 0


def test_a_relative_store_is_the_same_from_everywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    assert absolute("sqlite:///a/b.db") == f"sqlite:///{tmp_path}/a/b.db"
    for uri in (absolute("sqlite:///a.db"), "sqlite:///:memory:", "http://127.0.0.1:5000"):
        assert absolute(uri) == uri


def test_provenance_without_git(monkeypatch: pytest.MonkeyPatch):
    assert {"version.ray", "version.torch", "version.mlflow"} <= set(provenance())
    monkeypatch.setenv("PATH", "")
    assert "mlflow.source.git.commit" not in provenance()


# ---- resumption and death --------------------------------------------------------------------------------------------


def test_a_resumed_run_goes_on_and_sends_nothing_twice(tmp_path: Path, uri: str):
    run = started(tmp_path / "run", uri, params={"a": 1, "b": 2})
    for step in range(5):
        run.metrics({"loss": step}, step)
    run.close("FAILED")
    with started(tmp_path / "run", uri, params={"a": 1, "b": 3, "c": 4}, resume=True) as again:
        assert again.run_id == run.run_id
        for step in range(3, 8):
            again.metrics({"loss": 10 + step}, step)
    assert history(uri, "loss") == [(0, 0), (1, 1), (2, 2), (3, 3), (4, 4), (5, 15), (6, 16), (7, 17)]
    found = only_run(uri)
    assert found.info.status == "FINISHED"
    assert found.data.params == {"a": "1", "b": "2", "c": "4"}
    assert found.data.tags["resumed.b"] == "3"


def test_a_second_run_in_a_folder_is_a_run_of_its_own(tmp_path: Path, uri: str):
    for value in (1.0, 2.0):
        with started(tmp_path / "run", uri) as run:
            run.metrics({"loss": value}, 1)
    assert sorted(run.data.metrics["loss"] for run in runs(uri)) == [1.0, 2.0]


VICTIM = """
import sys, time
from freemesh_ray.tracking import MLflowRun
run = MLflowRun(sys.argv[1], uri=sys.argv[2], experiment="test", name="victim")
run.metrics({"loss": 1.0}, 1)
run.wait(30)
run.metrics({"loss": 2.0}, 2)
print(run.run_id, flush=True)
time.sleep(60)
"""


def killed(folder: Path, uri: str) -> str:
    """The MLflow id of a run whose process was killed at work; what it recorded last may not have been delivered."""
    with subprocess.Popen(
        [sys.executable, "-c", VICTIM, str(folder), uri],
        stdout=subprocess.PIPE, text=True, cwd=ROOT,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        run_id = process.stdout.readline().strip()
        process.send_signal(signal.SIGKILL)
    assert run_id
    return run_id


def test_a_killed_run_is_failed_by_the_next_start_with_all_it_recorded(tmp_path: Path, uri: str):
    alive = started(tmp_path / "alive", uri, name="alive", folders=[tmp_path])
    dead = killed(tmp_path / "dead", uri)
    assert client(uri).get_run(dead).info.status == "RUNNING"
    with started(tmp_path / "next", uri, folders=[tmp_path]):
        pass
    assert client(uri).get_run(dead).info.status == "FAILED"
    assert [metric.step for metric in client(uri).get_metric_history(dead, "loss")] == [1, 2]
    assert client(uri).get_run(alive.wait(10)).info.status == "RUNNING"
    alive.close()
    assert client(uri).get_run(alive.run_id).info.status == "FINISHED"


def test_a_killed_run_can_be_resumed(tmp_path: Path, uri: str):
    dead = killed(tmp_path / "run", uri)
    with (tmp_path / "run" / "tracking").glob("*.jsonl").__next__().open("a") as journal:
        journal.write('{"kind": "metrics", "ti')  # the line it was writing
    with started(tmp_path / "run", uri, resume=True) as run:
        assert run.run_id == dead
        run.metrics({"loss": 20.0}, 2)
        run.metrics({"loss": 30.0}, 3)
    assert history(uri, "loss") == [(1, 1.0), (2, 2.0), (3, 30.0)]
    assert only_run(uri).info.status == "FINISHED"


# ---- no store --------------------------------------------------------------------------------------------------------


def test_an_absent_store_costs_no_time_and_its_data_is_delivered_later(
    tmp_path: Path, uri: str, caplog: pytest.LogCaptureFixture
):
    begin = time.monotonic()
    with caplog.at_level(logging.WARNING), started(tmp_path / "runs" / "a", REFUSING, params={"p": 1}) as run:
        for step in range(500):
            run.metrics({"loss": step}, step)
        (tmp_path / "runs" / "a" / "mesh.svg").write_text("<svg/>")
        run.artifact(tmp_path / "runs" / "a" / "mesh.svg")
    assert time.monotonic() - begin < 3
    assert run.run_id is None
    assert f"{REFUSING}: cannot be reached" in caplog.text

    with pytest.raises(TrackingError, match=r"^http://127.0.0.1:9: cannot be reached \(.*\): start the server"):
        sync(tmp_path, REFUSING)
    assert sync(tmp_path / "runs", uri) == 503
    assert sync(tmp_path / "runs", uri) == 0
    assert sync(tmp_path, uri) == 0
    assert history(uri, "loss") == [(step, step) for step in range(500)]
    found = only_run(uri)
    assert (found.info.status, found.data.params) == ("FINISHED", {"p": "1"})
    assert (tmp_path / "mlartifacts" / found.info.run_id / "artifacts" / "mesh.svg").exists()


def test_recording_is_fast_and_closing_keeps_to_its_limit_when_the_store_hangs(tmp_path: Path, silent_server: str):
    run = started(tmp_path / "run", silent_server, flush_seconds=0.5)
    begin = time.monotonic()
    for step in range(1000):
        run.metrics({"loss": step, "return": step}, step)
    assert time.monotonic() - begin < 1
    begin = time.monotonic()
    run.close()
    run.metrics({"late": 1}, 1)
    run.close()
    assert time.monotonic() - begin < 1.5
    (journal,) = (tmp_path / "run" / "tracking").glob("*.jsonl")
    events = [json.loads(line) for line in journal.read_text().splitlines()]
    assert [event["kind"] for event in events] == ["start"] + ["metrics"] * 1000 + ["end"]


@pytest.mark.parametrize(("error", "longest"), [(KeyboardInterrupt, 3.0), (ValueError, 15.0)])
def test_who_is_interrupted_does_not_wait_for_a_store_that_hangs(
    error: type[BaseException], longest: float, tmp_path: Path, silent_server: str, monkeypatch: pytest.MonkeyPatch
):
    """A scheduler kills it after ten seconds; what it waits for is added up here, and not waited for."""
    waited: list[float] = []
    with pytest.raises(error), started(tmp_path / "run", silent_server) as run:  # noqa: PT012
        monkeypatch.setattr(run._thread, "join", waited.append)
        raise error
    assert 0 < sum(waited) <= longest


def test_a_store_that_comes_back_gets_everything(tmp_path: Path, uri: str, monkeypatch: pytest.MonkeyPatch):
    real, away = mlflow_store.mlflow_client, threading.Event()
    away.set()

    def sometimes() -> Any:
        if away.is_set() and threading.current_thread().name == "tracking":
            raise ConnectionError("away")
        return real()

    monkeypatch.setattr(mlflow_store, "mlflow_client", sometimes)
    monkeypatch.setattr(recording, "BATCH_SECONDS", 0.1)
    with started(tmp_path / "run", uri) as run:
        run.metrics({"loss": 1.0}, 1)
        time.sleep(0.3)
        assert run.run_id is None
        away.clear()
        run.metrics({"loss": 2.0}, 2)
        assert run.wait(10)
    assert history(uri, "loss") == [(1, 1.0), (2, 2.0)]


def test_an_interrupted_delivery_is_repeated_without_repeating_its_data(tmp_path: Path, uri: str):
    with started(tmp_path / "run", uri) as run:
        for step in range(5):
            run.metrics({"loss": step}, step)
    (state,) = (tmp_path / "run" / "tracking").glob("*.json")
    saved = json.loads(state.read_text())
    state.write_text(json.dumps(saved | {"sent": 0, "run_id": None}))  # killed before it could note what it had sent
    assert sync(tmp_path, uri) == 7
    assert only_run(uri).info.run_id == run.run_id
    assert history(uri, "loss") == [(step, step) for step in range(5)]


def test_a_folder_that_cannot_be_written_does_not_stop_training(tmp_path: Path, uri: str, caplog: Any):
    (tmp_path / "file").write_text("")
    with started(tmp_path / "file", uri) as run:
        run.metrics({"x": 1}, 1)
    assert "tracking is off" in caplog.text


def test_a_store_that_is_none_does_not_stop_training(tmp_path: Path):
    with started(tmp_path / "run", "nonsense://x", flush_seconds=5) as run:
        run.metrics({"x": 1}, 1)
    assert run.run_id is None
    with pytest.raises(TrackingError, match="nonsense"):
        sync(tmp_path, "nonsense://x")


# ---- parents and children --------------------------------------------------------------------------------------------


def family(uri: str) -> dict[str, str | None]:
    """The name of every run's parent, by the run's name."""
    names = {run.info.run_id: run.info.run_name for run in runs(uri)}
    return {run.info.run_name: names.get(run.data.tags.get("mlflow.parentRunId")) for run in runs(uri)}


def test_a_child_hangs_below_its_parent_and_keeps_it_when_resumed(
    tmp_path: Path, uri: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("MLFLOW_RUN_ID", "0" * 32)
    with started(tmp_path / "study", uri, name="study") as study:
        assert study.wait(10)
        for seed in range(2):
            with started(tmp_path / f"study/{seed}", uri, name=f"{seed}", parent=study.id) as trial:
                trial.metrics({"loss": seed}, 1)
    with started(tmp_path / "study/0", uri, name="0", resume=True) as again:
        again.metrics({"loss": 5}, 2)
    assert family(uri) == {"study": None, "0": "study", "1": "study"}
    assert {run.info.status for run in runs(uri)} == {"FINISHED"}


@pytest.mark.parametrize("names", [("a", "b", "c"), ("c", "b", "a")])
def test_children_told_before_their_parents_wait_for_them(tmp_path: Path, uri: str, names: tuple[str, ...]):
    """Neither a store is there nor do the folders' names tell who comes first."""
    above = None
    for name in names:
        with started(tmp_path / name, REFUSING, name=name, parent=above) as run:
            run.metrics({"loss": 1.0}, 1)
        above = run.id
    assert sync(tmp_path / names[-1], uri) == 0  # its parent is nowhere
    assert runs(uri) == []
    assert sync(tmp_path, uri) == 9
    assert sync(tmp_path, uri) == 0
    assert family(uri) == {names[0]: None, names[1]: names[0], names[2]: names[1]}


def test_a_child_is_delivered_once_its_parent_is(tmp_path: Path, uri: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(recording, "BATCH_SECONDS", 0.1)
    late = started(tmp_path / "study", REFUSING, name="study")
    late.close()
    with started(tmp_path / "trial", uri, name="trial", parent=late.id) as trial:
        time.sleep(0.3)
        assert trial.run_id is None
        sync(tmp_path / "study", uri)
    assert family(uri) == {"study": None, "trial": "study"}


def test_a_resumed_run_waits_for_whoever_marks_it_failed(tmp_path: Path, uri: str):
    with started(tmp_path / "run", uri) as run:
        pass
    (path,) = (tmp_path / "run" / "tracking").glob("*.jsonl")
    marker = Journal.claim(path, tmp_path)
    assert marker is not None
    threading.Timer(0.5, marker.release).start()
    with started(tmp_path / "run", uri, resume=True) as again:
        assert again.id == run.id


# ---- shared runs -----------------------------------------------------------------------------------------------------


def test_a_shared_run_is_told_again_below_the_other_parent_and_once(tmp_path: Path, uri: str):
    with started(tmp_path / "trial", uri, name="trial", params={"p": 1}, tags={"study": "a", "k": "v"}) as trial:
        trial.metrics({"loss": 1.0}, 1)
        (tmp_path / "trial" / "mesh.svg").write_text("<svg/>")
        trial.artifact(tmp_path / "trial" / "mesh.svg")
    with started(tmp_path / "trial", uri, name="trial", params={"p": 1}, tags={"study": "a"}, resume=True) as trial:
        trial.metrics({"loss": 9.0}, 1)
        trial.metrics({"loss": 2.0}, 2)
    here = {"uri": uri, "experiment": "test", "name": "shared", "tags": {"study": "b"}, "into": tmp_path / "b"}
    with started(tmp_path / "b", uri, name="b") as other:
        copy = share(tmp_path / "trial", parent=str(other.id), **here)
        assert share(tmp_path / "trial", parent=str(other.id), **here) == copy != trial.id
    with started(tmp_path / "b", uri, name="b", resume=True) as other:
        assert share(tmp_path / "trial", parent=str(other.id), **here) == copy
    assert sync(tmp_path, uri) == 0
    assert family(uri) == {"b": None, "trial": None, "shared": "b"}
    (shared,) = [run for run in runs(uri) if run.info.run_name == "shared"]
    assert (shared.data.params, shared.info.status) == ({"p": "1"}, "FINISHED")
    tags = {"study": "b", "k": "v", "freemesh.id": copy, "freemesh.shared_from": trial.id}
    assert tags.items() <= shared.data.tags.items()
    points = [
        {(m.step, m.value, m.timestamp) for m in client(uri).get_metric_history(run_id, "loss")}
        for run_id in (trial.run_id, shared.info.run_id)
    ]
    assert points[0] == points[1]
    assert {(step, value) for step, value, _ in points[0]} == {(1, 1.0), (2, 2.0)}
    assert (tmp_path / "mlartifacts" / shared.info.run_id / "artifacts" / "mesh.svg").exists()
    with started(tmp_path / "trial", uri, resume=True) as again:
        assert again.id == trial.id


def test_a_run_shared_without_a_store_is_left_to_sync(tmp_path: Path, uri: str):
    with started(tmp_path / "study", REFUSING, name="study") as study:
        pass
    with started(tmp_path / "trial", REFUSING, name="trial") as trial:
        trial.metrics({"loss": 1.0}, 1)
    copy = share(
        tmp_path / "trial", uri=REFUSING, experiment="test", name="copy", parent=study.id, into=tmp_path / "study"
    )
    assert copy is not None
    assert sync(tmp_path, uri) == 2 + 3 + 3
    assert family(uri) == {"study": None, "trial": None, "copy": "study"}


def test_a_child_of_the_same_parent_is_not_recorded_again(tmp_path: Path, uri: str):
    with started(tmp_path / "study", uri, name="study") as study:
        with started(tmp_path / "trial", uri, name="trial", parent=study.id) as trial:
            pass
        with started(tmp_path / "trial", uri, name="trial", resume=True):  # it keeps its parent
            pass
        here = {"uri": uri, "experiment": "test", "name": "copy", "into": tmp_path / "study"}
        assert share(tmp_path / "trial", parent=str(study.id), **here) == trial.id
    sync(tmp_path, uri)
    assert family(uri) == {"study": None, "trial": "study"}


def test_what_was_never_tracked_is_not_shared(tmp_path: Path, uri: str):
    assert share(tmp_path, uri=uri, experiment="test", name="x", parent="y", into=tmp_path) is None
    assert runs(uri) == []


# ---- bounds ----------------------------------------------------------------------------------------------------------

FULL = """
import resource, sys
from pathlib import Path
from freemesh_ray.tracking import MLflowRun
run = MLflowRun(sys.argv[1], uri=sys.argv[2], experiment="test", name="full")
(journal,) = Path(sys.argv[1]).glob("tracking/*.jsonl")
_, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
resource.setrlimit(resource.RLIMIT_FSIZE, (journal.stat().st_size + 100, hard))
for step in range(50):
    run.metrics({"loss": step}, step)
resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
for step in range(50, 60):
    run.metrics({"loss": step}, step)
run.close()
"""


def test_a_full_disk_costs_what_it_has_no_room_for_and_nothing_more(tmp_path: Path, uri: str):
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(tmp_path / "run"), REFUSING],
        check=True, capture_output=True, text=True, cwd=ROOT,
    )  # fmt: skip
    assert done.stderr.count("make room; what comes until then is lost") == 1
    sync(tmp_path, uri)
    steps = [step for step, _ in history(uri, "loss")]
    assert steps == [0, *range(50, 60)]
    assert only_run(uri).info.status == "FINISHED"


def test_delivery_remembers_metrics_by_name_not_by_step(tmp_path: Path, uri: str):
    with started(tmp_path / "run", uri) as run:
        for step in range(2500):
            run.metrics({"loss": step, "return": step}, step)
    (path,) = (tmp_path / "run" / "tracking").glob("*.jsonl")
    journal = Journal.claim(path, tmp_path)
    assert journal is not None
    uploader = Uploader(journal, uri)
    held = [value for value in vars(uploader).values() if isinstance(value, dict | list | set | tuple)]
    assert held
    assert all(len(value) <= 2 for value in held)
    journal.release()
