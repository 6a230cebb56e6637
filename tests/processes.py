"""Servers that tests start, kill and start again: real processes on the loopback device."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Self

from checkout import ROOT

#: MLflow without reports to its makers, and without the processes that run jobs for it.
QUIET: Mapping[str, str] = {"MLFLOW_DISABLE_TELEMETRY": "true", "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"}


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return probe.getsockname()[1]


def outside() -> dict[str, str]:
    """The environment without what tells of a Ray of this process's own."""
    return {key: value for key, value in os.environ.items() if not key.startswith("RAY_")}


class Server:
    """A process group that answers HTTP on ``port`` of the loopback device, in a ``with`` block."""

    def __init__(self, arguments: list[str], port: int, ready: str, log: Path, **environment: str) -> None:
        """Describe it.

        Args:
            arguments: of Python, as ``["-m", "module"]``.
            port: it listens on.
            ready: path that answers 200 as soon as it is ready.
            log: file that takes what it prints.
            environment: variables beside this process's own.
        """
        self.url, self.log, self._ready = f"http://127.0.0.1:{port}", log, ready
        self._command, self._environment = [sys.executable, *arguments], environment
        self._process: subprocess.Popen[bytes] | None = None

    def start(self, seconds: float = 300) -> None:
        """Start it and wait until it answers; on a busy machine its kernels may have to be compiled first."""
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"  # MLflow starts uvicorn by its name
        variables = os.environ | {"PATH": path, "PYTHONPATH": str(ROOT)} | self._environment
        with self.log.open("ab") as log:
            self._process = subprocess.Popen(
                self._command, env=variables, stdout=log, stderr=log, start_new_session=True, cwd=self.log.parent
            )
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline and self._process.poll() is None:
            try:
                with urllib.request.urlopen(self.url + self._ready, timeout=5):
                    return
            except OSError:
                time.sleep(0.1)
        self.kill()
        raise RuntimeError(f"{' '.join(self._command)} does not answer:\n{self.log.read_text()}")

    @property
    def pid(self) -> int:
        """Of the process that was started."""
        assert self._process is not None
        return self._process.pid

    def stop(self, seconds: float = 120) -> int:
        """Ask it to stop, as a scheduler would; its exit code."""
        assert self._process is not None
        self._process.terminate()
        return self._process.wait(seconds)

    def wait(self, seconds: float = 120) -> int:
        """Its exit code, when it ends by itself."""
        assert self._process is not None
        return self._process.wait(seconds)

    def kill(self) -> None:
        """Kill it and its children, as a power cut would."""
        if self._process:
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
            self._process = None

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()


def mlflow_server(folder: Path) -> Server:
    """The MLflow server of the store in ``folder``; its port stays the same when it is started again."""
    port = free_port()
    store = ["--backend-store-uri", f"sqlite:///{folder / 'mlflow.db'}"]
    artifacts = ["--artifacts-destination", str(folder / "mlartifacts")]
    arguments = ["-m", "mlflow", "server", "--host", "127.0.0.1", "--port", str(port), "--workers", "1"]
    return Server([*arguments, *store, *artifacts], port, "/health", folder / "server.log", **QUIET)


def post(url: str, body: bytes) -> tuple[int, str]:
    """The status and text that answer a JSON text."""
    request = urllib.request.Request(url, body, {"Content-Type": "application/json"})
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()
