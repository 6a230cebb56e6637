"""What is no regular file is refused wherever state is read, and never waited for."""

from __future__ import annotations

import os
import signal
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

import pytest

from envs.errors import UserError
from freemesh_ray import config
from freemesh_ray.policies.policy import Policy
from freemesh_ray.records import parquet_file
from freemesh_ray.storage import lock, state_file
from freemesh_ray.storage.atomic import refusing_links
from freemesh_ray.storage.regular_file import copied
from freemesh_ray.studies.study_folder import StudyFolder
from freemesh_ray.training import checkpoint
from freemesh_ray.training.run_folder import RunFolder

#: Seconds after which what waits is taken to wait for ever.
PATIENCE = 120


@pytest.fixture(autouse=True)
def nothing_waits() -> Iterator[None]:
    def end(number: int, frame: FrameType | None) -> None:
        raise AssertionError("it waits")

    before = signal.signal(signal.SIGALRM, end)
    signal.alarm(PATIENCE)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def _pipe(path: Path) -> None:
    os.mkfifo(path)


def _endless(path: Path) -> None:
    path.symlink_to("/dev/zero")


def _terminal(path: Path) -> None:
    path.symlink_to("/dev/ptmx")


def _folder(path: Path) -> None:
    path.mkdir()


def _socket(path: Path) -> None:
    here = os.getcwd()
    os.chdir(path.parent)  # a socket's name is short
    try:
        with socket.socket(socket.AF_UNIX) as server:
            server.bind(path.name)
    finally:
        os.chdir(here)


def _linked_pipe(path: Path) -> None:
    os.mkfifo(path.with_name("pipe"))
    path.symlink_to(path.with_name("pipe"))


PLANTED = [_pipe, _endless, _terminal, _folder, _socket, _linked_pipe]


@pytest.fixture(params=PLANTED, ids=lambda plant: plant.__name__)
def plant(request: pytest.FixtureRequest) -> Callable[[Path], None]:
    return request.param


def _checkpoint(folder: Path, plant: Callable[[Path], None]) -> None:
    (folder / checkpoint.PROGRESS).write_text('{"env_steps": 1}')
    plant(folder / checkpoint.STATE)
    checkpoint.read(folder)


def _progress(folder: Path, plant: Callable[[Path], None]) -> None:
    state_file.save({}, folder / checkpoint.STATE)
    plant(folder / checkpoint.PROGRESS)
    checkpoint.read(folder)


def _policy(folder: Path, plant: Callable[[Path], None]) -> None:
    plant(folder / "policy.npz")
    Policy.load(folder / "policy.npz")


def _trials(folder: Path, plant: Callable[[Path], None]) -> None:
    plant(folder / "trials.json")
    StudyFolder(folder).read()


def _evaluations(folder: Path, plant: Callable[[Path], None]) -> None:
    plant(folder / "evaluations.jsonl")
    if RunFolder(folder).read_evaluations() == []:
        raise OSError(f"{folder}: nothing in it")


def _settings(folder: Path, plant: Callable[[Path], None]) -> None:
    plant(folder / "config.yaml")
    config.load([folder / "config.yaml"])


def _records(folder: Path, plant: Callable[[Path], None]) -> None:
    plant(folder / "records.parquet")
    parquet_file.read(folder / "records.parquet")


def _lock(folder: Path, plant: Callable[[Path], None]) -> None:
    plant(folder / lock.FILE)
    with lock.held(folder, "wait"), lock.held(folder, "wait"):
        pass


#: What reads state of others' making, each of which gives one line.
READERS = [_checkpoint, _progress, _policy, _trials, _evaluations, _settings, _records, _lock]


@pytest.mark.parametrize("read", READERS, ids=lambda read: read.__name__)
def test_it_is_refused_in_one_line(read: Callable[..., None], plant: Callable[[Path], None], tmp_path: Path) -> None:
    with pytest.raises((UserError, OSError)) as raised:
        read(tmp_path, plant)
    assert str(tmp_path) in str(raised.value)
    assert "\n" not in str(raised.value)


def test_it_is_not_copied(plant: Callable[[Path], None], tmp_path: Path) -> None:
    plant(tmp_path / "state.npz")
    (tmp_path / checkpoint.PROGRESS).write_text('{"env_steps": 1}')
    with pytest.raises((ValueError, OSError)):
        copied(tmp_path / "state.npz", tmp_path / "draft")
    assert not (tmp_path / "draft").exists()


def test_it_is_not_written_to(plant: Callable[[Path], None], tmp_path: Path) -> None:
    plant(tmp_path / "failures.log")
    for mode in ("ab", "ab+"):
        with pytest.raises(OSError), open(tmp_path / "failures.log", mode, opener=refusing_links) as file:  # noqa: PT011
            file.write(b"a" * 1_000_000)


def test_a_file_is_copied_whole(tmp_path: Path) -> None:
    (tmp_path / "source").write_bytes(b"\0a\n" * 100_000)
    copied(tmp_path / "source", tmp_path / "draft")
    assert (tmp_path / "draft").read_bytes() == (tmp_path / "source").read_bytes()
    with pytest.raises(FileExistsError):
        copied(tmp_path / "source", tmp_path / "draft")
