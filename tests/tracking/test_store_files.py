"""The files beside a sqlite store: no planted link is followed, no name can be guessed, no wait is endless."""

from __future__ import annotations

import fcntl
import os
import stat
from pathlib import Path
from typing import Any

import pytest

from freemesh_ray.tracking import TrackingError, mlflow_store


class Client:
    """Stands for MLflow's: makes the file that it is given, and notes where that lay."""

    made: list[Path]

    def __init__(self, uri: str, _: Any = None) -> None:
        self.path = Path(uri.removeprefix("sqlite:///"))

    def search_experiments(self, **_: Any) -> None:
        with open(self.path, "x") as file:  # sqlite would follow a link
            file.write("tables")
        folder = self.path.parent
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        type(self).made.append(self.path)


@pytest.fixture(autouse=True)
def mlflow(monkeypatch: pytest.MonkeyPatch) -> type[Client]:
    Client.made = []
    monkeypatch.setattr(mlflow_store, "mlflow_client", lambda: Client)
    return Client


def test_a_new_store_is_made_where_nobody_else_may_enter(mlflow: type[Client], tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious")
    for name in ("one", "two"):
        home = tmp_path / name
        home.mkdir()
        for planted in (".mlflow.db.draft", ".mlflow.db.draft-journal"):
            (home / planted).symlink_to(victim)
        mlflow_store.connect(f"sqlite:///{home / 'mlflow.db'}")
        assert (home / "mlflow.db").read_text() == "tables"
        assert victim.read_text() == "precious"
        left = {path.name for path in home.iterdir() if not path.is_symlink()}
        assert left == {"mlflow.db", "mlflow.db.lock"}
    first, second = mlflow.made  # by whose paths MLflow keeps them open
    assert (first.parents[1], second.parents[1]) == (tmp_path / "one", tmp_path / "two")
    assert first.parent.name != second.parent.name


def test_no_planted_link_is_the_lock(tmp_path: Path) -> None:
    victim, place = tmp_path / "victim", tmp_path / "mlflow.db"
    victim.write_text("precious")
    lock = tmp_path / "mlflow.db.lock"
    for target in (victim, tmp_path / "none"):
        lock.symlink_to(target)
        with pytest.raises(TrackingError, match=r"mlflow\.db\.lock: is no file of its own \(.*\): remove it"):
            mlflow_store.connect(f"sqlite:///{place}")
        lock.unlink()
    assert victim.read_text() == "precious"
    assert os.listdir(tmp_path) == ["victim"]
    os.link(victim, lock)  # a second name: it is not written to
    mlflow_store.connect(f"sqlite:///{place}")
    assert victim.read_text() == "precious"


def test_a_pipe_in_its_place_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "mlflow.db.lock")
    mlflow_store.connect(f"sqlite:///{tmp_path / 'mlflow.db'}")


def test_who_holds_the_lock_for_ever_is_told_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mlflow_store, "OPENING_SECONDS", 0.1)
    with (tmp_path / "mlflow.db.lock").open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(TrackingError, match=r"mlflow\.db\.lock: another process holds it: end that"):
            mlflow_store.connect(f"sqlite:///{tmp_path / 'mlflow.db'}")
    mlflow_store.connect(f"sqlite:///{tmp_path / 'mlflow.db'}")
