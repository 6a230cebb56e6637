"""The supervisor of a worker process: starts it, hands it requests, starts another when it is gone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from http import HTTPStatus
from multiprocessing import Pipe
from multiprocessing.connection import Connection

from freemesh_ray.policies.policy import Policy
from freemesh_ray.serving.answer import Answer, MeshRequest, refusal
from freemesh_ray.serving.limits import Limits

#: Workers that may die over one request before it is given up: one may have been killed by somebody else.
TRIES = 2


class WorkerError(RuntimeError):
    """A worker process that ends before it is ready."""


class Supervisor:
    """Keeps one worker process; to be used by one thread."""

    def __init__(self, policies: Mapping[str, Policy], limits: Limits) -> None:
        """Describe the worker.

        Args:
            policies: by density.
            limits: of a request.
        """
        self._policies, self._limits = dict(policies), limits
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection | None = None

    def start(self) -> None:
        """Start a worker, if there is none, and wait until its kernels are compiled.

        Raises:
            WorkerError: it ends before.
        """
        if self._process is not None and self._process.poll() is None:
            return
        self.stop()
        self._connection, theirs = Pipe()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "freemesh_ray.serving.worker", str(theirs.fileno())],
                # What can be imported here can be imported there.
                env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
            )
        try:
            self._connection.send((self._policies, self._limits))
            self._connection.recv()
        except (EOFError, OSError):
            raise WorkerError(f"a worker process ended with {self._end()} before it was ready") from None

    def answer(self, request: MeshRequest) -> Answer:
        """The worker's answer; 500 when worker after worker dies over the request, 504 when its time is up.

        Raises:
            WorkerError: no worker can be started.
        """
        for _ in range(TRIES):
            self.start()
            assert self._connection is not None
            try:
                self._connection.send(request)
                return self._connection.recv()
            except (EOFError, OSError):
                if self._end() == -signal.SIGALRM:
                    return refusal(
                        HTTPStatus.GATEWAY_TIMEOUT,
                        f"not meshed within {self._limits.seconds:g} s; use a larger edge_length, a simpler polygon or "
                        "best_of=1",
                    )
        return refusal(HTTPStatus.INTERNAL_SERVER_ERROR, "this polygon takes the mesher down; change it a little")

    def stop(self) -> None:
        """End the worker, if there is one."""
        if self._process is not None:
            self._process.kill()
            self._end()
        if self._connection is not None:
            self._connection.close()
        self._process = self._connection = None

    def _end(self) -> int:
        """The exit status of the worker, which has closed its connection or was killed."""
        assert self._process is not None
        return self._process.wait()
