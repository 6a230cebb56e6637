"""Attacks by journals, tags and answers: what leaves, where to, and whose runs are changed, is told by settings alone.

A journal may come with a folder that somebody else made, and whoever may write to a store writes tags as he likes. The
configured server and another keep every byte that they are sent. FREEMESH_FUZZ sets the number of mutated journals.
"""

from __future__ import annotations

import json
import math
import os
import random
import shutil
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from mutants import mutants
from recording_server import FakeStore, Recorder

from freemesh_ray.cli import command
from freemesh_ray.policies.policy import DEFAULT, SHIPPED
from freemesh_ray.storage import owner as owner_module
from freemesh_ray.storage.owner import Owner
from freemesh_ray.tracking import MLflowRun, TrackingError, killed_runs, sync, uploader
from freemesh_ray.tracking import mlflow_run as recording
from freemesh_ray.tracking.events import Event
from freemesh_ray.tracking.journal import CHUNK, JOURNAL_BYTES, LINE_BYTES, STATE_BYTES, entries
from freemesh_ray.tracking.journal_folders import found
from freemesh_ray.tracking.killed_runs import fail_killed_runs
from freemesh_ray.tracking.mlflow_store import takes_artifacts
from freemesh_ray.tracking.model_registry import fingerprint

#: Journals that are mutated, and how many are delivered at a time.
COUNT, BATCH = int(os.environ.get("FREEMESH_FUZZ", "400")), 20
SECRET, USER, PASSWORD = "-----BEGIN KEY-----s3cr3t", "alice", "pa55w0rd"
ANOTHER = {"user": "0" * 16, "machine": "1" * 16, "boot": "2" * 16, "process": "1:1:1"}
#: Seconds within which all of a batch must be over, however slow the machine.
LIMIT = 120.0


@dataclass
class World:
    """A user's runs, what lies beside them, and two servers.

    Attributes:
        home: holds ``runs``, ``studies`` and ``outside``.
        store: the configured one.
        elsewhere: any other.
        others: runs of other users in the store, as they were.
    """

    home: Path
    store: FakeStore
    elsewhere: Recorder
    others: dict[str, dict[str, Any]] = field(default_factory=dict)

    @property
    def runs(self) -> Path:
        return self.home / "runs"

    @property
    def folders(self) -> list[Path]:
        """What the settings name."""
        return [self.runs, self.home / "studies"]

    def add_other(self, **tags: str) -> str:
        """A run that this user must not change; MLflow's id."""
        run = self.store.add(tags=tags)
        self.others[run.run_id] = run.told()
        return run.run_id

    def deliver(self) -> None:
        """All that delivers of itself, or when it is asked to."""
        with suppress(Exception):  # a start goes on without it
            fail_killed_runs(self.store.url, "test", "none", self.folders, time.monotonic() + 60)
        with suppress(TrackingError):
            sync(self.runs, self.store.url, within=self.folders)

    def check(self) -> None:
        """Nothing foreign has left, and no other's run is changed."""
        assert self.elsewhere.requests == []
        for request in self.store.requests:
            assert SECRET not in request.body.decode(errors="replace") + request.path
            assert PASSWORD not in request.body.decode(errors="replace") + request.path
        for run_id, content in self.store.files():
            assert content == own_content(self.store.runs[run_id].tags["freemesh.id"])
        for run_id, before in self.others.items():
            assert self.store.runs[run_id].told() == before
        ours = self.store.runs.keys() - self.others.keys()
        assert {key.removeprefix("mlflow.sharedViewState.freemesh-") for key in self.store.views} <= ours


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    monkeypatch.setenv("MLFLOW_TRACKING_USERNAME", USER)
    monkeypatch.setenv("MLFLOW_TRACKING_PASSWORD", PASSWORD)
    monkeypatch.setenv("MLFLOW_ALLOW_HTTP_REDIRECTS", "true")
    (tmp_path / "machine-id").write_text("f" * 32)  # a container may have none
    monkeypatch.setattr(owner_module, "MACHINE", (tmp_path / "machine-id",))
    world = World(tmp_path, FakeStore(), Recorder())
    for name in ("runs", "studies", "outside"):
        (tmp_path / name).mkdir()
    (tmp_path / "outside" / "id_rsa").write_text(SECRET)
    # A sound journal, which would be delivered if it were this user's.
    events = [start(f"the {SECRET}"), {"kind": "metrics", "time": 1, "step": 1, "values": {SECRET: 1.0}}]
    write(tmp_path / "outside" / "theirs.jsonl", events, state(world.store.url))
    with world.store.running(), world.elsewhere.running():
        yield world


def own_content(own_id: str) -> bytes:
    """What a run's own file holds."""
    return f"the file of {own_id}".encode()


def start(name: str, parent: str | None = None) -> Event:
    params, tags = {"learner.batch_size": "256"}, {"algorithm": "sac"}
    return {"kind": "start", "time": 1000, "name": name, "params": params, "tags": tags, "parent": parent}


def state(uri: str, run_id: str | None = None, owner: dict[str, str] | None = None) -> dict[str, Any]:
    return {"uri": uri, "experiment": "test", "run_id": run_id, "sent": 0, "owner": owner or Owner.here().told()}


def write(path: Path, events: list[Event], about: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(json.dumps(event) + "\n" for event in events))
    path.with_suffix(".json").write_text(json.dumps(about))


def recorded(world: World, name: str, artifact: Path | None = None, **about: Any) -> Path:
    """The journal of a run without an end, whose process is gone; it names a file of its own, or another."""
    own_id = f"20260101T000000-{name}"
    folder = world.runs / name
    (folder / "tracking" / "models").mkdir(parents=True)
    (folder / "config.yaml").write_bytes(own_content(own_id))
    shutil.copy(DEFAULT, folder / "tracking" / "models" / "policy.npz")
    model = {"name": "mesher", "alias": "best", "tags": {}, "description": "", "mark": fingerprint(DEFAULT, own_id)}
    events = [
        start(name),
        {"kind": "metrics", "time": 1001, "step": 1, "values": {"loss": 1.0}},
        {"kind": "artifact", "time": 1002, "path": str(artifact or folder / "config.yaml"), "folder": None},
        {"kind": "model", "time": 1003, "path": str(folder / "tracking" / "models" / "policy.npz"), **model},
        {"kind": "metrics", "time": 1004, "step": 2, "values": {"loss": 0.5}},
    ]
    path = folder / "tracking" / f"{own_id}.jsonl"
    write(path, events, state(world.store.url) | about)
    return path


def stored(world: World, path: Path) -> list[dict[str, Any]]:
    """The runs of the store that have a journal's id."""
    return [run.told() for run in world.store.runs.values() if run.tags.get("freemesh.id") == path.stem]


# ---- what a sound journal does, so that the attacks prove something --------------------------------------------------


def test_a_sound_journal_is_delivered_with_its_file_and_the_password(world: World) -> None:
    path = recorded(world, "sound")
    assert sync(world.runs, world.store.url, within=world.folders) == 6
    (run,) = stored(world, path)
    assert run["info"]["status"] == "FAILED"
    assert world.store.files() == [(run["info"]["run_id"], own_content(path.stem))]
    assert all("Authorization: Basic" in request.headers for request in world.store.requests)
    assert any(request.path.endswith("registered-models/create") for request in world.store.requests)
    world.check()


# ---- files -----------------------------------------------------------------------------------------------------------

Planting = Callable[[World, Path], Path]


def _symlink(world: World, folder: Path) -> Path:
    (folder / "plot.png").symlink_to(world.home / "outside" / "id_rsa")
    return folder / "plot.png"


def _hard_link(world: World, folder: Path) -> Path:
    os.link(world.home / "outside" / "id_rsa", folder / "plot.png")
    return folder / "plot.png"


def _linked_folder(world: World, folder: Path) -> Path:
    (folder / "plots").symlink_to(world.home / "outside")
    return folder / "plots" / "id_rsa"


def _pipe(world: World, folder: Path) -> Path:
    os.mkfifo(folder / "plot.png")
    return folder / "plot.png"


def _socket(world: World, folder: Path) -> Path:
    with socket.socket(socket.AF_UNIX) as server:
        here = os.getcwd()
        os.chdir(folder)  # a socket's name is short
        server.bind("plot.png")
        os.chdir(here)
    return folder / "plot.png"


def _others_run(world: World, folder: Path) -> Path:
    other = world.runs / "other"
    other.mkdir()
    (other / "config.yaml").write_text(SECRET)
    return other / "config.yaml"


FILES: dict[str, Planting] = {
    "outside": lambda world, folder: world.home / "outside" / "id_rsa",
    "dots": lambda world, folder: folder / ".." / ".." / "outside" / "id_rsa",
    "relative": lambda world, folder: Path(os.path.relpath(world.home / "outside" / "id_rsa")),
    "a folder": lambda world, folder: world.home / "outside",
    "its own folder": lambda world, folder: folder,
    "a device": lambda world, folder: Path("/dev/null"),
    "the environment": lambda world, folder: Path("/proc/self/environ"),
    "a symbolic link": _symlink, "a hard link": _hard_link, "a linked folder": _linked_folder, "a pipe": _pipe,
    "a socket": _socket, "another run's": _others_run,
}  # fmt: skip


def change(journal: Path, kind: str, /, **fields: Any) -> None:
    """Set fields of the events of one kind."""
    events = [json.loads(line) for line in journal.read_text().splitlines()]
    journal.write_text("".join(json.dumps(e | (fields if e["kind"] == kind else {})) + "\n" for e in events))


def change_state(path: Path, **fields: Any) -> None:
    """Set fields of a journal's state."""
    path.with_suffix(".json").write_text(json.dumps(json.loads(path.with_suffix(".json").read_text()) | fields))


@pytest.mark.parametrize("kind", ["artifact", "model"])
@pytest.mark.parametrize("planting", FILES)
def test_a_file_that_is_not_of_the_runs_folder_stays(planting: str, kind: str, world: World) -> None:
    path = recorded(world, "attack")
    target = FILES[planting](world, path.parents[1])
    change(path, "artifact", path=str(target if kind == "artifact" else world.home / "none"))
    change(path, "model", path=str(target))
    world.deliver()
    world.check()
    assert world.store.files() == []
    assert not any("registered-models" in request.path for request in world.store.requests)
    (run,) = stored(world, path)
    assert run["info"]["status"] == "FAILED"  # and what else it recorded has arrived


def test_a_policy_that_is_not_the_one_recorded_is_not_registered(world: World) -> None:
    path = recorded(world, "attack")
    shutil.copy(SHIPPED["dense"], path.parent / "models" / "policy.npz")
    world.deliver()
    assert not any("registered-models" in request.path for request in world.store.requests)
    assert stored(world, path)[0]["info"]["status"] == "FAILED"


def test_a_file_that_is_exchanged_after_it_was_checked_stays(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    path = recorded(world, "attack")
    config, access = path.parents[1] / "config.yaml", uploader.artifacts_of

    def exchange(*about: Any) -> Any:
        config.unlink(missing_ok=True)
        config.symlink_to(world.home / "outside" / "id_rsa")
        return access(*about)

    monkeypatch.setattr(uploader, "artifacts_of", exchange)
    world.deliver()
    world.check()
    assert [content for _, content in world.store.files()] == [own_content(path.stem)]


def _journal_is_a_link(path: Path, theirs: Path) -> None:
    path.unlink()
    path.symlink_to(theirs)


def _journal_is_a_hard_link(path: Path, theirs: Path) -> None:
    path.unlink()
    os.link(theirs, path)


def _state_is_a_link(path: Path, theirs: Path) -> None:
    path.with_suffix(".json").unlink()
    path.with_suffix(".json").symlink_to(theirs.with_suffix(".json"))


def _tracking_is_a_link(path: Path, theirs: Path) -> None:
    shutil.rmtree(path.parent)
    path.parent.symlink_to(theirs.parent)


def _run_is_a_link(path: Path, theirs: Path) -> None:
    folder = path.parents[1]
    folder.rename(theirs.parent / "moved")
    folder.symlink_to(theirs.parent / "moved")


def _journal_is_a_pipe(path: Path, theirs: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def _state_is_a_pipe(path: Path, theirs: Path) -> None:
    path.with_suffix(".json").unlink()
    os.mkfifo(path.with_suffix(".json"))


def _journal_is_a_device(path: Path, theirs: Path) -> None:
    path.unlink()
    path.symlink_to("/dev/null")


def _state_is_huge(path: Path, theirs: Path) -> None:
    with path.with_suffix(".json").open("ab") as file:
        file.truncate(STATE_BYTES + 1)


def _journal_is_huge(path: Path, theirs: Path) -> None:
    with path.open("ab") as file:
        file.truncate(JOURNAL_BYTES + 1)


def _of_another_user(path: Path, theirs: Path) -> None:
    if os.geteuid():
        pytest.skip("files are given away by root alone")
    os.chown(path, 65534, 65534)


def _state_of_another_user(path: Path, theirs: Path) -> None:
    if os.geteuid():
        pytest.skip("files are given away by root alone")
    os.chown(path.with_suffix(".json"), 65534, 65534)


def _recorded_by_another(path: Path, theirs: Path) -> None:
    change_state(path, owner=ANOTHER)
    with path.open("a") as file:
        file.write(json.dumps({"kind": "end", "time": 2000, "status": "FINISHED"}) + "\n")


def _recorded_on_another_machine(path: Path, theirs: Path) -> None:
    change_state(path, owner=Owner.here().told() | {"machine": "1" * 16, "boot": "2" * 16})


def _at_an_odd_name(path: Path, theirs: Path) -> None:
    for old in (path, path.with_suffix(".json")):
        old.rename(old.with_name(f"x' or tags.`a` != 'b{old.suffix}"))


@pytest.mark.parametrize("plant", [
    _journal_is_a_link, _journal_is_a_hard_link, _state_is_a_link, _tracking_is_a_link, _run_is_a_link,
    _journal_is_a_pipe, _state_is_a_pipe, _journal_is_a_device, _journal_is_huge, _state_is_huge, _of_another_user,
    _state_of_another_user, _recorded_by_another, _recorded_on_another_machine, _at_an_odd_name,
])  # fmt: skip
def test_a_journal_that_is_not_this_users_file_below_the_folders_stays(
    plant: Callable[[Path, Path], None], world: World
) -> None:
    path = recorded(world, "attack")
    sound = recorded(world, "sound")
    plant(path, world.home / "outside" / "theirs.jsonl")
    world.deliver()
    world.check()
    assert [run.tags["freemesh.id"] for run in world.store.runs.values()] == [sound.stem]


# ---- addresses -------------------------------------------------------------------------------------------------------


def test_the_address_that_a_journal_names_gets_nothing(
    world: World, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FREEMESH_HOME", str(world.home))
    monkeypatch.setenv("MLFLOW_TRACKING_URI", world.store.url)
    path = recorded(world, "attack", uri=world.elsewhere.url)
    assert command.main(["sync", "runs/attack"]) == 1
    line = capsys.readouterr().err
    assert f"`freemesh sync {path.parents[1]} --uri {world.elsewhere.url}` delivers it there" in line
    assert line.count("\n") == 1
    assert world.store.runs == {}
    world.check()
    assert command.main(["sync", "runs/attack", "--uri", world.store.url]) == 0
    assert len(stored(world, path)) == 1
    world.check()


def test_a_resumed_run_goes_to_the_configured_address(world: World) -> None:
    path = recorded(world, "attack", uri=world.elsewhere.url, run_id="7" * 32, sent=10)
    with MLflowRun(path.parents[1], uri=world.store.url, experiment="test", name="x", resume=True, flush_seconds=60):
        pass
    (run,) = stored(world, path)
    assert run["info"]["status"] == "FINISHED"
    world.check()


@pytest.mark.parametrize("which", ["all", "files", "creation"])
def test_a_redirect_is_not_followed(which: str, world: World) -> None:
    recorded(world, "sound")
    asked = {"all": "", "files": "/mlflow-artifacts/", "creation": "/runs/create"}[which]
    world.store.redirect = lambda request: world.elsewhere.url if asked in request.path else None
    if which == "files":
        sync(world.runs, world.store.url, within=world.folders)  # they are left out
    else:
        with pytest.raises(TrackingError, match="give the address that the server redirects to, if you trust it"):
            sync(world.runs, world.store.url, within=world.folders)
    world.check()


PLACES = (
    "{elsewhere}/api/2.0/mlflow-artifacts/artifacts/1/x", "mlflow-artifacts://{netloc}/1/x",
    "mlflow-artifacts://alice@{netloc}/1/x", "{elsewhere}/x", "file://{home}/outside/x", "{home}/outside/x", "x",
    "file:///dev/shm/../..{home}/outside/x", "s3://bucket/x", "gs://bucket/x", "ftp://{netloc}/x", "sftp://{netloc}/x",
    "dbfs:/x", "runs:/x/y", "models:/x/1", "hdfs://{netloc}/x", "{store}.{netloc}/x", "//{netloc}/x",
)  # fmt: skip


@pytest.mark.parametrize("place", PLACES)
def test_files_go_nowhere_but_to_the_configured_server(place: str, world: World, caplog: Any) -> None:
    here = {"elsewhere": world.elsewhere.url, "netloc": world.elsewhere.netloc, "home": world.home}
    before = sorted(world.home.rglob("*"))
    path = recorded(world, "sound")
    made = {*world.home.rglob("*"), *before}
    world.store.place = lambda run_id: place.format(**here, store=world.store.url)
    sync(world.runs, world.store.url, within=world.folders)
    world.check()
    assert world.store.files() == []
    assert {*world.home.rglob("*")} == made
    assert "which is another place" in caplog.text
    (run,) = stored(world, path)
    assert run["info"]["status"] == "FAILED"


@pytest.mark.parametrize(("uri", "place", "taken"), [
    ("http://host:5000", "mlflow-artifacts:/1/x", True),
    ("http://alice:pa55@host:5000", "mlflow-artifacts://host:5000/1/x", True),
    ("http://host:5000/base", "http://host:5000/base/api/2.0/mlflow-artifacts/artifacts/1/x", True),
    ("http://host:5000", "http://host:5000/1/x", False),
    ("https://host", "http://host/api/2.0/mlflow-artifacts/artifacts/1/x", False),
    ("sqlite:////a/mlflow.db", "file:///a/mlartifacts/1/x", True),
    ("sqlite:////a/mlflow.db", "/a/mlruns/1/x", True),
    ("sqlite:////a b/mlflow.db", "file:///a%20b/mlartifacts/1/x", True),
    ("sqlite:////a/mlflow.db", "file:///a/mlartifacts/../x", False),
    ("sqlite:////a/mlflow.db", "file:///a/.ssh/x", False),
    ("sqlite:////a/mlflow.db", "file://host/a/mlartifacts/x", False),
    ("sqlite:////a/mlflow.db", "mlflow-artifacts:/1/x", False),
    ("sqlite:////a/mlflow.db", "/a/mlruns/%2e%2e/%2e%2e/b", False),
    ("sqlite:////a%20b/mlflow.db", "file:///a%2520b/mlartifacts/1/x", True),
    ("sqlite:////a?b#c/mlflow.db", "file:///a%3Fb%23c/mlartifacts/1/x", True),
    ("http://host:5000", "mlflow-artifacts:/../../../../../other/x", False),
    ("http://host:5000", "mlflow-artifacts:/1/%2e%2e/%2e%2e/x", False),
    ("http://host:5000", "mlflow-artifacts:/1/%252e%252e/x", False),
    ("http://host:5000", "mlflow-artifacts:/#x", False),
    ("http://host:5000", "mlflow-artifacts:/%" + 1_000_000 * "25" + "2e", False),
    ("http://host:5000", "mlflow-artifacts:/1?x", False),
    ("http://host:5000", "mlflow-artifacts:/1\\..\\x", False),
    ("http://host/base", "http://host/base/api/2.0/mlflow-artifacts/artifacts/../../../../x", False),
    ("sqlite:////a/mlflow.db", "http://host/x", False),
])  # fmt: skip
def test_a_store_takes_files_at_its_own_place_alone(uri: str, place: str, taken: bool) -> None:
    assert takes_artifacts(uri, place) == taken


def test_a_password_is_neither_kept_nor_shown(world: World, caplog: Any) -> None:
    uri = world.store.url.replace("//", f"//{USER}:{PASSWORD}@")
    with MLflowRun(world.runs / "a", uri=uri, experiment="test", name="a", flush_seconds=60) as run:
        run.metrics({"loss": 1.0}, 1)
    away = f"http://{USER}:{PASSWORD}@127.0.0.1:9"
    with MLflowRun(world.runs / "b", uri=away, experiment="test", name="b"):
        pass
    with pytest.raises(TrackingError) as raised:
        sync(world.runs / "b", away)
    kept = [path.read_text() for path in world.runs.rglob("*.json*")]
    assert len(kept) == 4
    assert "cannot be reached" in caplog.text
    assert PASSWORD not in "".join([*kept, caplog.text, str(raised.value)])
    assert run.run_id is not None
    world.check()


# ---- runs of others --------------------------------------------------------------------------------------------------

OTHERS: dict[str, dict[str, str]] = {
    "no tags": {},
    "our id": {"freemesh.id": "{id}"},
    "our id and another's user": {"freemesh.id": "{id}", "freemesh.user": ANOTHER["user"]},
    "another's id and our user": {"freemesh.id": "20250101T000000-other", "freemesh.user": "{user}"},
    "all of another": {"freemesh.id": "{id}", **{f"freemesh.{name}": text for name, text in ANOTHER.items()}},
}


@pytest.mark.parametrize("sent", [0, 1, 10**6, 10**12])
@pytest.mark.parametrize("tags", OTHERS)
def test_the_run_that_a_state_names_is_left_alone_if_it_is_anothers(tags: str, sent: int, world: World) -> None:
    path = recorded(world, "attack")
    words = {"id": path.stem, "user": Owner.here().user}
    other = world.add_other(**{key: text.format(**words) for key, text in OTHERS[tags].items()})
    world.store.filters = False
    change_state(path, run_id=other, sent=sent)
    if sent == 1:
        with MLflowRun(path.parents[1], uri=world.store.url, experiment="test", name="x", resume=True) as run:
            assert run.wait(LIMIT) != other
    else:
        world.deliver()
    world.check()


@pytest.mark.parametrize("tags", OTHERS)
def test_a_journal_neither_describes_nor_deletes_the_run_of_another(tags: str, world: World) -> None:
    path = recorded(world, "attack")
    words = {"id": path.stem, "user": Owner.here().user}
    other = world.add_other(**{key: text.format(**words) for key, text in OTHERS[tags].items()})
    world.store.filters = False
    whole = [json.loads(line) for line in path.read_text().splitlines()]
    summary = {"kind": "summary", "time": 2000, "step": 2, "text": "ours now", "values": {"loss": 0.0}, "charts": {}}
    write(path, [*whole, summary, {"kind": "delete", "time": 2001}], state(world.store.url, other))
    # Of the other's page, be it named by its id or by MLflow's.
    pages = {f"mlflow.sharedViewState.freemesh-{name}": "theirs" for name in (path.stem, other)}
    world.store.views |= pages
    world.deliver()
    assert world.store.views.items() >= pages.items()
    for name in pages:
        del world.store.views[name]
    world.check()
    (own,) = [run for run in world.store.runs.values() if run.run_id not in world.others]
    assert own.stage == "deleted"
    assert own.tags["mlflow.note.content"].endswith("ours now")
    assert list(world.store.views) == [f"mlflow.sharedViewState.freemesh-{own.run_id}"]


BOOTED = owner_module._booted()
#: Changes to this process's owner, when it was started in seconds since the machine was, and whether it is gone.
PROCESSES: dict[str, tuple[dict[str, str], float, bool]] = {
    "this process": ({}, 10.0, False),
    "a process that has ended": ({"process": "{namespace}:4194305:5"}, 10.0, True),
    "an earlier process with our id": ({"process": "{namespace}:{pid}:1"}, 10.0, True),
    "another container's process": ({"process": "1:4194305:5"}, 10.0, False),
    "a process of an earlier start": ({"boot": "2" * 16}, -10.0, True),
    "a clone of this machine": ({"boot": "2" * 16}, 10.0, False),
    "another machine of this name": ({"machine": "1" * 16, "boot": "2" * 16}, -10.0, False),
    "another user's": ({"user": "0" * 16, "boot": "2" * 16}, -10.0, False),
}


@pytest.mark.skipif(not Path("/proc/stat").exists(), reason="tells no start of the machine")
@pytest.mark.parametrize("filters", [True, False])
@pytest.mark.parametrize("process", PROCESSES)
def test_a_run_whose_folder_is_gone_is_failed_if_its_process_is_known_to_be(
    process: str, filters: bool, world: World
) -> None:
    changes, since, gone = PROCESSES[process]
    here = Owner.here()
    namespace, pid, _ = here.process.split(":")
    told = here.told() | {name: text.format(namespace=namespace, pid=pid) for name, text in changes.items()}
    tags = {"freemesh.id": "20260101T000000-lost"} | {f"freemesh.{name}": text for name, text in told.items()}
    run = world.store.add(tags=tags, started=int((BOOTED + since) * 1000))
    world.store.filters = filters
    world.deliver()
    assert (run.status == "FAILED") == gone
    assert {request.path.split("/")[-1] for request in world.store.requests if request.method == "POST"} <= {
        "search", "update",
    }  # fmt: skip


@pytest.mark.parametrize(("changes", "since", "over"), [
    ({}, 10.0, True),  # the lock is free
    ({"process": "1:4194305:5"}, 10.0, True),  # another container: locks hold on one machine
    ({"boot": "2" * 16}, -10.0, True),
    ({"boot": "2" * 16}, 10.0, False),
    ({"machine": "1" * 16, "boot": "2" * 16}, -10.0, False),
    ({"user": "0" * 16}, -10.0, False),
])  # fmt: skip
def test_a_journal_of_a_run_that_may_be_at_work_is_left_alone(
    changes: dict[str, str], since: float, over: bool, world: World
) -> None:
    path = recorded(world, "run", owner=Owner.here().told() | changes)
    for kind in ("start", "metrics"):
        change(path, kind, time=int((BOOTED + since) * 1000))
    before = path.read_bytes()
    world.deliver()
    assert bool(stored(world, path)) == over
    assert (path.read_bytes() != before) == over


def test_a_run_that_said_that_it_ended_is_delivered_from_any_machine(world: World) -> None:
    path = recorded(world, "run", owner=Owner.here().told() | {"machine": "1" * 16, "boot": "2" * 16})
    with path.open("a") as file:
        file.write(json.dumps({"kind": "end", "time": 2000, "status": "FINISHED"}) + "\n")
    assert sync(world.runs, world.store.url, within=world.folders) == 6
    assert stored(world, path)[0]["info"]["status"] == "FINISHED"


def test_a_start_delivers_what_a_killed_run_recorded_and_no_more(world: World) -> None:
    here = Owner.here().told() | {"process": "1:4194305:5"}
    paths = {name: recorded(world, name, owner=here) for name in ("killed", "named", "elsewhere", "outside")}
    shutil.move(paths["outside"].parents[1], world.home / "outside" / "run")
    for name, path in paths.items():
        tags = {"freemesh.id": path.stem, "freemesh.journal": str(world.home / "outside" / "theirs.jsonl")}
        run = world.store.add(tags=tags | {f"freemesh.{key}": text for key, text in here.items()})
        uri = world.elsewhere.url if name == "elsewhere" else world.store.url
        if name != "outside":
            change_state(path, run_id="8" * 32 if name == "named" else run.run_id, uri=uri)
    with MLflowRun(
        world.runs / "new", uri=world.store.url, experiment="test", name="new", folders=world.folders, flush_seconds=60
    ):
        pass
    world.check()
    status = {run.tags["freemesh.id"][16:]: run.status for run in world.store.runs.values() if len(run.tags) > 3}
    assert {name: status[name] for name in paths} == {
        "killed": "FAILED", "named": "RUNNING", "elsewhere": "RUNNING", "outside": "RUNNING",
    }  # fmt: skip


# ---- no delay --------------------------------------------------------------------------------------------------------


def test_what_a_run_records_does_not_wait_for_killed_runs(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    stuck, begun = threading.Event(), threading.Event()

    def hang(*_: Any) -> None:
        begun.set()
        stuck.wait(LIMIT)

    monkeypatch.setattr(recording, "fail_killed_runs", hang)
    monkeypatch.setattr(recording, "BATCH_SECONDS", 0.05)
    run = MLflowRun(world.runs / "a", uri=world.store.url, experiment="test", name="a", flush_seconds=0.5)
    try:
        assert begun.wait(LIMIT)
        run.metrics({"loss": 1.0}, 1)
        arrived(world, run)
        run.close()  # nor does its end
        assert world.store.runs[str(run.run_id)].status == "FINISHED"
    finally:
        stuck.set()


def arrived(world: World, run: MLflowRun) -> None:
    """Wait until the store has a metric of a run."""
    deadline = time.monotonic() + LIMIT
    while not (run.run_id and world.store.runs[run.run_id].metrics):
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.mark.parametrize(("limit", "value"), [("BYTES", 10), ("RUNS", 0), ("until", -math.inf)])
def test_a_start_leaves_what_takes_too_long_to_sync(
    limit: str, value: float, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = Owner.here().told() | {"boot": "2" * 16}
    path = recorded(world, "killed", owner=here)
    run = world.store.add(tags={"freemesh.id": path.stem} | {f"freemesh.{key}": text for key, text in here.items()})
    change_state(path, run_id=run.run_id)
    if limit != "until":
        monkeypatch.setattr(killed_runs, limit, value)
    until = value if limit == "until" else math.inf
    fail_killed_runs(world.store.url, "test", "none", world.folders, until)
    assert (run.status, run.metrics) == ("RUNNING", [])
    assert sync(world.runs, world.store.url, within=world.folders) == 6
    assert run.status == "FAILED"


def test_a_huge_line_and_a_damaged_beginning_are_left_out(world: World) -> None:
    path = recorded(world, "attack")
    lines = path.read_bytes().split(b"\n")
    lines[1:1] = [b"[" * 8_000_000, b'{"kind": "metrics", "values": {"a": 1' + b"0" * 8_000_000, b"\x00" * 3_000_000]
    path.write_bytes(b"\n".join(lines))
    assert sync(world.runs, world.store.url, within=world.folders) == 9
    (run,) = world.store.runs.values()
    assert [metric[0] for metric in run.metrics] == ["loss", "loss"]
    headless = recorded(world, "headless")
    headless.write_bytes(headless.read_bytes().split(b"\n", 1)[1])
    assert sync(world.runs, world.store.url, within=world.folders) == 5
    assert stored(world, headless) == []


@pytest.mark.parametrize("chunks", range(1, 12))
def test_the_end_of_a_line_too_long_is_no_event(chunks: int, tmp_path: Path) -> None:
    event = json.dumps({"kind": "end", "time": 1, "status": "FINISHED"}).encode()
    path = tmp_path / "a.jsonl"
    path.write_bytes(b" " * (CHUNK * chunks) + event + b"\n" + event + b"\n")
    descriptor = os.open(path, os.O_RDONLY)
    try:
        lines = list(entries(descriptor))
    finally:
        os.close(descriptor)
    long = CHUNK * chunks + len(event) > LINE_BYTES
    assert [each.get("status") for each, _ in lines] == [None if long else "FINISHED", "FINISHED"]
    assert lines[-1][1] == path.stat().st_size


def test_what_cannot_be_read_is_passed_by(tmp_path: Path) -> None:
    home = Path(tempfile.mkdtemp(prefix="freemesh-"))
    try:
        home.chmod(0o755)
        for name in ("colleague", "mine"):
            (home / name / "tracking").mkdir(parents=True)
            (home / name / "tracking" / "a.jsonl").touch()
        (home / "linked").symlink_to(home / "mine")
        (home / "mine" / "tracking" / "b.jsonl").symlink_to(home / "mine" / "tracking" / "a.jsonl")
        (home / "colleague").chmod(0)
        root = os.geteuid() == 0
        try:
            if root:
                os.seteuid(65534)
            assert list(found(home)) == [home / "mine" / "tracking" / "a.jsonl"]
        finally:
            if root:
                os.seteuid(0)
            (home / "colleague").chmod(0o700)
    finally:
        shutil.rmtree(home)


# ---- at random -------------------------------------------------------------------------------------------------------

Rng = random.Random


def hostile(rng: Rng, world: World, folder: Path) -> Any:
    """A value of ill will, or of none."""
    other = rng.choice([*world.others, "0" * 32])
    return rng.choice([
        str(world.home / "outside" / "id_rsa"), str(world.home / "outside" / "theirs.jsonl"), "../../outside/id_rsa",
        str(folder / "link"), str(folder / "hard"), str(folder / "pipe"), str(folder / "linked" / "id_rsa"),
        str(folder / "config.yaml"), str(folder), "/proc/self/environ", "/dev/null", "/", "", ".", "..", "\0",
        world.elsewhere.url, f"{world.elsewhere.url}/api/2.0/mlflow-artifacts/artifacts/1/x", "file:///", "sqlite:///x",
        world.store.url.replace("//", f"//x@{world.elsewhere.netloc}@"), world.store.url, other, "mesher", "best",
        "x' or tags.`freemesh.id` != 'y", Owner.here().user, ANOTHER, ANOTHER["user"], Owner.here().told(),
        {"mlflow.parentRunId": other, "freemesh.id": "x", "freemesh.user": ANOTHER["user"]}, {"a": world.elsewhere.url},
        "FINISHED", "DELETED", "metrics", "artifact", "model", "start", "end", "summary", "delete", "\ud800",
        "\x1b[31m", "é" * 30_000,
        "nan", None, True, -1, 0, 1, 2**53, 2**70, -(10**400), float("inf"), float("nan"), [], {}, [[]] * 100, {"": ""},
    ])  # fmt: skip


def mutated(rng: Rng, value: Any, world: World, folder: Path) -> Any:
    """A JSON value with one place of it changed, left out or added."""
    if isinstance(value, dict) and value and rng.random() < 0.85:
        key = rng.choice(list(value))
        if rng.random() < 0.1:
            return {name: each for name, each in value.items() if name != key}
        if rng.random() < 0.1:
            name = hostile(rng, world, folder)
            return value | {name if isinstance(name, str) else key: hostile(rng, world, folder)}
        return value | {key: mutated(rng, value[key], world, folder)}
    return hostile(rng, world, folder)


def mutate(rng: Rng, path: Path, world: World) -> None:
    """Change a journal, its state and its folder in one to four ways."""
    folder, about = path.parents[1], path.with_suffix(".json")
    (folder / "link").symlink_to(world.home / "outside" / "id_rsa")
    (folder / "linked").symlink_to(world.home / "outside")
    os.link(world.home / "outside" / "id_rsa", folder / "hard")
    os.mkfifo(folder / "pipe")
    events = [json.loads(line) for line in path.read_text().splitlines()]
    told = json.loads(about.read_text())
    if rng.random() < 0.3:
        events.append({"kind": "end", "time": 2000, "status": rng.choice(["FINISHED", "FAILED", "KILLED"])})
    if rng.random() < 0.3:
        charts = {"curves": ["iqm/return"], "seeds": ["eval_deterministic/return"]}
        events.append({"kind": "summary", "time": 2000, "step": 2, "text": "# A study", "values": {}, "charts": charts})
    if rng.random() < 0.1:
        events.append({"kind": "delete", "time": 2001})
    for _ in range(rng.randint(1, 4)):
        if rng.random() < 0.25:
            told = mutated(rng, told, world, folder) if isinstance(told, dict) else told
        else:
            i = rng.randrange(len(events))
            events[i] = mutated(rng, events[i], world, folder)
        if rng.random() < 0.1:
            rng.shuffle(events)
    path.write_text("".join(json.dumps(event) + "\n" for event in events))
    about.write_text(json.dumps(told))
    if rng.random() < 0.2:
        damaged = rng.choice([path, about])
        damaged.write_bytes(*mutants(damaged.read_bytes(), 1, rng.randrange(2**31)))
    if rng.random() < 0.1:
        theirs = rng.choice([world.home / "outside" / "theirs.jsonl", world.home / "outside" / "id_rsa"])
        rng.choice([_journal_is_a_link, _journal_is_a_hard_link, _tracking_is_a_link, _journal_is_a_pipe])(path, theirs)


def tagged(rng: Rng, path: Path, world: World) -> None:
    """A run of the store that claims to be the journal's, or nearly; those that are not this user's are watched."""
    here = Owner.here()
    told = here.told() | {"process": rng.choice(["1:4194305:5", here.process])}
    tags = {"freemesh.id": path.stem, "freemesh.host": "here", "freemesh.journal": str(path)}
    tags |= {f"freemesh.{name}": text for name, text in told.items()}
    for _ in range(rng.randint(0, 3)):
        key, value = rng.choice(list(tags)), hostile(rng, world, path.parents[1])
        text = value if isinstance(value, str) else json.dumps(value)
        tags[key] = text.encode(errors="replace").decode()
    run = world.store.add(tags=tags, started=rng.choice([0, 10**15, 1000]))
    if rng.random() < 0.5:
        change_state(path, run_id=run.run_id)
    ours = tags["freemesh.user"] == here.user
    lost = tags["freemesh.machine"] == here.machine and tags["freemesh.boot"] != here.boot  # and so it is FAILED
    if not ours or (tags["freemesh.id"] != path.stem and not lost):
        world.others[run.run_id] = run.told()


@pytest.mark.slow
def test_nothing_foreign_leaves_by_mutated_journals_and_tags(world: World) -> None:
    rng, slowest = random.Random(12), 0.0
    for _ in range(5):
        world.add_other(**{f"freemesh.{name}": text for name, text in ANOTHER.items()})
    world.store.place = lambda run_id: (
        rng.choice(PLACES).format(
            elsewhere=world.elsewhere.url, netloc=world.elsewhere.netloc, home=world.home, store=world.store.url
        )
        if rng.random() < 0.2
        else f"mlflow-artifacts:/1/{run_id}/artifacts"
    )
    world.store.redirect = lambda request: world.elsewhere.url if rng.random() < 0.005 else None
    outside = contents(world.home / "outside")
    sent = 0
    for batch in range(COUNT // BATCH):
        world.store.filters = rng.random() < 0.5
        for i in range(BATCH):
            path = recorded(world, f"{batch}-{i}")
            tagged(rng, path, world)
            mutate(rng, path, world)
        begin = time.monotonic()
        world.deliver()
        if batch % 10 == 0:
            with MLflowRun(
                world.runs / "live", uri=world.store.url, experiment="test", name="live", folders=world.folders,
                flush_seconds=60,
            ) as run:  # fmt: skip
                run.metrics({"loss": 1.0}, 1)
                arrived(world, run)
        slowest = max(slowest, time.monotonic() - begin)
        world.check()
        assert contents(world.home / "outside") == outside
        sent += len(world.store.files())
        forget(world)
    print(f"{COUNT:,} journals, {sent:,} files sent, all of them their runs' own; {BATCH} took {slowest:.1f} s at most")
    assert sent > COUNT / 10  # most mutants are no journals any more, but some are
    assert slowest < LIMIT


def contents(folder: Path) -> dict[Path, bytes]:
    """What the files of a folder hold."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def forget(world: World) -> None:
    """Make room for the next journals, but keep the runs of others."""
    world.store.requests.clear()
    kept = dict(list(world.others.items())[:50])
    world.others.clear()
    world.others.update(kept)
    for run_id in world.store.runs.keys() - kept.keys():
        del world.store.runs[run_id]
    world.store.views.clear()
    for folder in world.runs.iterdir():
        folder.unlink() if folder.is_symlink() else shutil.rmtree(folder)
