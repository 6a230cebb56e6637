"""Stores whose files and runs have names of every kind, and what is told of a store that cannot be used."""

from __future__ import annotations

import logging
import shlex
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from freemesh_ray.cli import command
from freemesh_ray.tracking import MLflowRun, TrackingError, browsing, mlflow_store, sync

ODD = "a?b=c&d%20e#f g'h ü"
REFUSING = "http://127.0.0.1:9"


def names_in(database: Path) -> list[str]:
    """The names of the runs in a store's file."""
    with closing(sqlite3.connect(database)) as opened:
        return [name for (name,) in opened.execute("select name from runs")]


def record(folder: Path, uri: str) -> None:
    with MLflowRun(folder, uri=uri, experiment="test", name="one", flush_seconds=60) as run:
        run.metrics({"loss": 1.0}, 1)


@pytest.mark.parametrize("name", ["a b", "ü", "a%20b", "a?b", "100%", ODD])
def test_a_store_is_the_file_of_its_name(name: str, blank_database: Path, tmp_path: Path) -> None:
    home = tmp_path / "homes" / name
    home.mkdir(parents=True)
    shutil.copy(blank_database, home / "mlflow.db")
    record(tmp_path / "run", f"sqlite:///{home / 'mlflow.db'}")
    assert names_in(home / "mlflow.db") == ["one"]
    assert list((tmp_path / "homes").iterdir()) == [home]


@pytest.mark.slow
def test_a_new_store_is_made_where_its_name_says(tmp_path: Path) -> None:
    home = tmp_path / "homes" / ODD
    record(tmp_path / "run", f"sqlite:///{home / 'mlflow.db'}")
    assert names_in(home / "mlflow.db") == ["one"]
    assert list((tmp_path / "homes").iterdir()) == [home]
    line = shlex.split(browsing(f"sqlite:///{home / 'mlflow.db'}")[0])
    assert line[1:3] == ["ui", "--backend-store-uri"]
    (found,) = mlflow_store.mlflow_client()(line[3]).search_experiments(filter_string="name = 'test'")
    assert found.artifact_location == (home / "mlartifacts").as_uri()


def test_the_line_that_shows_a_store_can_be_pasted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))  # where the environment is not activated
    monkeypatch.chdir(tmp_path)
    program, *arguments = shlex.split(browsing(f"sqlite:///{tmp_path}/a b/mlflow.db")[0])
    assert Path(program).is_file()
    assert arguments == ["ui", "--backend-store-uri", "sqlite:///a b/mlflow.db"]
    assert browsing("http://host:5000") == ["http://host:5000"]


def test_the_page_of_a_run_is_behind_the_stores_address() -> None:
    page = "#/experiments/1/runs/2"
    assert browsing("http://me:word@host:5000/mlflow/", page) == [f"http://host:5000/mlflow/{page}"]
    assert browsing("sqlite:///mlflow.db", page)[1:] == [f"http://127.0.0.1:5000/{page}"]


def test_a_store_that_is_away_is_told_with_the_line_that_delivers_later(
    blank_database: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "runs" / "it's a run"
    monkeypatch.setenv("FREEMESH_HOME", str(tmp_path))
    with caplog.at_level(logging.WARNING), MLflowRun(folder, uri=REFUSING, experiment="test", name="one"):
        pass
    (line,) = {message.split("`")[1] for message in caplog.messages if "`freemesh" in message}
    program, *arguments = shlex.split(line)
    assert (program, arguments) == ("freemesh", ["sync", str(folder), "--uri", REFUSING])
    shutil.copy(blank_database, tmp_path / "mlflow.db")
    assert command.main([*arguments[:-1], f"sqlite:///{tmp_path / 'mlflow.db'}"]) == 0
    assert names_in(tmp_path / "mlflow.db") == ["one"]


def test_a_deleted_experiment_is_told_to_be_restored(
    blank_database: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    shutil.copy(blank_database, tmp_path / "mlflow.db")
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    client = mlflow_store.connect(uri)
    key = client.create_experiment("test")
    client.delete_experiment(key)
    with caplog.at_level(logging.WARNING):
        record(tmp_path / "run", uri)
    restore = f"MLFLOW_TRACKING_URI={uri} mlflow experiments restore --experiment-id {key}"
    assert f"'test' is deleted: restore it ({restore})" in caplog.text
    assert "start the server" not in caplog.text
    with pytest.raises(TrackingError, match=r"or set another tracking\.experiment"):
        sync(tmp_path / "run", uri)
    client.restore_experiment(key)
    assert sync(tmp_path / "run", uri) == 3


def test_an_experiment_that_another_process_makes_at_the_same_moment_is_used(
    blank_database: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copy(blank_database, tmp_path / "mlflow.db")
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    client, found = mlflow_store.connect(uri), [None]
    key = client.create_experiment("test")
    look = client.get_experiment_by_name
    monkeypatch.setattr(client, "get_experiment_by_name", lambda name: found.pop() if found else look(name))
    assert mlflow_store.experiment_id(client, uri, "test") == key
    assert found == []


@pytest.mark.parametrize(
    ("said", "fix"),
    [
        ("API request failed with error code 401", "MLFLOW_TRACKING_USERNAME"),
        ("API request failed with error code 403", "--allowed-hosts"),
        ("[Errno 111] Connection refused", "start the server"),
    ],
)
def test_what_helps_is_told_by_what_is_wrong(said: str, fix: str) -> None:
    assert fix in str(mlflow_store.failure("http://host", OSError(said)))


@pytest.mark.parametrize(
    ("folder", "made", "code", "out", "error"),
    [
        ("runs", True, 0, "runs: nothing to deliver\n", ""),
        ("runs/typo", False, 2, "", "freemesh: runs/typo: no such folder: give a run's folder, or one above many\n"),
        ("other", True, 1, "", "freemesh: {home}/other: lies outside of {home}/runs and {home}/studies, "
         "where runs are: nothing is sent; --set paths.runs=FOLDER says where they are\n"),
    ],
)  # fmt: skip
def test_sync_of_nothing_is_one_line(
    folder: str, made: bool, code: int, out: str, error: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setenv("FREEMESH_HOME", str(tmp_path))
    if made:
        (tmp_path / folder).mkdir()
    assert command.main(["sync", folder]) == code
    assert capsys.readouterr() == (out, error.format(home=tmp_path))
