"""The HTTP app and the command without a server: what is answered when meshers are busy, lost or mistaken."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import threading
from collections.abc import Awaitable, Callable
from contextlib import nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from processes import free_port

from freemesh_ray.cli import command
from freemesh_ray.cli.serve import TOKEN
from freemesh_ray.serving import service
from freemesh_ray.serving.answer import Answer, MeshRequest, refusal
from freemesh_ray.serving.counters import Counters
from freemesh_ray.serving.http_app import asgi_app, digest
from freemesh_ray.serving.lanes import QUICK
from freemesh_ray.serving.limits import Limits
from freemesh_ray.serving.parameters import ParameterError, Parameters, parameters, value_types
from freemesh_ray.serving.queue import Busy, ShareTaken
from freemesh_ray.serving.supervisor import Supervisor, WorkerError

LIMITS = Limits(upload_seconds=0.05, body_bytes=100)


def ask(
    mesh: Callable[[MeshRequest], Awaitable[Answer]],
    chunks: list[bytes] | None = None,
    *,
    path: str = "/mesh",
    method: str = "POST",
    meshers: int = 1,
    headers: list[tuple[bytes, bytes]] | None = None,
    guarded: bool = False,
) -> tuple[int, dict[str, str], bytes, Counters]:
    """Status, headers, body and counters after one request whose body's chunks come, but no end if there are none."""
    counters, sent = Counters(), []
    waiting = list(chunks or [])

    async def receive() -> dict[str, Any]:
        if not waiting:
            await asyncio.sleep(60)
        return {"type": "http.request", "body": waiting.pop(0), "more_body": bool(waiting) or chunks == []}

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {"type": "http", "method": method, "path": path, "query_string": b"", "headers": headers or [],
             "server": ("10.1.2.3", 8000), "client": ("10.9.8.7", 50000)}  # fmt: skip
    app = asgi_app(
        mesh, lambda: meshers, densities=["medium"], limits=LIMITS, token=digest("key") if guarded else None,
        counters=counters, hosts=["127.0.0.1"], pages=["mesh.example.org"],
    )  # fmt: skip
    asyncio.run(app(scope, receive, send))  # type: ignore[arg-type]
    start, *rest = sent
    told = {name.decode(): value.decode() for name, value in start["headers"]}
    return start["status"], told, b"".join(message.get("body", b"") for message in rest), counters


async def fine(request: MeshRequest) -> Answer:
    return Answer(200, request.body, elements=3)


async def busy(request: MeshRequest) -> Answer:
    raise Busy


def test_a_body_in_chunks_is_put_together() -> None:
    status, _, body, counters = ask(fine, [b"ab", b"", b"cd"])
    assert (status, body) == (200, b"abcd")
    assert b"freemesh_elements_total 3.0" in counters.page()[0]


def test_busy_meshers() -> None:
    status, headers, body, counters = ask(busy, [b"{}"])
    assert (status, headers["retry-after"]) == (503, "1")
    assert "try again" in json.loads(body)["error"]
    assert b'freemesh_rejected_total{reason="busy"} 1.0' in counters.page()[0]


def test_a_client_that_has_its_share_of_the_queue() -> None:
    async def refused(request: MeshRequest) -> Answer:
        assert request.client == "10.9.8.7"
        raise ShareTaken

    status, headers, body, counters = ask(refused, [b"{}"])
    assert (status, headers["retry-after"]) == (503, "1")
    line = json.loads(body)["error"]
    assert "your address" in line
    assert "try again" in line
    assert b'freemesh_rejected_total{reason="busy"} 1.0' in counters.page()[0]


def test_a_body_that_does_not_come() -> None:
    status, headers, body, _ = ask(fine)
    assert (status, headers["connection"]) == (408, "close")
    assert "send it at once" in json.loads(body)["error"]


def test_a_body_too_large_in_chunks() -> None:
    status, _, _, counters = ask(fine, [b"x" * 60, b"x" * 60])
    assert status == 413
    assert b'freemesh_rejected_total{reason="size"} 1.0' in counters.page()[0]


def test_no_mesher_runs() -> None:
    assert ask(fine, path="/health", method="GET", meshers=0)[0] == 503
    assert ask(fine, path="/health", method="GET", meshers=2)[0] == 200


def test_the_token() -> None:
    for sent, status in ((b"bearer key", 200), (b"Bearer key2", 401), (b"key", 401)):
        assert ask(fine, [b""], headers=[(b"authorization", sent)], guarded=True)[0] == status


@pytest.mark.parametrize(
    ("host", "status"),
    [(b"localhost", 200), (b"LOCALHOST.:80", 200), (b"127.0.0.1:8000", 200), (b"[::1]:8000", 200), (b"10.1.2.3:1", 200),
     (b"Mesh.Example.org", 200), (b"evil.example", 403), (b"localhost.evil.example", 403), (b"127.0.0.2", 403),
     (b"", 403), (b"[::1", 403), (b"localhost:80:80", 403), (b"localhost@evil.example", 403), (b"\xff", 403),
     (b"10.1.2.3.nip.io", 403), (b"localhost:65535", 200), (b"localhost:65536", 403), (b"localhost:99999", 403)],
)  # fmt: skip
@pytest.mark.parametrize("path", ["/mesh", "/health"])
def test_the_host_that_is_asked_for(host: bytes, status: int, path: str) -> None:
    method = "POST" if path == "/mesh" else "GET"
    assert ask(fine, [b""], path=path, method=method, headers=[(b"host", host)])[0] == status


@pytest.mark.parametrize(
    ("origin", "status"),
    [(b"http://localhost:8000", 200), (b"https://localhost:8000", 200), (b"https://mesh.example.org", 200),
     (b"http://localhost:9000", 403), (b"http://localhost", 403), (b"http://127.0.0.1:9000", 403),
     (b"http://127.0.0.1", 403), (b"http://127.0.0.1:8000", 403), (b"https://mesh.example.org:9000", 403),
     (b"http://evil.example", 403), (b"null", 403),
     (b"chrome-extension://localhost:8000", 403), (b"localhost:8000", 403),
     (b"", 403), (b"http://", 403), (b"\xff", 403)],
)  # fmt: skip
def test_the_page_that_asks(origin: bytes, status: int) -> None:
    assert ask(fine, [b""], headers=[(b"host", b"localhost:8000"), (b"origin", origin)])[0] == status


@pytest.mark.parametrize("guarded", [False, True])
@pytest.mark.parametrize("path", ["/", "/mesh", "/health", "/metrics", "/nowhere"])
@pytest.mark.parametrize("header", [(b"host", b"evil.example"), (b"origin", b"http://127.0.0.1:9000")])
def test_another_server_s_page_gets_nothing(guarded: bool, path: str, header: tuple[bytes, bytes]) -> None:
    headers = [header, (b"authorization", b"Bearer key")]
    if header[0] == b"origin":
        headers.append((b"host", b"127.0.0.1:8000"))
    for method in ("GET", "POST", "PUT", "DELETE"):
        assert ask(fine, [b""], path=path, method=method, headers=headers, guarded=guarded)[0] == 403


def test_a_wrong_host_is_refused_before_the_token_is_looked_at() -> None:
    headers = [(b"host", b"evil.example"), (b"authorization", b"Bearer key2")]
    assert ask(fine, [b""], headers=headers, guarded=True)[0] == 403


def test_a_client_that_leaves_is_no_longer_waited_for() -> None:
    async def never(request: MeshRequest) -> Answer:
        await asyncio.sleep(60)
        raise AssertionError

    messages = [{"type": "http.request", "body": b"{}", "more_body": False}, {"type": "http.disconnect"}]
    counters = Counters()

    async def receive() -> dict[str, Any]:
        return messages.pop(0)

    async def send(message: Any) -> None:
        pass

    app = asgi_app(never, lambda: 1, densities=["medium"], limits=LIMITS, token=None, counters=counters)
    scope = {"type": "http", "method": "POST", "path": "/mesh", "query_string": b"", "headers": []}
    asyncio.run(asyncio.wait_for(app(scope, receive, send), 10))  # type: ignore[arg-type]
    assert b'freemesh_requests_total{path="/mesh",status="499"} 1.0' in counters.page()[0]


@pytest.mark.slow
def test_large_bodies_on_their_way_leave_room_for_small_ones() -> None:
    limits = Limits(quick_bytes=10, uploads=2, upload_seconds=1.0)
    app = asgi_app(fine, lambda: 1, densities=["medium"], limits=limits, token=None, counters=Counters())

    async def post(*chunks: bytes, ends: bool = True) -> int:
        waiting, sent = list(chunks), []

        async def receive() -> dict[str, Any]:
            if not waiting:
                await asyncio.sleep(60)
            return {"type": "http.request", "body": waiting.pop(0), "more_body": bool(waiting) or not ends}

        async def send(message: Any) -> None:
            sent.append(message)

        scope = {"type": "http", "method": "POST", "path": "/mesh", "query_string": b"", "headers": []}
        await app(scope, receive, send)  # type: ignore[arg-type]
        return sent[0]["status"]

    async def all_of_them() -> list[int]:
        slow = [asyncio.create_task(post(b"x" * 11, ends=False)) for _ in range(2)]
        await asyncio.sleep(0)
        small, large = await post(b"x" * 10), await post(b"x" * 11)
        first, second = await asyncio.gather(*slow)
        return [small, large, first, second, await post(b"x" * 11)]

    assert asyncio.run(all_of_them()) == [200, 503, 408, 408, 200]


def test_only_requests_for_a_mesh_count_as_turned_away() -> None:
    counters = Counters()
    for path in ("/mesh", "/health", "/metrics"):
        counters.answered(path, 401)
    page = counters.page()[0].decode()
    assert 'freemesh_rejected_total{reason="token"} 1.0' in page
    assert page.count('status="401"} 1.0') == 3


def test_a_mistake_is_told_to_the_log_alone() -> None:
    async def mistaken(request: MeshRequest) -> Answer:
        raise ZeroDivisionError("secret")

    seen = []

    async def send(message: Any) -> None:
        seen.append(message)

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": b"", "more_body": False}

    app = asgi_app(mistaken, lambda: 1, densities=["medium"], limits=LIMITS, token=None, counters=Counters())
    scope = {"type": "http", "method": "POST", "path": "/mesh", "query_string": b"", "headers": []}
    with pytest.raises(ZeroDivisionError):
        asyncio.run(app(scope, receive, send))  # type: ignore[arg-type]
    assert seen[0]["status"] == 500
    assert b"secret" not in seen[1]["body"]


@given(
    wanted=st.builds(
        Parameters,
        density=st.sampled_from(["dense", "medium"]),
        edge_length=st.none() | st.floats(1e-300, 1e300),
        grading=st.floats(1, 1000),
        fix_parity=st.booleans(),
        seed=st.integers(0, 2**32 - 1),
        best_of=st.integers(1, 8),
        smooth=st.booleans(),
        clean=st.booleans(),
        format=st.sampled_from(["json", "inp"]),
    )
)
def test_parameters_come_back(wanted: Parameters) -> None:
    if wanted.edge_length is None:
        wanted = replace(wanted, grading=1.0)
    given_ones = {name: value for name, value in asdict(wanted).items() if value is not None}
    query = [
        (name, str(value).lower() if isinstance(value, bool) else str(value)) for name, value in given_ones.items()
    ]
    assert parameters(query, ["dense", "medium"], Limits()) == wanted


@pytest.mark.slow
@given(st.lists(st.tuples(st.sampled_from([*value_types(["one"], Limits()), "x"]) | st.text(), st.text()), max_size=4))
def test_any_query_is_understood_or_refused_in_a_line(query: list[tuple[str, str]]) -> None:
    try:
        line = parameters(query, ["one"], Limits()).density
    except ParameterError as error:
        line = str(error)
    assert line
    assert len(line) < 300


def test_long_lines_keep_both_ends() -> None:
    line = json.loads(refusal(422, "begin" + "x" * 10_000 + "end").body)["error"]
    assert len(line) < 500
    assert line.startswith("begin")
    assert line.endswith("end")


def test_a_worker_that_cannot_start_is_an_error() -> None:
    supervisor = Supervisor({"medium": "no policy"}, Limits(), QUICK)  # type: ignore[dict-item]
    with pytest.raises(WorkerError, match="before it was ready"):
        supervisor.start()
    supervisor.stop()


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 0)])
def test_signals_stop_the_command(number: int, code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    before, waits = signal.getsignal(signal.SIGTERM), threading.Event()

    class Started:
        def wait(self) -> None:
            waits.set()
            threading.Event().wait(60)

    def send() -> None:
        assert waits.wait(60)
        os.kill(os.getpid(), number)

    monkeypatch.setattr(service, "running_service", lambda *_, **__: nullcontext(Started()))
    monkeypatch.delenv(TOKEN, raising=False)
    sender = threading.Thread(target=send)
    sender.start()
    try:
        assert command.main(["serve"]) == code
    finally:
        sender.join()
    assert signal.getsignal(signal.SIGTERM) is before


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line on stderr of a command that does not begin."""
    try:
        code = command.main(["serve", *arguments])
    except SystemExit as exit_:
        code = exit_.code
    out, err = capsys.readouterr()
    assert (code, out, err.count("\n")) == (2, "", 1), err
    return err


def test_the_command_refuses(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv(TOKEN, raising=False)
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    assert TOKEN in refused(capsys, "--host", "0.0.0.0")
    assert "no such policy" in refused(capsys, "--policy", str(tmp_path / "policy.npz"))
    assert "--port" in refused(capsys, "--port", "0")
    with socket.create_server(("127.0.0.1", port := free_port())):
        assert f"127.0.0.1:{port}: cannot be listened on" in refused(capsys, "--port", str(port))


@pytest.mark.parametrize(
    ("host", "own"),
    [("127.0.0.1", True), ("127.8.8.8", True), ("::1", True), ("localhost", True), ("0.0.0.0", False), ("::", False),
     ("192.168.1.2", False), ("example.org", False), ("", False)],
)  # fmt: skip
def test_loopback_hosts(host: str, own: bool) -> None:
    assert service.is_loopback(host) is own
