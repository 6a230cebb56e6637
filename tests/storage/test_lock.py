"""A folder's lock: one holder at a time, named to whoever comes second, gone with its process however that ends."""

from __future__ import annotations

import errno
import fcntl
import json
import logging
import math
import os
import platform
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from processes import ROOT

from envs.errors import UserError
from freemesh_ray.storage.lock import FILE, InUseError, held, holder

#: Holds a folder's lock until it is killed; the child that it starts outlives it.
HOLDER = """
import subprocess, sys
from pathlib import Path
from freemesh_ray.storage.lock import held

with held(Path(sys.argv[1]), "wait"):
    child = subprocess.Popen(["sleep", "60"], stdout=subprocess.DEVNULL)
    print(child.pid, flush=True)
    sys.stdin.read()
"""


@contextmanager
def working(folder: Path) -> Iterator[int]:
    """A process that holds the lock and is then killed; its id."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(folder)], env=os.environ | {"PYTHONPATH": str(ROOT)}, text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip
    assert process.stdout is not None
    child = int(process.stdout.readline())
    try:
        yield process.pid
        process.kill()
        process.wait()
        with held(folder, "wait"):  # though a child of its lives
            os.kill(child, 0)
    finally:
        process.kill()
        os.kill(child, signal.SIGKILL)


def test_the_second_is_told_who_the_first_is_until_that_is_killed(tmp_path: Path) -> None:
    with working(tmp_path) as pid, pytest.raises(InUseError) as raised, held(tmp_path, "wait for its end"):
        pass
    line = str(raised.value)
    assert line.startswith(f"{tmp_path}: process {pid} on {platform.node()} has worked here since 2")
    assert line.endswith("UTC: wait for its end")
    assert "\n" not in line
    assert raised.value.exit_code == 2


@pytest.mark.slow
def test_who_waits_gets_it_when_the_first_is_killed(tmp_path: Path) -> None:
    assert holder(tmp_path) is None
    process = subprocess.Popen(
        [sys.executable, "-c", "import sys; from pathlib import Path; from freemesh_ray.storage.lock import held\n"
         "with held(Path(sys.argv[1]), 'wait'): print('held', flush=True); sys.stdin.read()", str(tmp_path)],
        env=os.environ | {"PYTHONPATH": str(ROOT)}, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == b"held\n"
    assert str(process.pid) in (holder(tmp_path) or "")
    with pytest.raises(InUseError), held(tmp_path, "wait", patience=0.3):
        pass
    threading.Timer(0.5, process.kill).start()
    with held(tmp_path, "wait", patience=math.inf):
        assert process.wait() == -signal.SIGKILL
    assert holder(tmp_path) is None


def test_one_process_does_not_hold_it_twice(tmp_path: Path) -> None:
    with held(tmp_path, "wait"):
        with pytest.raises(InUseError, match=f"process {os.getpid()} on"), held(tmp_path, "wait"):
            pass
        assert json.loads((tmp_path / FILE).read_text())["pid"] == os.getpid()
    with held(tmp_path, "wait"):
        pass


@pytest.mark.parametrize("content", ["", "{", "[]", '{"pid": 7}', "\xff"])
def test_a_holder_that_has_not_yet_written_who_it_is_holds_it_too(content: str, tmp_path: Path) -> None:
    with held(tmp_path, "wait"):
        (tmp_path / FILE).write_text(content)
        with pytest.raises(InUseError, match="another process works here: wait"), held(tmp_path, "wait"):
            pass


def test_where_no_locks_are_the_work_goes_on_with_a_word(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def flock(descriptor: int, operation: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", flock)
    with caplog.at_level(logging.WARNING), held(tmp_path, "wait"):
        pass
    assert f"{tmp_path}: no lock can be had (No locks available): let no second process work there" in caplog.text


@pytest.mark.parametrize("make", [os.symlink, os.link])
def test_a_link_in_the_locks_place_is_refused_and_its_target_kept(make: Callable[..., None], tmp_path: Path) -> None:
    (tmp_path / "key").write_text("a key")
    (tmp_path / "run").mkdir()
    make(tmp_path / "key", tmp_path / "run" / FILE)
    with pytest.raises(UserError, match="is a link to another file: remove it"), held(tmp_path / "run", "wait"):
        pass
    assert (tmp_path / "key").read_text() == "a key"


def test_no_other_user_may_hold_it(tmp_path: Path) -> None:
    with held(tmp_path, "wait"):
        assert (tmp_path / FILE).stat().st_mode & 0o077 == 0


def test_a_lock_of_another_user_s_is_told_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a folder of a group; root may open every file, so the refusal is the test's."""
    (tmp_path / FILE).touch()

    def refuse(path: object, *arguments: object) -> int:
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(UserError, match=r"belongs to another user, who works here: choose another folder$"):
        held(tmp_path, "wait").__enter__()
