"""A fresh clone in which the documents' commands run word for word, with this Python's environment as ``.venv``."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from checkout import ROOT, files
from processes import QUIET, outside

#: Seconds until a command has ended, or shown its first sign of work, on the slowest machine.
DEADLINE = 600
#: What this package and Ray read from the environment that a newcomer's shell does not have.
FOREIGN = ("FREEMESH_", "MLFLOW_", "RAY_", "MAKE", "MFLAGS")


@dataclass(frozen=True)
class Ended:
    """A command that ended: its exit code, and what it printed on stdout and stderr together."""

    code: int
    output: str


class Clone:
    """The files of a clone in a folder of their own; compiled kernels are those of this checkout."""

    def __init__(self, folder: Path) -> None:
        """Copy the files and make ``.venv``, of links, as newly installed."""
        self.folder = folder
        for name in files():
            place = folder / name
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, place)
        environment = folder / ".venv"
        environment.mkdir()
        for entry in Path(sys.prefix).iterdir():
            if entry.name != ".installed":
                (environment / entry.name).symlink_to(entry)
        (environment / ".installed").touch()
        kept = {key: value for key, value in outside().items() if not key.startswith(FOREIGN)}
        self._variables = kept | QUIET | {"PYTHONPATH": str(ROOT), "RAY_USAGE_STATS_ENABLED": "0"}
        self._interrupted: dict[str, Ended] = {}

    def run(self, line: str) -> Ended:
        """Run a line of shell to its end."""
        done = subprocess.run(
            ["bash", "-c", line], cwd=self.folder, env=self._variables, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=DEADLINE,
        )  # fmt: skip
        return Ended(done.returncode, done.stdout)

    def python(self, text: str) -> Ended:
        """Run a block of Python."""
        done = subprocess.run(
            [sys.executable, "-P", "-c", text], cwd=self.folder, env=self._variables,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=DEADLINE,
        )  # fmt: skip
        return Ended(done.returncode, done.stdout)

    def interrupted(self, line: str, sign: str) -> Ended:
        """Start a line once, wait for its first sign of work, press Ctrl-C, and wait for its end."""
        if line not in self._interrupted:
            with self.started(line, sign) as process:
                os.killpg(process.pid, signal.SIGINT)
                rest, _ = process.communicate(timeout=DEADLINE)
            self._interrupted[line] = Ended(process.returncode, rest)
        return self._interrupted[line]

    @contextmanager
    def started(self, line: str, sign: str) -> Iterator[subprocess.Popen[str]]:
        """A line of shell that has shown its first sign of work, a regular expression of a line; killed at the end."""
        process = subprocess.Popen(
            ["bash", "-c", f"exec {line}"], cwd=self.folder, env=self._variables, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
        )  # fmt: skip
        watch = threading.Timer(DEADLINE, os.killpg, (process.pid, signal.SIGKILL))
        watch.start()
        try:
            assert process.stdout is not None
            seen = []
            for text in process.stdout:
                seen.append(text)
                if re.search(sign, text):
                    break
            else:
                raise AssertionError(f"`{line}` ended without {sign!r}:\n{''.join(seen)}")
            watch.cancel()
            yield process
        finally:
            watch.cancel()
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
