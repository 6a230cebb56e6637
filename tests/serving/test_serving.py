"""The service as clients meet it: a real one on the loopback device, with a token and small limits."""

from __future__ import annotations

import http.client
import json
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from listening import family, listeners, named
from processes import Server, free_port
from prometheus_client.parser import text_string_to_metric_families
from worker_processes import forking, workers

import freemesh_ray
from envs.mesh import Mesh
from freemesh_ray import export
from freemesh_ray.serving.formats import JSON, MEDIA_TYPES
from freemesh_ray.serving.limits import Limits

pytestmark = pytest.mark.slow

TOKEN = "a secret"
BODY_BYTES, VERTICES, SECONDS, REPLICAS = 100_000, 2_000, 8.0, 2
ELEMENTS = 240_000
#: What the load asks for: some 4,000 elements, 0.1 s on a quiet core, a quick request.
HEAVY = {"edge_length": 0.055, "effort": "quick"}
#: More work than fits into the time limit: eight meshes of a quarter million elements.
ENDLESS = {"edge_length": 0.0072, "best_of": 8}
SHEET = {"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]]}
PLATE = {
    "type": "Polygon",
    "coordinates": [*SHEET["coordinates"], [[1.5, 1], [1.5, 2], [2.5, 2], [2.5, 1], [1.5, 1]]],
}
FEATURE = {"type": "Feature", "properties": {"layer": 1}, "geometry": PLATE}
COLLECTION = {"type": "FeatureCollection", "features": [FEATURE]}


class Client:
    """A client of the service."""

    def __init__(self, server: Server) -> None:
        self.server, self.port = server, int(server.url.rpartition(":")[2])

    def ask(
        self, method: str, path: str, body: Any = None, headers: dict[str, str] | None = None
    ) -> tuple[int, bytes, http.client.HTTPMessage]:
        """Status, body and headers of the answer."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=120)
        try:
            connection.request(method, path, body, {"Authorization": f"Bearer {TOKEN}"} if headers is None else headers)
            answer = connection.getresponse()
            return answer.status, answer.read(), answer.headers
        finally:
            connection.close()

    def mesh(self, polygon: Any, **query: Any) -> tuple[int, bytes, http.client.HTTPMessage]:
        """The answer to a polygon, an object or a text."""
        body = polygon if isinstance(polygon, bytes) else json.dumps(polygon).encode()
        return self.ask("POST", f"/mesh?{urlencode(query)}", body)

    def refused(self, polygon: Any, **query: Any) -> tuple[int, str]:
        """Status and line of a refusal."""
        status, body, headers = self.mesh(polygon, **query)
        assert headers["Content-Type"] == "application/json"
        return status, line_of(body)

    def raw(self, text: bytes) -> tuple[int, bytes]:
        """Status and body that answer bytes as they are, from a client that then waits."""
        with socket.create_connection(("127.0.0.1", self.port), timeout=60) as connection:
            connection.sendall(text)
            answer = http.client.HTTPResponse(connection)
            answer.begin()
            return answer.status, answer.read()

    def meshers(self) -> int:
        """How many are running."""
        return json.loads(self.ask("GET", "/health")[1])["meshers"]

    def counts(self) -> dict[str, float]:
        """The counters by name and label values."""
        status, page, _ = self.ask("GET", "/metrics")
        assert status == 200
        families = text_string_to_metric_families(page.decode())
        return {" ".join([one.name, *one.labels.values()]): one.value for each in families for one in each.samples}


def line_of(body: bytes) -> str:
    """The line of a refusal, which is all there is."""
    assert body.count(b"\n") == 1
    assert b"Traceback" not in body
    ((key, line),) = json.loads(body).items()
    assert key == "error"
    assert line
    assert "\n" not in line
    return line


def until(true: Callable[[], bool], seconds: float = 120) -> None:
    """Wait for something that has to come."""
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.1)


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    """One service for all; it has to stop cleanly in the end."""
    folder, port = tmp_path_factory.mktemp("serving"), free_port()
    arguments = ["-m", "freemesh_ray", "serve", "--port", str(port), "--replicas", str(REPLICAS)]
    limits = ["--max-body-mb", str(BODY_BYTES / 1e6), "--max-vertices", str(VERTICES), "--max-seconds", str(SECONDS)]
    limits += ["--max-elements", str(ELEMENTS)]
    server = Server([*arguments, *limits], port, "/health", folder / "log", FREEMESH_SERVE_TOKEN=TOKEN)
    with server:
        client = Client(server)
        until(lambda: client.meshers() == REPLICAS and bool(server.log.read_text()))
        yield client
        processes = family(server.pid)
        assert server.stop() == 0, server.log.read_text()
        until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in processes))
        printed = server.log.read_text()
        assert printed.startswith(f"{server.url}  curl -H "), printed
        assert "Traceback" not in printed
        assert "shutdown" not in printed


@pytest.mark.parametrize(
    ("polygon", "query", "options"),
    [
        (SHEET, {"edge_length": 0.5}, {}),
        (PLATE, {"edge_length": 0.25, "grading": 3, "seed": 7}, {}),
        (FEATURE, {"edge_length": 0.3, "best_of": 3, "density": "dense"}, {}),
        (COLLECTION, {"edge_length": 0.4, "smooth": "false"}, {"smooth": False}),
        (SHEET, {"edge_length": 0.2, "density": "sparse", "clean": "false"}, {"clean": False}),
        (PLATE, {"edge_length": 0.2, "effort": "thorough"}, {}),
        ({**SHEET, "coordinates": [SHEET["coordinates"][0][1:]]}, {"fix_parity": "true"}, {"fix_parity": True}),
    ],
)  # fmt: skip
def test_the_answer_is_the_mesh_that_python_makes(client: Client, polygon: Any, query: Any, options: Any) -> None:
    status, body, headers = client.mesh(polygon, **query)
    assert status == 200, body
    assert headers["Content-Type"] == "application/json"
    answer = json.loads(body)
    own = freemesh_ray.mesh(polygon, **(query | options))
    vertices, quads = np.array(answer["vertices"]), np.array(answer["quads"])
    np.testing.assert_array_equal(vertices, own.vertices)
    np.testing.assert_array_equal(quads, own.quads)
    assert Mesh("answer", vertices, quads, own.segments, True).defects() == []
    assert answer["quality"] == own.quality()
    assert 0.0 < answer["seconds"] < SECONDS


@pytest.mark.parametrize("suffix", [f".{name}" for name in MEDIA_TYPES if name != JSON])
def test_files_are_those_that_the_package_writes(client: Client, suffix: str, tmp_path: Path) -> None:
    status, body, headers = client.mesh(PLATE, edge_length=0.25, format=suffix[1:])
    assert status == 200, body
    assert headers["Content-Type"] == MEDIA_TYPES[suffix[1:]]
    assert headers["Content-Disposition"] == f'attachment; filename="polygon{suffix}"'
    path = tmp_path / f"polygon{suffix}"  # an archive holds its name
    export.write(freemesh_ray.mesh(PLATE, edge_length=0.25), path)
    assert body == path.read_bytes()


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ({"edge_lenght": 1}, "did you mean edge_length"),
        ({"x" * 5000: 1}, "not known"),
        ({"edge_length": 0}, "a number from 1e-300"),
        ({"edge_length": "1_0"}, "a number from 1e-300"),
        ({"edge_length": "\uff11"}, "a number from 1e-300"),
        ({"edge_length": "nan"}, "a number from 1e-300"),
        ({"edge_length": "wide" * 1000}, "a number from 1e-300"),
        ({"edge_length": 1, "grading": 0.5}, "from 1 to 1000"),
        ({"grading": 2}, "edge_length"),
        ({"seed": -1}, "a whole number from 0"),
        ({"best_of": 9}, "from 1 to 8"),
        ({"best_of": "9" * 5000}, "from 1 to 8"),
        ({"smooth": "maybe"}, "one of true, false"),
        ({"effort": "much"}, "one of quick, usual, thorough"),
        ({"density": "thick"}, "dense, even, medium, sparse"),
        ({"format": "stl"}, ", ".join(MEDIA_TYPES)),
    ],
)
def test_parameters_that_are_not_understood(client: Client, query: Any, words: str) -> None:
    status, line = client.refused(SHEET, **query)
    assert status == 400
    assert words in line
    assert len(line) < 300


def test_a_parameter_given_twice(client: Client) -> None:
    status, body, _ = client.ask("POST", "/mesh?seed=1&seed=2", json.dumps(SHEET))
    assert status == 400
    assert "seed: given twice" in line_of(body)


@pytest.mark.parametrize(
    ("body", "status", "words"),
    [
        (b"", 400, "not JSON"),
        (b"\xff\xfe\xfa", 400, "not JSON"),
        (b"[" * 50_000, 400, "nested too deep"),
        (b'{"a":' * 15_000, 400, "nested too deep"),
        (b"[[0, 0], [1, 0], [1, 1], [0, 1]]", 400, "no object"),
        (json.dumps(SHEET).replace("4", "NaN").encode(), 400, "NaN is no number"),
        (json.dumps(SHEET).replace("4", "9" * 10_000).encode(), 422, "not finite"),
        (json.dumps(SHEET).replace("4", "1e308").encode(), 422, "too large"),
        (json.dumps(SHEET).replace("4", '"4"').encode(), 422, "pairs of numbers"),
        (b'{"type": "Point", "coordinates": [0, 0]}', 422, "give a Polygon"),
        (json.dumps({"type": "x" * 50_000}).encode(), 422, "a Polygon is needed"),
        (json.dumps({"type": "FeatureCollection", "features": [FEATURE, FEATURE]}).encode(), 422, "2 polygons"),
        (b'{"type": "FeatureCollection", "features": []}', 422, "0 polygons"),
        (json.dumps(SHEET).replace("[4, 3], [0, 3]", "[0, 3], [4, 3]").encode(), 422, "crosses itself"),
        (json.dumps(SHEET).replace("[4, 3], [0, 3]", "[4, 3]").encode(), 422, "at least 4"),
        (json.dumps(SHEET).replace("[0, 3]", "[0, 3], [0, 2]").encode(), 422, "use fix_parity=true"),
    ],
)
def test_bodies_that_cannot_be_meshed(client: Client, body: bytes, status: int, words: str) -> None:
    found, line = client.refused(body)
    assert (found, words in line) == (status, True), line
    assert len(line) < 450


@pytest.mark.parametrize(
    ("method", "path", "status", "words"),
    [
        ("GET", "/mesh", 405, "use POST"),
        ("DELETE", "/health", 405, "use GET, HEAD"),
        ("POST", "/meshes", 404, "/mesh"),
        ("GET", "/mesh/", 404, "/mesh"),
        ("GET", "/%2e%2e/etc/passwd", 404, "/mesh"),
    ],
)
def test_other_methods_and_paths(client: Client, method: str, path: str, status: int, words: str) -> None:
    found, body, _ = client.ask(method, path)
    assert found == status
    assert words in line_of(body)


def test_the_service_describes_itself(client: Client) -> None:
    status, body, _ = client.ask("GET", "/")
    assert status == 200
    told = json.loads(body)
    assert told["limits"]["vertices"] == VERTICES
    assert "edge_length" in told["parameters"]


@pytest.mark.parametrize(
    "headers", [{}, {"Authorization": "Bearer another"}, {"Authorization": f"Basic {TOKEN}"}, {"Authorization": "é"}]
)
def test_without_the_token(client: Client, headers: dict[str, str]) -> None:
    for method, path in (("POST", "/mesh"), ("GET", "/metrics"), ("GET", "/nowhere")):
        status, body, answered = client.ask(method, path, headers=headers)
        assert status == 401
        assert answered["WWW-Authenticate"] == "Bearer"
        assert "Authorization: Bearer" in line_of(body)
    assert client.ask("GET", "/health", headers=headers)[0] == 200


def request_lines(*headers: str) -> bytes:
    """The head of a request for a mesh."""
    lines = ["POST /mesh HTTP/1.1", "Host: localhost", f"Authorization: Bearer {TOKEN}", *headers, "", ""]
    return "\r\n".join(lines).encode()


def test_a_body_too_large_is_refused_before_it_is_sent(client: Client) -> None:
    status, body = client.raw(request_lines(f"Content-Length: {10**12}"))
    assert status == 413
    assert "0.1 MB" in line_of(body)


def test_a_body_without_an_end_is_refused(client: Client) -> None:
    chunk = b"8000\r\n" + b" " * 0x8000 + b"\r\n"
    status, body = client.raw(request_lines("Transfer-Encoding: chunked") + chunk * 4)
    assert status == 413
    assert "0.1 MB" in line_of(body)


@pytest.mark.parametrize(
    "head",
    [
        request_lines("Content-Length: 5", "Content-Length: 6"),
        request_lines("Content-Length: -1"),
        request_lines("Content-Length: 5", "Transfer-Encoding: chunked"),
        request_lines("X-Long: " + "x" * 100_000),
        b"NONSENSE\r\n\r\n",
    ],
)
def test_requests_that_are_no_http(client: Client, head: bytes) -> None:
    try:
        status, body = client.raw(head + b"hello")
    except (http.client.HTTPException, ConnectionError):
        return  # cut off
    assert 400 <= status < 500
    assert b"Traceback" not in body
    assert client.ask("GET", "/health")[0] == 200


@pytest.mark.parametrize("query", [{"edge_length": 0.005}, {"edge_length": 1e-6}, {"edge_length": 1e-300}])
def test_an_edge_length_that_makes_too_many_vertices(client: Client, query: Any) -> None:
    status, line = client.refused(SHEET, **query)
    assert status == 413
    assert "at most 2,000" in line or f"at most {ELEMENTS:,}" in line
    assert "use a larger edge_length" in line


def test_too_many_given_vertices(client: Client) -> None:
    turn = np.linspace(0, 2 * np.pi, 2003).round(6)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1).round(5).tolist()
    status, line = client.refused({"type": "Polygon", "coordinates": [ring]})
    assert status == 413
    assert "2,002 boundary vertices" in line


def test_what_takes_too_long_is_ended(client: Client) -> None:
    before = workers(client.server.pid, quick=False)
    assert len(before) == REPLICAS
    status, line = client.refused(SHEET, **ENDLESS)
    assert status == 504
    assert f"within {SECONDS:g} s" in line
    assert len(set(before) & set(workers(client.server.pid, quick=False))) == REPLICAS - 1
    until(lambda: len(workers(client.server.pid, quick=False)) == REPLICAS)
    assert client.mesh(SHEET, **HEAVY, best_of=2)[0] == 200


SPLINTERS = st.sampled_from(
    [b"NaN", b"-Infinity", b"1e999", b"-1e300", b"1e-300", b"0", b"9" * 400, b"\x00", b"\xff", b"[", b"]", b"{", b"}",
     b",", b'"', b"null", b"true", b"[]", b"{}", b'"type"', b'"Polygon"', b'"rings"', b"[[[[[", b"\xe2\x82\xac"]
)  # fmt: skip


@st.composite
def broken(draw: st.DrawFn) -> bytes:
    """A polygon's text with a few places changed."""
    text = bytearray(json.dumps(draw(st.sampled_from([SHEET, PLATE, FEATURE]))).encode())
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(text)))
        text[at : at + draw(st.integers(0, 8))] = draw(SPLINTERS)
    return bytes(text)


@settings(max_examples=250, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(body=broken(), query=st.sampled_from([{}, {"edge_length": 0.5}, {"fix_parity": "true", "format": "bdf"}]))
def test_broken_polygons_are_meshed_or_refused(client: Client, body: bytes, query: dict[str, Any]) -> None:
    status, answer, _ = client.mesh(body, **query)
    assert status in (200, 400, 413, 422), (body, answer)
    if status != 200:
        line_of(answer)


def test_metrics_count_what_was_asked(client: Client) -> None:
    before = client.counts()
    quads = len(json.loads(client.mesh(SHEET, edge_length=0.5)[1])["quads"])
    assert client.mesh(b"no polygon")[0] == 400
    assert client.mesh(SHEET, edge_length=1e-9)[0] == 413
    assert client.ask("GET", "/nowhere")[0] == 404
    after = client.counts()
    changed = {name: after[name] - before.get(name, 0.0) for name in after if after[name] != before.get(name, 0.0)}
    seconds = {name for name in changed if "seconds" in name}
    assert changed["freemesh_request_seconds_count"] == 3
    assert {name: changed[name] for name in changed.keys() - seconds} == {
        "freemesh_requests_total /mesh 200": 1,
        "freemesh_requests_total /mesh 400": 1,
        "freemesh_requests_total /mesh 413": 1,
        "freemesh_requests_total other 404": 1,
        "freemesh_requests_total /metrics 200": 1,
        "freemesh_rejected_total size": 1,
        "freemesh_elements_total": quads,
    }
    assert after["freemesh_in_flight"] == 0


def test_only_this_machine_is_listened_to(client: Client) -> None:
    addresses = listeners(client.server.pid)
    assert addresses
    outside = [address for address in addresses if not (getattr(address, "ipv4_mapped", None) or address).is_loopback]
    assert outside == []


def test_more_large_uploads_than_there_is_room_for(client: Client) -> None:
    begun = request_lines("Content-Length: 99000") + b" " * 70_000
    with ExitStack() as open_ones:
        for _ in range(Limits().uploads):
            connection = open_ones.enter_context(socket.create_connection(("127.0.0.1", client.port)))
            connection.sendall(begun)
        until(lambda: client.mesh(b" " * 70_000)[0] == 503)
        status, body, headers = client.mesh(b" " * 70_000)
        assert (status, headers["Retry-After"]) == (503, "1")
        assert "try again" in line_of(body)
        assert client.mesh(SHEET, edge_length=1)[0] == 200
    until(lambda: client.mesh(b" " * 70_000)[0] == 400)


def test_more_costly_polygons_than_may_wait(client: Client) -> None:
    body = json.dumps(SHEET).encode()
    head = request_lines(f"Content-Length: {len(body)}").replace(b"/mesh", f"/mesh?{urlencode(ENDLESS)}".encode())
    before = client.counts()["freemesh_rejected_total busy"]
    with ExitStack() as open_ones:
        for _ in range(Limits().waiting + REPLICAS + 8):
            connection = open_ones.enter_context(socket.create_connection(("127.0.0.1", client.port)))
            connection.sendall(head + body)
        until(lambda: client.counts()["freemesh_rejected_total busy"] > before)
        # All of them were looked at: so many at once may fill the other queue, too, for a moment.
        until(lambda: client.mesh(SHEET, edge_length=1)[0] == 200)
        status, line = client.refused(SHEET, **ENDLESS)
        assert (status, "try again" in line) == (503, True)
        # Quick ones wait for none of them.
        for _ in range(20):
            assert client.mesh(SHEET, edge_length=1)[0] == 200
    # Those that waited left with their clients.
    until(lambda: client.counts()["freemesh_in_flight"] == 0)


def test_a_mesh_too_large(client: Client) -> None:
    square = {"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]]}
    status, line = client.refused(square, edge_length=0.00202)
    assert status == 413
    assert f"elements, at most {ELEMENTS:,} are made here" in line


@pytest.mark.parametrize("killed", ["ray::Mesher", "forking", "working"])
def test_a_kill_under_load_costs_no_answer(client: Client, killed: str) -> None:
    found = {"forking": forking, "working": workers}.get(killed, lambda pid: named(pid, killed))
    pid, answers, enough = client.server.pid, [], threading.Event()
    quads = json.loads(client.mesh(SHEET, **HEAVY)[1])["quads"]

    def ask() -> None:
        while not enough.is_set():
            answers.append(client.mesh(SHEET, **HEAVY))

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    try:
        until(lambda: len(answers) > 4)
        victim = found(pid)[0]
        orphans = family(victim)[1:]
        os.kill(victim, signal.SIGKILL)
        asked = len(answers)
        until(lambda: len(answers) > asked + 8)
        until(lambda: len(found(pid)) == REPLICAS and victim not in found(pid))
        until(lambda: not any(Path(f"/proc/{orphan}").exists() for orphan in orphans))
    finally:
        enough.set()
        for thread in threads:
            thread.join()
    assert {status for status, _, _ in answers} == {200}
    assert all(json.loads(body)["quads"] == quads for _, body, _ in answers)
    until(lambda: client.meshers() == REPLICAS)
