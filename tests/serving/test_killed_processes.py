"""Every process of a service is killed and stopped: it serves again soon, or ends with one line; nothing is left."""

from __future__ import annotations

import http.client
import os
import re
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from intrusion import got_by_another_account
from listening import named
from processes import Server, free_port
from worker_processes import forking, workers

from freemesh_ray.local_ray.processes import STOPPED, of_session, process
from freemesh_ray.serving import session_processes
from freemesh_ray.serving.http_process import WITHOUT
from freemesh_ray.serving.service import SILENT

pytestmark = pytest.mark.slow

#: Seconds until it serves again, until it has ended, and for how long /health may say that it can mesh when it cannot.
AGAIN, ENDED, WRONG = 15.0, 10.0, 2.0

#: For how long all processes stand still together.
ASLEEP = WITHOUT + 5.0

#: By how much all of these are too short for two cores on which other tests run.
PATIENCE = float(os.environ.get("FREEMESH_PATIENCE", "2"))

SHEET = b'{"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]]}'


def command(service: Server) -> int:
    return service.pid


def server(service: Server) -> int:
    return named(service.pid, "serving.http_process")[0]


def first(part: str) -> Callable[[Server], int]:
    return lambda service: named(service.pid, part)[0]


#: Those that are killed and never missed.
SPARED = ("autoscaler", "dashboard", "log monitor")

#: Whether to kill Ray's agents, too, which takes a service for each.
EVERY = bool(os.environ.get("FREEMESH_EVERY_PROCESS"))

#: How each process is found.
PROCESSES: dict[str, Callable[[Server], int]] = {
    "command": command,
    "server": server,
    "GCS": first("gcs_server"),
    "raylet": first("raylet/raylet"),
    "autoscaler": first("autoscaler/_private/monitor"),
    "dashboard": first("dashboard/dashboard"),
    "log monitor": first("log_monitor"),
    "dashboard agent": first("ray::DashboardAgent"),
    "environment agent": first("ray::RuntimeEnvAgent"),
    "guard": first("local_ray.guard"),
    "mesher": first("ray::Mesher"),
    "forking process": lambda service: forking(service.pid)[0],
    "worker": lambda service: workers(service.pid)[0],
}

#: Those without which the service ends when they are killed; without its agents Ray ends its raylet.
VITAL = ("command", "server", "GCS", "raylet", "dashboard agent", "environment agent")


@contextmanager
def started(folder: Path) -> Iterator[Server]:
    """A service that has said where it is."""
    port = free_port()
    with Server(["-m", "freemesh_ray", "serve", "--port", str(port)], port, "/health", folder / "log") as one:
        session = server(one)
        try:
            until(lambda: bool(one.log.read_text()), 10.0)
            yield one
        finally:
            print(one.log.read_text())
            session_processes.end(session)


def asked(service: Server, method: str, path: str, body: bytes | None, seconds: float) -> int:
    """The status of an answer; 0 without one."""
    connection = http.client.HTTPConnection("127.0.0.1", int(service.url.rpartition(":")[2]), timeout=seconds)
    try:
        connection.request(method, path, body)
        answer = connection.getresponse()
        answer.read()
        return answer.status
    except (OSError, http.client.HTTPException):
        return 0
    finally:
        connection.close()


def meshes(service: Server, seconds: float = 2.0) -> bool:
    return asked(service, "POST", "/mesh?edge_length=1", SHEET, seconds) == 200


class Probe(threading.Thread):
    """Asks for the health, and at once for a mesh, again and again; knows for how long they disagreed."""

    def __init__(self, service: Server) -> None:
        super().__init__(daemon=True)
        self.wrong, self.served = 0.0, 0.0
        self._service, self._enough = service, threading.Event()

    def run(self) -> None:
        since = None
        while not self._enough.wait(0.05):
            began = time.monotonic()
            healthy = asked(self._service, "GET", "/health", None, 1.0) == 200
            if meshes(self._service, 0.5 * PATIENCE):
                self.served = time.monotonic()
                since = None
            elif not healthy:
                since = None
            else:
                since = began if since is None else since
                self.wrong = max(self.wrong, began - since)

    def __enter__(self) -> Probe:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._enough.set()
        self.join(30.0)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """One service for all that it survives; in the end it obeys SIGTERM though all but the command is stopped."""
    with started(tmp_path_factory.mktemp("survives")) as one:
        yield one
        terminated(one, [name for name in PROCESSES if name not in ("command", *SPARED)])


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another account")
def test_another_account_gets_nothing_of_it(service: Server) -> None:
    processes = {service.pid} | {one.number for one in of_session(server(service))}
    raylet = Path(f"/proc/{first('raylet/raylet')(service)}/cmdline").read_text().split("\0")
    (sockets,) = {
        Path(word.partition("=")[2]).parents[3] for word in raylet if word.startswith("--raylet_socket_name=")
    }
    told = got_by_another_account(
        processes, sockets, spared={service.log}, open_ports={int(service.url.rpartition(":")[2])}
    )
    assert "\n".join(told["got"]) == ""
    assert told["refused"] > 100


@pytest.mark.parametrize(
    ("name", "number"),
    [(name, signal.SIGSTOP) for name in PROCESSES]
    + [(name, signal.SIGKILL) for name in PROCESSES if name not in VITAL],
    ids=str,
)
def test_it_serves_again(service: Server, name: str, number: signal.Signals) -> None:
    assert meshes(service, 30.0)
    victim, before = PROCESSES[name](service), files(service)
    with Probe(service) as probe:
        began = time.monotonic()
        os.kill(victim, number)
        until_it_works(victim)
        until(lambda: is_dealt_with(victim, number), AGAIN * PATIENCE)
        dealt = time.monotonic()
        until(lambda: probe.served > dealt, AGAIN * PATIENCE - (dealt - began))
        until(lambda: asked(service, "GET", "/health", None, 1.0) == 200, AGAIN * PATIENCE - (time.monotonic() - began))
        took = time.monotonic() - began
    print(f"{name}, {number.name}: served again after {took:.1f} s, health wrong for {probe.wrong:.1f} s")
    assert probe.wrong <= WRONG * PATIENCE
    until(lambda: len(files(service)) <= len(before), AGAIN * PATIENCE)


def files(service: Server) -> set[Path]:
    """What lies in the service's folder, but for logs, which stay, and a mesh that is being written."""
    root = folder_of_ray(service)
    return {path for path in root.rglob("*") if "logs" not in path.parts and not path.name.startswith("tmp")}


def test_it_serves_again_after_a_sleep(service: Server) -> None:
    """All of its processes stand still, those that watch the others first, for longer than any of them is patient."""
    answers: list[int] = []
    path = "/mesh?edge_length=0.02&seed=1"  # 30,000 elements: it is amid them
    costly = threading.Thread(target=lambda: answers.append(asked(service, "POST", path, SHEET, 300.0)))
    costly.start()
    time.sleep(0.5)
    watching = [PROCESSES[name](service) for name in ("guard", "command", "server")]
    everyone = {service.pid, *(one.number for one in of_session(server(service)))}
    for victim in [*watching, *everyone.difference(watching)]:
        os.kill(victim, signal.SIGSTOP)
    until(lambda: all(is_stopped(one) for one in everyone), 10.0)
    time.sleep(ASLEEP)
    assert all(is_stopped(one) for one in everyone)
    began = time.monotonic()
    for victim in everyone:
        with suppress(ProcessLookupError):  # a worker that its parent, awake before it, found stopped
            os.kill(victim, signal.SIGCONT)
    until(lambda: meshes(service), AGAIN * PATIENCE)
    print(f"all of them, SIGSTOP for {ASLEEP:g} s: served again after {time.monotonic() - began:.1f} s")
    costly.join(120.0)
    assert answers == [200]
    time.sleep(SILENT)  # nobody ends it for what was before
    assert meshes(service, 30.0)
    assert service.log.read_text().count("\n") == 1, service.log.read_text()


def is_stopped(number: int) -> bool:
    found = process(number)
    return found is None or found.state == STOPPED


def until_it_works(victim: int) -> None:
    """Wait a moment until a signal has stopped a process, or has ended it."""
    deadline = time.monotonic() + 0.2
    while (found := process(victim)) is not None and found.state != STOPPED and time.monotonic() < deadline:
        time.sleep(0.001)


def is_dealt_with(victim: int, number: int) -> bool:
    found = process(victim)
    return found is None or (number == signal.SIGSTOP and found.state != STOPPED)


@pytest.mark.parametrize("name", VITAL if EVERY else VITAL[:4])
def test_it_ends_with_a_line(name: str, tmp_path: Path) -> None:
    with started(tmp_path) as one:
        session, port, folder = server(one), int(one.url.rpartition(":")[2]), folder_of_ray(one)
        assert meshes(one, 30.0)
        victim = PROCESSES[name](one)
        with Probe(one) as probe:
            began = time.monotonic()
            os.kill(victim, signal.SIGKILL)
            code = one.wait(ENDED * PATIENCE)
            until(lambda: not of_session(session), ENDED * PATIENCE)
            took = time.monotonic() - began
        print(f"{name}, SIGKILL: ended after {took:.1f} s, health wrong for {probe.wrong:.1f} s")
        assert code != 0
        assert probe.wrong <= WRONG * PATIENCE
        _, *lines = one.log.read_text().splitlines()
        assert len(lines) == 1, lines
        assert lines[0].startswith("freemesh: ")
        assert not folder.exists()
        with socket.create_server(("127.0.0.1", port)):
            pass


def test_sigterm_is_obeyed_by_a_stopped_command(tmp_path: Path) -> None:
    with started(tmp_path) as one:
        terminated(one, ["command"])


def terminated(one: Server, stopped: list[str]) -> None:
    """Stop processes, end the service, and see that it is over."""
    session, folder = server(one), folder_of_ray(one)
    for victim in [PROCESSES[name](one) for name in stopped]:
        os.kill(victim, signal.SIGSTOP)
    began = time.monotonic()
    assert one.stop(ENDED * PATIENCE) == 0, one.log.read_text()
    print(f"stopped: {', '.join(stopped)}; SIGTERM obeyed after {time.monotonic() - began:.1f} s")
    assert of_session(session) == []
    assert not folder.exists()
    assert one.log.read_text().count("\n") == 1


def folder_of_ray(one: Server) -> Path:
    """The folder that the GCS names."""
    found = re.search(r"=(/[^\0]*/ray-[^/\0]+)/r/", Path(f"/proc/{PROCESSES['GCS'](one)}/cmdline").read_text())
    assert found is not None
    return Path(found[1])


def until(true: Callable[[], bool], seconds: float) -> None:
    """Wait for something that has to come."""
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.05)
