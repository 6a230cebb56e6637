"""The supervisor of a worker: hands it requests, and goes on with the next one when it is gone."""

from __future__ import annotations

import os
import secrets
import select
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from http import HTTPStatus
from multiprocessing.connection import Connection
from pathlib import Path

from freemesh_ray.local_ray.processes import Process, process
from freemesh_ray.local_ray.variables import FOLDER
from freemesh_ray.policies.policy import Policy
from freemesh_ray.serving.answer import Answer, MeshRequest, refusal
from freemesh_ray.serving.awake import LOOK, Awake
from freemesh_ray.serving.limits import Limits

#: Workers that may die over one request before it is given up: one may have been killed by somebody else.
TRIES = 2

#: Seconds beside a request's own after which a worker that does not answer is killed.
SLACK = 5.0


class WorkerError(RuntimeError):
    """A worker process that ends before it is ready."""


def new_folder() -> Path:
    """Where a process that forks workers is to make their folder; those whose supervisors were killed are removed.

    It removes the folder itself when its supervisor is gone, unless it was killed with it, as Ray does.
    """
    private, this = os.environ.get(FOLDER), process(os.getpid())
    for left in Path(private).glob("worker-*-*-*") if private and this else ():
        _, number, began, _ = left.name.split("-")
        if not Process(int(number), int(began)).alive:
            shutil.rmtree(left, ignore_errors=True)
    name = f"worker-{os.getpid()}-{this.began if this else 0}-{secrets.token_hex(8)}"  # which nobody can guess
    return Path(private or tempfile.gettempdir()) / name


class Supervisor:
    """Has one worker at a time; to be used by one thread.

    The process that it starts forks the workers, so that the next one is there in no time (see `worker`).
    """

    def __init__(self, policies: Mapping[str, Policy], limits: Limits, lane: str) -> None:
        """Describe the worker.

        Args:
            policies: by density.
            limits: of a request.
            lane: of `lanes.LANES`.

        ``overran`` says of the last request whether it looked quick and was ended for its processor time.
        """
        self._policies, self._limits, self._lane = dict(policies), limits, lane
        self._process: subprocess.Popen[bytes] | None = None
        self._control: socket.socket | None = None
        self._connection: Connection | None = None
        self._last_status = 0
        self.overran = False
        self._folder: Path | None = None

    def start(self) -> None:
        """Start the processes, if there are none, and wait until kernels are compiled.

        Raises:
            WorkerError: they end before.
        """
        if self.alive():
            return
        self.stop()
        self._folder = new_folder()
        self._control, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "freemesh_ray.serving.worker", str(theirs.fileno()), str(self._folder)],
                # What can be imported here can be imported there.
                env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
            )
        try:
            with Connection(os.dup(self._control.fileno())) as once:
                once.send((self._policies, self._limits, self._lane))
            self._next()
        except (EOFError, OSError):
            raise WorkerError(f"a worker process ended with {self._process.wait()} before it was ready") from None

    def alive(self) -> bool:
        """Whether the process that forks the workers is there."""
        return self._process is not None and self._process.poll() is None

    def answer(self, request: MeshRequest) -> Answer | None:
        """The worker's answer; None for a request that is too costly for the quick lane.

        A request's time being up is 504, workers that die over it one after another are 503 when they were killed,
        and 500 when they crashed.

        Raises:
            WorkerError: no worker can be started.
        """
        self.overran = False
        for left in reversed(range(TRIES)):
            self.start()
            clock = Awake()
            try:
                self._newest()
                assert self._connection is not None
                self._connection.send(request)
                while clock.seconds() < self._limits.seconds + SLACK:
                    if self._connection.poll(LOOK):
                        return self._connection.recv()
                self.stop()
                continue
            except (EOFError, OSError):
                pass
            try:
                self._next()
            except (EOFError, OSError):
                self.stop()
                continue
            if self._last_status == -signal.SIGPROF:  # only in the quick lane (see `worker.limit_time`)
                self.overran = True
                return None
            if self._last_status == -signal.SIGALRM:
                clock.seconds()
                if clock.asleep and left:  # the worker was asleep, too, and its alarm went on
                    continue
                return refusal(
                    HTTPStatus.GATEWAY_TIMEOUT,
                    f"not meshed within {self._limits.seconds:g} s; use a larger edge_length, a simpler polygon or "
                    "best_of=1",
                )
        if self._last_status == -signal.SIGKILL:
            return refusal(
                HTTPStatus.SERVICE_UNAVAILABLE,
                "the mesher was killed twice over this polygon, which the system does when memory runs out; use a "
                "larger edge_length, or try again",
            )
        return refusal(HTTPStatus.INTERNAL_SERVER_ERROR, "this polygon takes the mesher down; change it a little")

    def stop(self) -> None:
        """End the processes, if there are any."""
        for end in (self._connection, self._control):
            if end is not None:
                end.close()
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
        self._process = self._control = self._connection = self._folder = None

    def _next(self) -> None:
        """Take the connection of the next worker, when there is one.

        Raises:
            EOFError: the process that forks them is gone.
        """
        assert self._control is not None
        told, descriptors, _, _ = socket.recv_fds(self._control, 4, 1)
        if not descriptors:
            raise EOFError
        if self._connection is not None:
            self._connection.close()
        self._connection = Connection(descriptors[0])
        self._last_status = int.from_bytes(told, "big", signed=True)

    def _newest(self) -> None:
        """Take the connection of the newest worker: others may have ended since the last request."""
        assert self._control is not None
        while select.select([self._control], [], [], 0.0)[0]:
            self._next()
