"""Load on a service: how many meshes a second it makes, how long clients wait, and what they notice of a kill."""

from __future__ import annotations

import http.client
import json
import os
import signal
import socket
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from urllib.parse import urlencode

import numpy as np

from envs.domains.load import load
from envs.types import Domain
from freemesh_ray.formatting.table import number, table
from freemesh_ray.formatting.terminal import say
from freemesh_ray.local_ray.processes import children, command_line
from freemesh_ray.policies.policy import Policy
from freemesh_ray.serving.limits import Limits
from freemesh_ray.serving.service import running_service

#: What is meshed, by how many clients at a time, with how many replicas.
DOMAINS, CLIENTS, REPLICAS = ("D4", "part-3"), (1, 4, 16), (1, 2)

#: Clients and replicas while one replica is killed.
KILLED_CLIENTS, KILLED_REPLICAS = 4, 2

#: How Ray calls the processes of the meshers; what they are doing follows.
MESHER = "ray::Mesher"

#: Seconds that a killed replica may be away for before the measurement is given up.
PATIENCE = 300.0


@dataclass(frozen=True)
class Reply:
    """An answer as its client saw it.

    Attributes:
        status: of HTTP; 0 when the connection broke.
        seconds: it took.
    """

    status: int
    seconds: float


class Client(threading.Thread):
    """Posts one polygon again and again, over one connection, until told to stop."""

    def __init__(self, port: int, body: bytes, stop: threading.Event) -> None:
        super().__init__(daemon=True)
        self.replies: list[Reply] = []
        self._port, self._body, self._stop_now = port, body, stop

    def run(self) -> None:
        connection = http.client.HTTPConnection("127.0.0.1", self._port, timeout=120)
        while not self._stop_now.is_set():
            began = time.perf_counter()
            try:
                connection.request("POST", f"/mesh?{urlencode({'seed': 0})}", self._body)
                answer = connection.getresponse()
                answer.read()
                status = answer.status
            except (OSError, http.client.HTTPException):
                connection.close()
                status = 0
            self.replies.append(Reply(status, time.perf_counter() - began))


@contextmanager
def clients(port: int, body: bytes, count: int) -> Iterator[Sequence[Client]]:
    """So many clients at work; when the block ends they have had their last answers."""
    stop = threading.Event()
    working = [Client(port, body, stop) for _ in range(count)]
    for client in working:
        client.start()
    try:
        yield working
    finally:
        stop.set()
        for client in working:
            client.join()


def geojson(domain: Domain) -> bytes:
    """A domain without holes as its polygon's text."""
    ring = domain.points[domain.ring].tolist()
    return json.dumps({"type": "Polygon", "coordinates": [[*ring, ring[0]]]}).encode()


def run(policy: Policy, seconds: float) -> None:
    """Print the tables.

    Args:
        policy: by which is meshed.
        seconds: of each measurement.
    """
    rows, killed = [], ""
    for replicas in REPLICAS:
        port = free_port()
        with running_service({"given": policy}, Limits(), port=port, replicas=replicas):
            for name in DOMAINS:
                body = geojson(load(name))
                rows += [measured(port, body, name, replicas, count, seconds) for count in CLIENTS]
            if replicas == KILLED_REPLICAS:
                killed = after_a_kill(port, geojson(load(DOMAINS[0])))
    say(f"serving on loopback, {seconds:g} s each; clients, service and meshers share {os.cpu_count()} cores")
    header = ["polygon", "replicas", "clients", "meshes/s", "p50, ms", "p95, ms", "p99, ms", "errors"]
    say(table(header, rows))
    say(killed)


def measured(port: int, body: bytes, name: str, replicas: int, count: int, seconds: float) -> list[str]:
    """A row of the table."""
    with clients(port, body, count):  # a warm-up: every replica has seen the polygon
        time.sleep(min(1.0, seconds))
    began = time.perf_counter()
    with clients(port, body, count) as working:
        time.sleep(seconds)
    took = time.perf_counter() - began
    replies = [reply for client in working for reply in client.replies]
    times = [1000.0 * reply.seconds for reply in replies if reply.status == http.HTTPStatus.OK]
    shares = np.percentile(times, [50, 95, 99]) if times else np.full(3, np.nan)
    return [
        name, str(replicas), str(count), f"{len(times) / took:.1f}", *(number(share, ".0f") for share in shares),
        str(len(replies) - len(times)),
    ]  # fmt: skip


def after_a_kill(port: int, body: bytes) -> str:
    """What clients notice of a replica that is killed, and how long it is away for."""
    before = counter(port, "freemesh_retries_total")
    with clients(port, body, KILLED_CLIENTS) as working:
        time.sleep(1.0)
        victim, *others = meshers()
        os.kill(victim, signal.SIGKILL)
        began = time.perf_counter()
        while set(meshers()) <= {victim, *others} or running(port) < KILLED_REPLICAS:
            if time.perf_counter() - began > PATIENCE:
                return f"a replica was killed and is not back after {PATIENCE:g} s"
            time.sleep(0.1)
        away = time.perf_counter() - began
        time.sleep(1.0)
    replies = [reply for client in working for reply in client.replies]
    statuses = Counter(reply.status for reply in replies)
    failed = len(replies) - statuses[http.HTTPStatus.OK]
    retried = counter(port, "freemesh_retries_total") - before
    return (
        f"one of {KILLED_REPLICAS} replicas killed under {KILLED_CLIENTS} clients: of {len(replies)} requests {failed} "
        f"failed, {retried:.0f} were meshed again by the other one; the slowest took "
        f"{max(reply.seconds for reply in replies):.1f} s; all replicas were back after {away:.1f} s"
    )


def meshers() -> list[int]:
    """The processes of the meshers on this machine that descend from this process."""
    found, new = [], [os.getpid()]
    while new:
        new = [child.number for parent in new for child in children(parent)]
        found += new
    return [number for number in found if command_line(number).startswith(MESHER)]


def running(port: int) -> int:
    """The meshers that can take a request."""
    return json.loads(page(port, "/health"))["meshers"]


def counter(port: int, name: str) -> float:
    """The value of a counter without labels."""
    lines = page(port, "/metrics").decode().splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith(f"{name} "))


def page(port: int, path: str) -> bytes:
    """What a path answers."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    try:
        connection.request("GET", path)
        return connection.getresponse().read()
    finally:
        connection.close()


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return probe.getsockname()[1]
