"""Starting and stopping the service, and watching over it."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from ipaddress import ip_address
from multiprocessing import Pipe

from envs.errors import FAILED
from freemesh_ray.policies.policy import Policy
from freemesh_ray.serving import session_processes
from freemesh_ray.serving.awake import Awake
from freemesh_ray.serving.limits import Limits
from freemesh_ray.serving.order import Order, ServiceEnded, ServiceError

#: Seconds between two looks at the service's processes, and without a sign of life after which it is given up.
LOOK, SILENT = 1.0, 8.0

#: Seconds that the service may take to end; what is left of it then is killed.
ENDING = 6.0


def is_loopback(host: str) -> bool:
    """Whether no other machine can reach a host's name or address."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def check_free(host: str, port: int) -> None:
    """Refuse an address that cannot be listened on, before anything is started.

    Raises:
        ServiceError: the port is taken, or the host is not this machine.
    """
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
        # As the server does: what has just been closed is free.
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        raise ServiceError(
            f"{host}:{port}: cannot be listened on ({error.strerror}): choose another --host or --port"
        ) from None


class Service:
    """A service that runs in processes of its own."""

    def __init__(self, order: Order) -> None:
        """Start it and wait until it serves.

        Args:
            order: what to serve, and where.

        Raises:
            UserError: it does not start.
        """
        self._connection, theirs = Pipe()
        with theirs:
            # In a session of its own: signals of the terminal reach it through this process alone.
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "freemesh_ray.serving.http_process", str(theirs.fileno())],
                env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        try:
            with suppress(OSError):  # it is dead already, which is told below
                self._connection.send(order)
            self._next()
        except BaseException:
            self.end()
            raise

    def wait(self) -> None:
        """Watch over it for as long as it serves: stopped processes are woken.

        Raises:
            ServiceEnded: it serves no more, in one line; what was left of it is killed.
            SystemExit: as above, where it has said so itself.
        """
        silence = Awake()
        try:
            while True:
                if self._connection.poll(LOOK):
                    self._next()
                    silence.restart()
                session_processes.wake_stopped(self._process.pid)
                if silence.seconds() > SILENT:
                    raise ServiceEnded(f"the service gave no sign of life for {SILENT:g} s: start it again")
        except (ServiceEnded, SystemExit):
            self._kill()
            raise

    def end(self) -> None:
        """End it: what is being meshed is finished, unless that takes too long."""
        session_processes.wake_stopped(self._process.pid)
        self._process.terminate()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(ENDING)
        self._kill()

    def _next(self) -> None:
        try:
            told = self._connection.recv()
        except (EOFError, OSError):
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(1.0)
            self._kill()
            code = self._process.returncode
            if code == FAILED:
                # It has said why.
                raise SystemExit(FAILED) from None
            raise ServiceEnded(f"the service's process was killed ({code}): start it again") from None
        if isinstance(told, Exception):
            raise told

    def _kill(self) -> None:
        self._process.kill()
        self._process.wait()
        session_processes.end(self._process.pid)
        self._connection.close()


@contextmanager
def running_service(
    policies: Mapping[str, Policy],
    limits: Limits,
    *,
    host: str = "127.0.0.1",
    port: int = 8000,
    replicas: int = 1,
    token: bytes | None = None,
    hosts: Sequence[str] = (),
) -> Iterator[Service]:
    """A service that answers while the block runs, on a Ray of its own or on the one that RAY_ADDRESS names.

    Args:
        policies: by density.
        limits: of a request.
        host, port: to listen on.
        replicas: meshers.
        token: digest of the bearer token that is asked for, or None.
        hosts: names that the server goes by beside ``host`` and those of this machine.

    Raises:
        UserError: the port is taken, or the meshers do not start.
    """
    check_free(host, port)
    service = Service(Order(dict(policies), limits, host, port, replicas, token, tuple(hosts)))
    try:
        yield service
    finally:
        service.end()
