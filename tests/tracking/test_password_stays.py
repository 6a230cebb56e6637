"""A store's password reaches that store, from a training and from a study's trials, and is written down nowhere."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from fake_study import Fake
from processes import ROOT, outside
from recording_server import FakeStore, basic

from freemesh_ray.cli.train import train_table
from freemesh_ray.config import load
from freemesh_ray.config.paths import Paths
from freemesh_ray.config.store_login import LOGINS, set_aside
from freemesh_ray.tracking import MLflowRun, sync
from freemesh_ray.training.job import train

PASSWORD = "s3cr3tpw"
LOGIN = f"alice:{PASSWORD}"
SETTINGS = {
    "curriculum.stages": ["T1"], "runners.count": 0, "budget.env_steps": 200, "budget.minutes": None,
    "evaluation.interval": 200,
}  # fmt: skip


@pytest.fixture
def store() -> Iterator[FakeStore]:
    """That asks for the login."""
    store = FakeStore()
    store.login = LOGIN
    with store.running():
        yield store


@pytest.fixture
def elsewhere() -> Iterator[FakeStore]:
    """Another store, which lets everybody in."""
    store = FakeStore()
    with store.running():
        yield store


def run(arguments: list[str], home: Path, **variables: str) -> str:
    """What a command prints that succeeds."""
    environment = outside() | {"PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}", "FREEMESH_HOME": str(home)}
    done = subprocess.run(
        [sys.executable, *arguments],
        env=environment | variables,
        cwd=home,
        capture_output=True,
        text=True,
        timeout=3000,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def full(store: FakeStore) -> str:
    return store.url.replace("//", f"//{LOGIN}@")


def check(home: Path, printed: str, store: FakeStore, elsewhere: FakeStore, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing that was written, printed or sent has the password; `sync` to another store sends all the rest."""
    assert PASSWORD not in printed
    written = [path for path in home.rglob("*") if path.is_file() and path.name != "given.yaml"]
    assert [path for path in written if PASSWORD.encode() in path.read_bytes()] == []
    monkeypatch.setenv(LOGINS, "{}")
    set_aside(full(store))
    assert sync(home, elsewhere.url) > 0
    assert {run.tags["freemesh.id"] for run in elsewhere.runs.values()} >= {
        run.tags["freemesh.id"] for run in store.runs.values()
    }
    assert any(b"tracking:" in content for _, content in elsewhere.files())
    for request in store.requests:
        assert PASSWORD not in request.body.decode(errors="replace") + request.path
    for request in elsewhere.requests:
        assert PASSWORD.encode() not in request.body
        assert PASSWORD not in request.path + request.headers
        assert basic(LOGIN) not in request.headers


@pytest.mark.slow
@pytest.mark.parametrize("way", ["environment", "set", "file", "mapping"])
def test_of_a_training(
    way: str, store: FakeStore, elsewhere: FakeStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:  # fmt: skip
    monkeypatch.setenv(LOGINS, "{}")
    monkeypatch.setenv("FREEMESH_HOME", str(tmp_path))
    monkeypatch.setenv("FAKE_LOG", str(tmp_path / "log"))
    monkeypatch.setitem(MLflowRun.__init__.__kwdefaults__, "flush_seconds", 600.0)
    (tmp_path / "given.yaml").write_text(f"tracking: {{uri: '{full(store)}'}}\n")
    if way == "environment":
        monkeypatch.setenv("MLFLOW_TRACKING_URI", full(store))
    more = {"file": [tmp_path / "given.yaml"], "mapping": [{"tracking": {"uri": full(store)}}]}.get(way, [])
    sets = [f"tracking.uri={full(store)}"] if way == "set" else []
    tree = Paths.from_environment().resolved(load([SETTINGS, *more], ["name=mine", *sets]))
    printed = train_table(train(tree, make=Fake), tree)
    assert f"compare     {store.url}/#/experiments/1/runs/" in printed
    (one,) = store.runs.values()
    assert one.status == "FINISHED"
    assert one.params["tracking.uri"] == store.url
    check(tmp_path, printed + caplog.text, store, elsewhere, monkeypatch)


@pytest.mark.slow
def test_of_a_study(store: FakeStore, elsewhere: FakeStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = {"title": "A test", "variants": {"usual": None, "small": {"learner.batch_size": 8}}, "seeds": [1]}
    (tmp_path / "given.yaml").write_text(
        yaml.safe_dump({"study": study, "settings": {**SETTINGS, "tracking.uri": full(store)}})
    )
    printed = run([str(ROOT / "tests" / "fake_study.py"), "given.yaml"], tmp_path, FAKE_LOG=str(tmp_path / "log"))
    sync(tmp_path, full(store))  # what a busy machine was too slow for
    assert [run.status for run in store.runs.values()] == ["FINISHED"] * 3
    check(tmp_path, printed, store, elsewhere, monkeypatch)


def test_what_an_earlier_version_wrote_down_leaves_without_it(
    elsewhere: FakeStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "run"
    away = f"http://{LOGIN}@127.0.0.1:9"
    with MLflowRun(folder, uri=away, experiment="test", name="a", params={"tracking.uri": "URI"}) as run:
        (folder / "config.yaml").write_bytes(f"tracking:\n  uri: {away}\nname: '\xff'\n".encode("latin-1"))
        run.artifact(folder / "config.yaml")
    (journal,) = (folder / "tracking").glob("*.jsonl")
    journal.write_text(journal.read_text().replace("URI", away))
    assert sync(folder, elsewhere.url) == 3
    (stored,) = elsewhere.runs.values()
    assert stored.params == {"tracking.uri": "http://127.0.0.1:9"}
    assert [content for _, content in elsewhere.files()] == [b"tracking:\n  uri: http://127.0.0.1:9\nname: '\xff'\n"]
    assert not any(PASSWORD in request.headers or PASSWORD.encode() in request.body for request in elsewhere.requests)
