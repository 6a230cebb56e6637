"""Clients that attack: a load that would block a server of one queue, and requests with anything in them."""

from __future__ import annotations

import argparse
import importlib.util
import os
import random
import re
import socket
import sys
import urllib.request
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from types import ModuleType

import pytest
from checkout import ROOT
from processes import Server, free_port

pytestmark = pytest.mark.slow

#: Requests of the test with anything in them; docs/security.md has the figures of a longer one.
REQUESTS = int(os.environ.get("FREEMESH_FUZZ", "1500"))

#: Clients of it at a time.
THREADS = 8

BODIES = [
    b'{"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]]}',
    b'{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", '
    b'"coordinates": [[[0, 0], [4, 0], [4, 3], [0, 3]], [[1, 1], [1, 2], [2, 2], [2, 1]]]}}]}',
]
PATHS = [
    b"/mesh", b"/mesh?edge_length=1", b"/mesh?edge_length=0.5&grading=3&seed=7", b"/mesh?fix_parity=true&format=inp",
    b"/", b"/health", b"/metrics", b"/-/healthz", b"/-/routes", b"/mesh/../metrics", b"*", b"http://localhost/mesh",
]  # fmt: skip
HEADERS = [
    b"X-Request-ID: \xff", b"X-Request-Timeout-Seconds: garbage", b"X-Request-Timeout-Seconds: -1", b"Origin: null",
    b"Host: evil.example", b"Origin: http://localhost", b"Content-Type: \x80", b"Authorization: Bearer \xff\xfe",
    b"Content-Length: 5", b"Content-Length: -1", b"Content-Length: 99999999999999999999", b"Content-Length: \xb2",
    b"Transfer-Encoding: chunked", b"Transfer-Encoding: gzip, chunked", b"Expect: 100-continue", b"Expect: more",
    b"Upgrade: websocket", b"Connection: Upgrade", b"Connection: close", b"Accept-Encoding: \x00", b"Range: bytes=9-1",
    b"Cookie: a=\xc3\x28; ;;=", b"X-Forwarded-For: ::::, \x7f", b"Forwarded: host=evil", b": empty", b"no colon",
    b"serve_multiplexed_model_id: \xff", b"traceparent: 00-\xff", b"Sec-WebSocket-Key: x", b" folded: yes",
]  # fmt: skip
#: Headers that mean something to other servers.
FOREIGN = [line for line in HEADERS if line.startswith((b"X-", b"serve", b"trace", b"Cookie"))]
SPLINTERS = [
    b"\x00", b"\xff", b"\r\n", b"\n", b"\r", b" ", b"\t", b"%", b"%00", b"%ff", b"%zz", b"&", b"=", b"?", b"#", b"[",
    b"]", b"{", b"}", b'"', b",", b"-", b":", b"1e999", b"NaN", b"9" * 400, b"[" * 400, b"\xe2\x82\xac", b"HTTP/1.1",
    b"HTTP/0.9", b"0", b"GET ", b"POST ", b"nan", b"inf", b"null", b"edge_length", b"seed", b"x" * 5000,
]  # fmt: skip


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A service of two replicas, without a token."""
    folder, port = tmp_path_factory.mktemp("hostile"), free_port()
    arguments = ["-m", "freemesh_ray", "serve", "--port", str(port), "--replicas", "2"]
    with Server(arguments, port, "/health", folder / "log") as one:
        yield one
        assert one.stop(60) == 0
        assert one.log.read_text().count("\n") == 1, one.log.read_text()


def port_of(server: Server) -> int:
    return int(server.url.rpartition(":")[2])


def script() -> ModuleType:
    """docs/benchmarks/hostile_load.py."""
    folder = ROOT / "docs" / "benchmarks"
    sys.path.insert(0, str(folder))
    try:
        spec = importlib.util.spec_from_file_location("hostile_load", folder / "hostile_load.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module
    finally:
        sys.path.remove(str(folder))


def test_an_attack_keeps_no_other_client_out(server: Server) -> None:
    # The costliest meshes take half a minute: whoever waits for one takes longer than this.
    options = argparse.Namespace(idle=700, costly=8, seconds=5.0, slowest=10.0)
    assert script().compare(port_of(server), options)


def mutated(text: bytes, draw: random.Random, most: int) -> bytes:
    """A text with a few places changed."""
    changed = bytearray(text)
    for _ in range(draw.randint(0, most)):
        at = draw.randint(0, len(changed))
        changed[at : at + draw.choice((0, 0, 1, 4, 20))] = draw.choice(SPLINTERS)
    return bytes(changed)


def request(draw: random.Random) -> bytes:
    """A request with anything in it; most have a mistake or two, some none."""
    often, seldom = draw.random() < 0.3, draw.random() < 0.3
    body = mutated(draw.choice(BODIES), draw, draw.choice((0, 1, 3)))
    method = draw.choice((b"GET", b"HEAD", b"OPTIONS", b"CONNECT", b"PUT", b"FOO", b"\xff")) if seldom else b"POST"
    path = mutated(draw.choice(PATHS[:4]) if often else draw.choice(PATHS), draw, draw.choice((0, 0, 0, 2)))
    lines = [b"Host: localhost", b"Connection: close", b"Content-Length: %d" % len(body)]
    if seldom:
        lines = draw.sample(lines * 2, draw.randint(0, 4))
    lines += draw.sample(HEADERS, draw.choice((0, 0, 1, 3)))
    draw.shuffle(lines)
    version = draw.choice((b"HTTP/1.0", b"HTTP/2.0", b"")) if draw.random() < 0.1 else b"HTTP/1.1"
    head = b"\r\n".join((b" ".join((method, path, version)), *lines, b"", b""))
    return mutated(head, draw, draw.choice((0, 0, 0, 2))) + body


def statuses(server: Server, sent: bytes, seconds: float = 30.0) -> list[bytes]:
    """The statuses that come until the connection is closed, or is silent for so long."""
    answer = b""
    with socket.create_connection(("127.0.0.1", port_of(server)), timeout=30) as connection, suppress(OSError):
        connection.sendall(sent)
        connection.settimeout(seconds)
        while received := connection.recv(1 << 20):
            answer += received
    return [line[9:12] for line in answer.split(b"\r\n") if line.startswith((b"HTTP/1.1 ", b"HTTP/1.0 "))]


def counted(server: Server) -> Counter[str]:
    """How many answers the server has given, by status."""
    with urllib.request.urlopen(f"{server.url}/metrics", timeout=30) as answer:
        page = answer.read().decode()
    found: Counter[str] = Counter()
    for path, status, count in re.findall(r'freemesh_requests_total{path="(.*)",status="(.*)"} (.*)', page):
        assert path in ("/", "/mesh", "/health", "/metrics", "other")
        found[status] += int(float(count))
    return found


def test_no_request_makes_the_server_fail(server: Server) -> None:
    def ask(seed: int) -> list[bytes]:
        return statuses(server, request(random.Random(seed)), 0.5)

    before = counted(server)
    seen: Counter[bytes] = Counter()
    with ThreadPoolExecutor(THREADS) as threads:
        for seed, found in enumerate(threads.map(ask, range(REQUESTS))):
            assert not {b"500", b"408", b"503", b"504"} & set(found), request(random.Random(seed))
            seen.update(found)
    answered = counted(server) - before
    print(f"{REQUESTS} requests: {dict(seen.most_common())}; by the server's own count {dict(answered)}")
    # Those whose clients did not wait are counted by the server alone.
    assert answered.keys() <= {"200", "400", "403", "404", "405", "413", "422", "499"}
    assert {b"200", b"400", b"403", b"404", b"405", b"422"} <= seen.keys()
    assert statuses(server, valid()) == [b"200"]


def valid(*headers: bytes) -> bytes:
    """A request for a mesh."""
    lines = [b"POST /mesh HTTP/1.1", b"Host: localhost", b"Connection: close", b"Content-Length: %d" % len(BODIES[0])]
    return b"\r\n".join((*lines, *headers, b"", BODIES[0]))


@pytest.mark.parametrize("header", FOREIGN)
def test_headers_of_others_are_ignored_or_refused(server: Server, header: bytes) -> None:
    assert statuses(server, valid(header)) in ([b"200"], [b"400"])


def test_a_web_page_cannot_use_it(server: Server) -> None:
    """As a page does whose name leads here, and one that posts without asking."""
    assert statuses(server, valid().replace(b"localhost", b"evil.example:%d" % port_of(server))) == [b"403"]
    for origin in (b"https://evil.example", b"http://127.0.0.1:%d" % (port_of(server) + 1), b"http://127.0.0.1"):
        assert statuses(server, valid(b"Origin: " + origin)) == [b"403"]
