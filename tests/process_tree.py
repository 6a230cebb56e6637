"""The processes that a command has started, by what they are; killed with it at a test's end, whatever happened."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from checkout import ROOT
from processes import outside

#: What tells each process of Ray's from the others: a part of one of the first words of its command line.
RAY = {
    "GCS": "/gcs_server", "raylet": "/raylet/raylet", "monitor": "/monitor.py", "dashboard": "/dashboard/dashboard.py",
    "log monitor": "/log_monitor.py", "dashboard agent": "ray::DashboardAgent",
    "runtime env agent": "ray::RuntimeEnvAgent",
}  # fmt: skip


def command_line(number: int) -> str:
    """Of a process; empty when it is gone."""
    try:
        return Path(f"/proc/{number}/cmdline").read_text(errors="replace").replace("\0", " ").strip()
    except OSError:
        return ""


def state(number: int) -> str:
    """The letter of a process's state: T where it is stopped, X where it is gone."""
    try:
        return Path(f"/proc/{number}/stat").read_text(errors="replace").rpartition(")")[2].split()[0]
    except OSError:
        return "X"


def members(session: int) -> dict[int, str]:
    """Number and command line of every living process of a session."""
    found = {}
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            fields = (entry / "stat").read_text(errors="replace").rpartition(")")[2].split()
            if int(fields[3]) == session and fields[0] not in "ZX":
                found[int(entry.name)] = command_line(int(entry.name))
    return found


class Command:
    """``freemesh ...``, or another of Python's, in a session of its own."""

    def __init__(self, arguments: list[str], folder: Path, environment: Mapping[str, str] | None = None) -> None:
        self.log = folder / "output.txt"
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, *arguments], cwd=folder, stdout=log, stderr=subprocess.STDOUT, start_new_session=True,
                env=outside() | {"PYTHONPATH": str(ROOT)} | dict(environment or {}),
            )  # fmt: skip

    @property
    def output(self) -> str:
        """What it has said."""
        return self.log.read_text(errors="replace")

    def members(self) -> dict[int, str]:
        """Its processes: see `members`."""
        return members(self.process.pid)

    def named(self, part: str) -> list[int]:
        """Its processes one of whose first words has a part, oldest first."""
        return sorted(
            number for number, line in self.members().items() if any(part in word for word in line.split()[:4])
        )

    def until(self, holds: Callable[[], object], seconds: float, what: str) -> float:
        """Wait until something holds; the seconds that it took."""
        began = time.monotonic()
        while not holds():
            took = time.monotonic() - began
            assert took < seconds, f"{what}: not within {seconds:g} s:\n{self.output}"
            assert self.process.poll() is None, f"{what}: it has ended with {self.process.returncode}:\n{self.output}"
            time.sleep(0.05)
        return time.monotonic() - began

    def ended(self, seconds: float) -> int:
        """Wait for its end and that of all that it has started; its exit code."""
        deadline = time.monotonic() + seconds
        code = self.process.wait(seconds)
        while left := self.members():
            assert time.monotonic() < deadline, f"left behind: {left}"
            time.sleep(0.05)
        return code


@contextmanager
def running(arguments: list[str], folder: Path, environment: Mapping[str, str] | None = None) -> Iterator[Command]:
    """A command, killed at the end with all that it has started."""
    command = Command(arguments, folder, environment)
    try:
        yield command
    finally:
        while left := [*command.members()]:
            for number in left:
                with suppress(ProcessLookupError):
                    os.kill(number, signal.SIGKILL)
        command.process.wait()
