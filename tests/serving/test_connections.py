"""Connections on a real port of this process: deadlines, and room for new ones whatever the others do."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import partial
from typing import Any

import pytest
import uvicorn
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.errors import UserError
from freemesh_ray.serving import connections as module
from freemesh_ray.serving.connections import Connection, Connections, affordable, client_address
from freemesh_ray.serving.limits import Limits

LIMITS = replace(Limits(), head_seconds=0.5, idle_seconds=1, write_seconds=0.5)
REQUEST = b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"
LARGE = b"x" * 20_000_000


class Clients:
    """Clients of a server in this loop, and why it cut connections off."""

    def __init__(self, port: int, cut: Counter[str]) -> None:
        self.cut, self._port = cut, port

    async def connect(self, *sent: bytes) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        reader, writer = await asyncio.open_connection("127.0.0.1", self._port)
        for each in sent:
            writer.write(each)
        await writer.drain()
        return reader, writer

    async def ask(self, *sent: bytes) -> bytes:
        """All that is answered until the connection is closed; nothing where it is cut off."""
        reader, writer = await self.connect(*sent)
        try:
            return await asyncio.wait_for(reader.read(), 20)
        except ConnectionError:
            return b""
        finally:
            writer.close()


async def application(scope: Any, receive: Any, send: Any) -> None:
    body = LARGE if scope["path"] == "/large" else b"fine"
    if scope["path"] == "/slow":
        await asyncio.sleep(2.0)
    await send(
        {"type": "http.response.start", "status": 200, "headers": [(b"content-length", str(len(body)).encode())]}
    )
    await send({"type": "http.response.body", "body": body})


@asynccontextmanager
async def server(most: int = 100, limits: Limits = LIMITS) -> AsyncIterator[Clients]:
    cut: Counter[str] = Counter()
    connections = Connections(most, lambda reason: cut.update([reason]))
    listening = socket.create_server(("127.0.0.1", 0))
    http: Any = partial(Connection, limits=limits, connections=connections)
    config = uvicorn.Config(
        application, http=http, lifespan="off", ws="none", log_config=None, timeout_keep_alive=limits.idle_seconds
    )
    running = uvicorn.Server(config)
    running.capture_signals = contextlib.nullcontext  # type: ignore[method-assign,assignment]
    serving = asyncio.create_task(running.serve([listening]))
    try:
        yield Clients(listening.getsockname()[1], cut)
    finally:
        running.should_exit = running.force_exit = True
        await asyncio.wait_for(serving, 20)
        assert len(connections) == 0


@pytest.mark.parametrize(
    "sent",
    [b"", b"GET", REQUEST[:-2], REQUEST + b"GET / HT", b"GET / HTTP/1.1\r\nHost: a\r\nContent-Length: 9\r\n\r\n1"],
    ids=["silent", "a word", "no end", "half of a second one", "half a body that nobody reads"],
)
def test_a_request_that_does_not_end_is_cut_off(sent: bytes) -> None:
    async def run() -> bytes:
        async with server() as clients:
            reader, writer = await clients.connect(sent)
            with contextlib.suppress(ConnectionError):
                await asyncio.wait_for(reader.read(), 20)
            writer.close()
            return b"head" if clients.cut == {"head": 1} else b""

    assert asyncio.run(run()) == b"head"


def test_bytes_that_trickle_in_win_no_time() -> None:
    async def run() -> None:
        async with server() as clients:
            _, writer = await clients.connect()
            for byte in REQUEST * 2:
                writer.write(bytes([byte]))
                await asyncio.sleep(0.05)
                if clients.cut:
                    break
            assert clients.cut == {"head": 1}

    asyncio.run(run())


@pytest.mark.slow
def test_the_server_takes_its_time() -> None:
    async def run() -> None:
        async with server() as clients:
            reader, _ = await clients.connect(b"GET /slow HTTP/1.1\r\nHost: localhost\r\n\r\n")
            assert (await asyncio.wait_for(reader.readline(), 20)).startswith(b"HTTP/1.1 200")
            assert clients.cut == {}

    asyncio.run(run())


def test_an_answer_that_is_not_read_is_dropped() -> None:
    async def run() -> None:
        async with server() as clients:
            _, writer = await clients.connect(b"GET /large HTTP/1.1\r\nHost: localhost\r\n\r\n")
            for _ in range(200):
                await asyncio.sleep(0.1)
                if clients.cut:
                    break
            assert clients.cut == {"unread": 1}
            writer.close()

    asyncio.run(run())


def test_only_so_many_answers_wait_to_be_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "UNREAD", 3)

    async def run() -> None:
        async with server(limits=replace(LIMITS, write_seconds=60)) as clients:
            unread = [await clients.connect(b"GET /large HTTP/1.1\r\nHost: localhost\r\n\r\n") for _ in range(5)]
            for _ in range(200):
                await asyncio.sleep(0.1)
                if clients.cut["unread"] == 2:
                    break
            assert clients.cut == {"unread": 2}
            for _, writer in unread:
                writer.close()

    asyncio.run(run())


def test_idle_connections_keep_nobody_out() -> None:
    async def run() -> None:
        async with server(most=20, limits=replace(LIMITS, head_seconds=60)) as clients:
            idle = [await clients.connect(b"GET / HT"[: i % 8]) for i in range(100)]
            for _ in range(20):
                answer = await clients.ask(REQUEST.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n"))
                assert answer.startswith(b"HTTP/1.1 200")
            assert clients.cut["room"] >= 100 - 20 // 2
            for _, writer in idle:
                writer.close()

    asyncio.run(run())


def test_nonsense_is_refused_in_a_line() -> None:
    async def run() -> None:
        async with server() as clients:
            answer = await clients.ask(b"NONSENSE\r\n\r\n")
            assert answer.startswith(b"HTTP/1.1 400")
            assert b'{"error": "request: no valid HTTP' in answer

    asyncio.run(run())


class Fake:
    """A connection that is only counted."""

    def __init__(self, address: str) -> None:
        self.address = address
        self.off = False

    def cut_off(self, reason: str) -> None:
        self.off = True
        self.all.leave(self)

    all: Any


@settings(max_examples=300)
@given(
    most=st.integers(2, 12),
    events=st.lists(
        st.tuples(st.sampled_from(["admit", "waits", "works", "leave"]), st.integers(0, 3), st.integers(0, 30)),
        max_size=80,
    ),
)
def test_there_are_never_more_than_allowed(most: int, events: list[tuple[str, int, int]]) -> None:
    everyone: Any = Connections(most)
    there: list[Any] = []
    for what, address, which in events:
        if what == "admit":
            new = Fake(str(address))
            new.all = everyone
            if everyone.admit(new):
                there.append(new)
                everyone.waits(new)
            else:
                everyone.leave(new)
                alike = [one for one in there if one.address == new.address and not one.off]
                assert all(one not in everyone._waiting.get(one.address, ()) for one in alike) or len(there) >= most
        elif there:
            getattr(everyone, what)(there[which % len(there)])
            if what == "leave":
                there.pop(which % len(there))
        there = [one for one in there if not one.off]
        assert len(everyone) == len(there) <= most
        assert max(Counter(one.address for one in there).values(), default=0) <= max(most // 2, 1)


@pytest.mark.parametrize(
    ("one", "other", "alike"),
    [("1.2.3.4", "1.2.3.5", False), ("2001:db8::1", "2001:db8::2", True), ("2001:db8::1", "2001:db8:0:1::1", False),
     ("::ffff:1.2.3.4", "1.2.3.4", True), ("fe80::1%eth0", "fe80::2%eth1", True)],
)  # fmt: skip
def test_what_counts_as_one_client(one: str, other: str, alike: bool) -> None:
    assert (client_address((one, 1)) == client_address((other, 2))) is alike


def test_descriptors_bound_the_connections(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module.resource, "setrlimit", lambda *_: None)
    monkeypatch.setattr(module, "open_descriptors", lambda: 100)
    monkeypatch.setattr(module.resource, "getrlimit", lambda _: (1024, 1024))
    assert affordable(1000) == 1024 - 100 - module.BACKLOG - module.SPARE
    assert affordable(10_000) == affordable(1000)
    assert affordable(50) == 50
    monkeypatch.setattr(module.resource, "getrlimit", lambda _: (300, 300))
    with pytest.raises(UserError, match="ulimit -n"):
        affordable(1000)
