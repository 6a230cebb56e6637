"""A worker that runs out of memory or time, is killed or stopped: its request gets an answer, and so do the next."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import pytest
from listening import family

from freemesh_ray.local_ray.variables import FOLDER
from freemesh_ray.policies.policy import SHIPPED, Policy
from freemesh_ray.serving.answer import MeshRequest
from freemesh_ray.serving.lanes import COSTLY, QUICK
from freemesh_ray.serving.limits import Limits
from freemesh_ray.serving.parameters import Parameters
from freemesh_ray.serving.supervisor import Supervisor, new_folder

SHEET = json.dumps({"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]]}).encode()
#: A mesh of 48 elements, one of 83,000, and one of a quarter million.
SMALL = MeshRequest(SHEET, Parameters("medium", edge_length=0.5))
MEDIUM = MeshRequest(SHEET, Parameters("medium", edge_length=0.012))
LARGE = MeshRequest(SHEET, Parameters("medium", edge_length=0.007))


@contextmanager
def supervisor(lane: str = COSTLY, **limits: float) -> Iterator[Supervisor]:
    one = Supervisor({"medium": Policy.load(SHIPPED["medium"])}, replace(Limits(), **limits), lane)
    one.start()
    try:
        yield one
    finally:
        one.stop()


def worker(one: Supervisor) -> int:
    """The worker; 0 between two of them."""
    assert one._process is not None
    return next(iter(family(one._process.pid)[1:]), 0)


@contextmanager
def sent_while_it_meshes(one: Supervisor, *numbers: signal.Signals) -> Iterator[list[int]]:
    """Send signals to the worker that is at work, each to another one."""
    victims: list[int] = []

    def send() -> None:
        for number in numbers:
            until(lambda: worker(one) not in (0, *victims) and busy(worker(one)))
            victims.append(worker(one))
            os.kill(victims[-1], number)

    sender = threading.Thread(target=send, daemon=True)
    sender.start()
    yield victims
    sender.join(30)
    assert len(victims) == len(numbers)


def busy(pid: int) -> bool:
    """Whether a process has used a tenth of a second of its core."""
    try:
        with open(f"/proc/{pid}/stat") as stat:
            return int(stat.read().rpartition(")")[2].split()[11]) > 10
    except OSError:
        return False


def until(true: Callable[[], bool], seconds: float = 30.0) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.005)


@pytest.mark.slow
def test_a_mesh_that_takes_too_much_memory() -> None:
    with supervisor(worker_bytes=60_000_000) as one:
        before = worker(one)
        refused = one.answer(LARGE)
        assert refused is not None
        assert refused.status == 413
        assert b"more than 0.06 GB of memory" in refused.body
        answer = one.answer(SMALL)
        assert answer is not None
        assert (answer.status, answer.elements, worker(one)) == (200, 48, before)


@pytest.mark.slow
def test_a_mesh_that_takes_too_long() -> None:
    with supervisor(seconds=0.3) as one:
        refused = one.answer(LARGE)
        assert refused is not None
        assert refused.status == 504
        began = time.monotonic()
        answer = one.answer(SMALL)
        assert answer is not None
        assert answer.status == 200
        assert time.monotonic() - began < 20  # a fork, not a start


@pytest.mark.slow
def test_what_is_too_costly_for_the_quick_lane() -> None:
    with supervisor(QUICK) as one:
        before = worker(one)
        assert one.answer(LARGE) is None
        assert not one.overran
        answer = one.answer(SMALL)
        assert answer is not None
        assert (answer.status, worker(one)) == (200, before)


@pytest.mark.slow
def test_no_request_waits_for_longer_than_its_time_in_the_quick_lane() -> None:
    with supervisor(QUICK, quick_expected=1e9, quick_seconds=60.0, seconds=0.3) as one:
        refused = one.answer(LARGE)
        assert refused is not None
        assert refused.status == 504


@pytest.mark.slow
def test_what_takes_too_long_for_the_quick_lane() -> None:
    with supervisor(QUICK, quick_expected=1e9, quick_seconds=0.2) as one:
        assert one.answer(LARGE) is None
        assert one.overran
        assert one.answer(SMALL) is not None
        assert not one.overran


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP, signal.SIGSEGV])
def test_a_worker_that_is_killed_or_stopped_while_it_meshes(number: signal.Signals) -> None:
    with supervisor() as one:
        began = time.monotonic()
        with sent_while_it_meshes(one, number):
            answer = one.answer(MEDIUM)
        assert answer is not None
        assert answer.status == 200
        # Nobody waited until its time was up.
        assert time.monotonic() - began < one._limits.seconds


@pytest.mark.slow
@pytest.mark.parametrize(("number", "status"), [(signal.SIGKILL, 503), (signal.SIGSEGV, 500)])
def test_a_polygon_that_workers_die_of(number: signal.Signals, status: int) -> None:
    with supervisor() as one:
        with sent_while_it_meshes(one, number, number):
            answer = one.answer(MEDIUM)
        assert answer is not None
        assert answer.status == status
        again = one.answer(SMALL)
        assert again is not None
        assert again.status == 200


@pytest.mark.slow
def test_the_process_that_forks_is_killed_while_its_worker_meshes() -> None:
    with supervisor() as one:
        assert one._process is not None
        before = one._process.pid
        killer = threading.Timer(0.2, os.kill, (before, signal.SIGKILL))
        killer.start()
        answer = one.answer(MEDIUM)
        killer.join()
        assert answer is not None
        assert answer.status == 200
        again = one.answer(SMALL)
        assert again is not None
        assert again.status == 200
        assert one._process.pid != before


def until_a_mesh_is_written(ours: Path) -> set[Path]:
    """The folders in which workers write just now."""
    found = set[Path]()

    def look() -> bool:
        with suppress(OSError):  # it has gone meanwhile
            found.update(ours.glob("worker-*/*"))
        return bool(found)

    until(look)
    return found


def until_gone(paths: set[Path]) -> None:
    until(lambda: not any(path.exists() for path in paths))


#: A mesh in a file of some hundred kilobytes.
WRITING = MeshRequest(SHEET, Parameters("medium", edge_length=0.03, format="inp", effort="quick"))


@pytest.mark.slow
@pytest.mark.parametrize("who", ["worker", "forking process", "supervisor's process"])
def test_no_temporary_file_outlives_its_worker(who: str, tmp_path: Path) -> None:
    """One that is killed while it writes a mesh has a folder for it."""
    ours = tmp_path / "ours"
    ours.mkdir()
    code = """if True:
        from test_supervisor import WRITING, supervisor
        with supervisor() as one:
            print(one._process.pid, flush=True)
            while True:
                one.answer(WRITING)
        """
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True,
        env=os.environ | {FOLDER: str(ours), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    ) as running:  # fmt: skip
        try:
            assert running.stdout is not None
            forking = int(running.stdout.readline())
            for _ in range(3 if who == "worker" else 1):
                written = until_a_mesh_is_written(ours)
                number = family(forking)[1] if who == "worker" else forking
                os.kill(running.pid if who == "supervisor's process" else number, signal.SIGKILL)
                until_gone(written)
        finally:
            running.kill()
    # A new one that has been started meanwhile finds out when its kernels are loaded.
    until(lambda: not any(ours.iterdir()), 300.0)


def test_folders_of_killed_supervisors_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ray kills what a mesher has started with it: the process that would have removed the folder is gone, too."""
    monkeypatch.setenv(FOLDER, str(tmp_path))
    ours, other = new_folder(), tmp_path / "another"
    left = tmp_path / f"worker-{os.getpid()}-1-ab"  # of an earlier process of this number
    for folder in (ours, other, left, left / "tmp1"):
        folder.mkdir()
    assert new_folder() not in (ours, left)
    assert sorted(tmp_path.iterdir()) == sorted([ours, other])


@pytest.mark.slow
@pytest.mark.parametrize("at_work", [False, True])
def test_nothing_is_left(at_work: bool) -> None:
    with supervisor() as one:
        assert one._process is not None
        processes = family(one._process.pid)
        assert len(processes) == 2
        if at_work:
            assert one._connection is not None
            one._connection.send(MEDIUM)
            until(lambda: busy(processes[1]))
    until(lambda: not any(os.path.exists(f"/proc/{pid}") for pid in processes))
