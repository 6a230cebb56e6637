"""Processes of an embedded Ray that die, and signals that nobody listens to: one line, an exit code, nothing left."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from checkout import ROOT
from process_tree import RAY, Command, running

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="processes are told by /proc"),
]

#: Of a command that has nothing but a Ray and an actor that never answers, and obeys signals as a training does.
WAITING = """
import time
from envs.errors import INTERRUPTED
from freemesh_ray.training.stop_signal import StopSignal
from freemesh_ray.local_ray import local_ray

with local_ray(1, "mend it") as session:
    import ray

    @ray.remote
    def sleep():
        time.sleep(10_000)

    with StopSignal(lambda: session.end("interrupted", INTERRUPTED)):
        asleep = sleep.remote()
        print("ready", flush=True)
        while True:
            ray.wait([asleep], timeout=1000)
"""
#: Seconds within which all has to be over; a few on a machine that does nothing else.
PATIENCE = 10.0


@pytest.fixture
def places() -> Iterator[dict[str, str]]:
    """Variables that tell Ray to use a folder of the test's, with a path that is short enough."""
    folder = Path(f"/tmp/s{os.getpid()}")
    folder.mkdir(mode=0o700)
    yield {"RAY_TMPDIR": str(folder)}
    left = list(folder.iterdir())
    shutil.rmtree(folder)
    assert left == []


def test_nothing_is_imported_from_the_folder_that_it_is_started_in(tmp_path: Path, places: dict[str, str]) -> None:
    """As an installed command is: Python itself puts that folder first for what is run as a module."""
    folder, script = tmp_path / "downloads", tmp_path / "bin" / "command.py"
    folder.mkdir()
    script.parent.mkdir()
    for name in ("shutil", "select", "uvicorn", "h11", "cloudpickle", "numba", "envs"):
        (folder / f"{name}.py").write_text(f"open({str(tmp_path / 'imported')!r}, 'a').write({name!r})\n")
    script.write_text(WAITING)
    with running([str(script)], folder, places | {"PYTHONPATH": str(ROOT)}) as command:
        command.until(lambda: "ready" in command.output and command.named("ray::sleep"), 120, "starts")
        command.process.terminate()
        assert command.ended(60) == 130
    assert not (tmp_path / "imported").exists()


@pytest.fixture
def waiting(tmp_path: Path, places: dict[str, str]) -> Iterator[Command]:
    with running(["-c", WAITING], tmp_path, places) as command:
        command.until(lambda: "ready" in command.output and command.named("ray::sleep"), 120, "starts")
        yield command


def told(command: Command) -> list[str]:
    """Its last words."""
    return [line for line in command.output.splitlines() if line.startswith("freemesh:")]


@pytest.mark.parametrize("name", ["GCS", "raylet", "dashboard agent", "runtime env agent"])
def test_the_death_of_a_process_that_all_depends_on_is_the_command_s_end(name: str, waiting: Command) -> None:
    (victim,) = waiting.named(RAY[name])
    began = time.monotonic()
    os.kill(victim, signal.SIGKILL)
    assert waiting.ended(PATIENCE) == 1
    print(f"{time.monotonic() - began:.1f} s")
    line = f"freemesh: Ray's {name} (process {victim}) is gone, killed or out of memory: mend it"
    assert told(waiting) == [line]


def test_of_a_command_that_is_killed_nothing_is_left(waiting: Command) -> None:
    os.kill(waiting.named("ray::sleep")[0], signal.SIGSTOP)  # it cannot notice anything
    began = time.monotonic()
    waiting.process.kill()
    assert waiting.ended(PATIENCE) == -signal.SIGKILL
    print(f"{time.monotonic() - began:.1f} s")
    assert told(waiting) == ["freemesh: this command, or its Ray, is gone, killed or out of memory: mend it"]


def test_a_signal_is_obeyed_though_the_work_hangs(waiting: Command) -> None:
    began = time.monotonic()
    waiting.process.terminate()
    assert waiting.ended(PATIENCE) == 130
    print(f"{time.monotonic() - began:.1f} s")
    assert waiting.output.splitlines() == ["ready", "freemesh: interrupted"]


def test_a_signal_is_obeyed_while_ray_starts(tmp_path: Path, places: dict[str, str]) -> None:
    sets = ["--set", "tracking.enabled=false", "--set", f"paths.runs={tmp_path}"]
    arguments = ["-m", "freemesh_ray", "train", "--config", "train_smoke.yaml", *sets]
    with running(arguments, tmp_path, places) as command:
        command.until(lambda: command.named(RAY["GCS"]), 120, "starts")
        began = time.monotonic()
        command.process.terminate()
        assert command.ended(PATIENCE) == 130
        print(f"{time.monotonic() - began:.1f} s")
        assert command.output.splitlines()[-1] == "freemesh: interrupted"


def test_a_signal_is_obeyed_though_the_tracking_server_takes_connections_and_never_answers(
    tmp_path: Path, places: dict[str, str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        store = f"tracking.uri=http://127.0.0.1:{silent.getsockname()[1]}"
        long = ["budget.env_steps=1e9", "budget.minutes=null", "evaluation.interval=1e9"]
        sets = [f"--set={each}" for each in (store, f"paths.runs={tmp_path}", "runners.count=0", *long)]
        arguments = ["-m", "freemesh_ray", "train", "--config", "train_smoke.yaml", *sets]
        with running(arguments, tmp_path, places) as command:
            command.until(lambda: "step " in command.output, 300, "trains")
            began = time.monotonic()
            command.process.terminate()
            assert command.ended(PATIENCE) == 130
            print(f"{time.monotonic() - began:.1f} s")
            assert "not all is delivered yet" in command.output
            assert told(command)[-1] == "freemesh: interrupted"
