"""Connections as the server has them: each has deadlines, and there are only so many of them.

It is either the client's turn, until its request has arrived, or the server's. On its turn a client has little time.
When there are too many connections, the one whose client has had its turn for longest goes: idle ones never keep a new
one out.
"""

from __future__ import annotations

import asyncio
import json
import resource
from collections.abc import Callable
from contextlib import suppress
from ipaddress import IPv6Address, ip_address
from pathlib import Path
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from envs.errors import UserError
from freemesh_ray.serving.limits import Limits

#: Connections that wait to be accepted; that many may be before the first is looked at.
BACKLOG = 128

#: Descriptors that are left for everything else that the process opens while it runs, and those that it needs at least.
SPARE, LEAST = 128, 16

#: Answers that may wait for their clients to read them; one more, and the slowest client is cut off.
UNREAD = 32

#: Bits of an IPv6 address that one client has to itself.
NETWORK = 64


class Connections:
    """The connections of a server, by whose turn it is and by address."""

    def __init__(self, most: int, cut: Callable[[str], None] = lambda reason: None) -> None:
        """Begin without any.

        Args:
            most: open at a time; one address may have half of them.
            cut: called with the reason when one is cut off.
        """
        self._most, self.cut = most, cut
        self._open: dict[str, set[Connection]] = {}
        # Those on their client's turn, the longest first.
        self._waiting: dict[str, dict[Connection, None]] = {}
        self._unread: dict[Connection, None] = {}
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def admit(self, new: Connection) -> bool:
        """Whether there is room for a new connection; another one may have to go."""
        self._open.setdefault(new.address, set()).add(new)
        self._count += 1
        if len(self._open[new.address]) > max(self._most // 2, 1):
            return self._make_room(new.address)
        if self._count > self._most:
            return self._make_room(max(self._waiting, key=lambda one: len(self._open[one]), default=""))
        return True

    def _make_room(self, address: str) -> bool:
        for longest in self._waiting.get(address, ()):
            longest.cut_off("room")
            return True
        return False

    def waits(self, one: Connection) -> None:
        """It is the client's turn."""
        if one in self._open.get(one.address, ()):
            self._waiting.setdefault(one.address, {}).setdefault(one)

    def works(self, one: Connection) -> None:
        """It is the server's turn."""
        if (there := self._waiting.get(one.address)) is not None:
            there.pop(one, None)
            if not there:
                del self._waiting[one.address]

    def unread(self, one: Connection) -> None:
        """A client is slow to read an answer."""
        self._unread[one] = None
        if len(self._unread) > UNREAD:
            next(iter(self._unread)).cut_off("unread")

    def read(self, one: Connection) -> None:
        """It has read on."""
        self._unread.pop(one, None)

    def leave(self, one: Connection) -> None:
        """A connection is closed."""
        self.works(one)
        self.read(one)
        if one in (there := self._open.get(one.address, set())):
            there.remove(one)
            self._count -= 1
            if not there:
                del self._open[one.address]


class Connection(H11Protocol):
    """One connection, in HTTP/1.1."""

    def __init__(self, *arguments: Any, limits: Limits, connections: Connections, **named: Any) -> None:
        """As uvicorn does.

        Args:
            limits: of which those in seconds that end with ``upload`` are the application's.
            connections: all of them.
        """
        super().__init__(*arguments, **named)
        self.address = ""
        self._limits, self._all = limits, connections
        self._timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.address = client_address(self.client)
        if self._all.admit(self):
            self._turn()
        else:
            self.cut_off("room")

    def connection_lost(self, exc: Exception | None) -> None:
        self._set_timer(None)
        self._all.leave(self)
        super().connection_lost(exc)
        self._unset_keepalive_if_required()

    def data_received(self, data: bytes) -> None:
        try:
            super().data_received(data)
        except h11.ProtocolError:
            # Nonsense after the answer has begun.
            self.cut_off("protocol")
        else:
            self._turn()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self._turn()

    def pause_writing(self) -> None:
        super().pause_writing()
        self._all.unread(self)
        self._set_timer(self._limits.write_seconds, "unread")

    def resume_writing(self) -> None:
        super().resume_writing()
        self._all.read(self)
        self._set_timer(None)
        self._turn()

    def send_400_response(self, msg: str) -> None:
        line = f"request: no valid HTTP ({msg.rstrip('.').lower()})"
        body = json.dumps({"error": line}).encode() + b"\n"
        headers = [("Content-Type", "application/json"), ("Content-Length", str(len(body))), ("Connection", "close")]
        for event in (h11.Response(status_code=400, headers=headers), h11.Data(data=body), h11.EndOfMessage()):
            self.transport.write(self.conn.send(event) or b"")
        self._leave_the_application()
        self.transport.close()

    def cut_off(self, reason: str) -> None:
        """Close at once, whatever is still to be sent."""
        self._all.cut(reason)
        self._all.leave(self)
        self._set_timer(None)
        self._leave_the_application()
        self.transport.abort()

    def _leave_the_application(self) -> None:
        """What the application says from now on is for nobody."""
        if self.cycle is not None and not self.cycle.response_complete:
            self.cycle.disconnected = True
            self.cycle.message_event.set()

    def _turn(self) -> None:
        """See whose turn it is: the clock of the client's runs from its beginning, not from each byte."""
        answered = self.cycle is None or self.cycle.response_complete
        if answered or self.cycle.more_body:
            self._all.waits(self)
        else:
            self._all.works(self)
        if self.flow.write_paused:
            return
        if not answered:
            # The application has a clock of its own for a body.
            self._set_timer(None)
        elif self._timer is None:
            self._set_timer(self._limits.head_seconds, "head")

    def _set_timer(self, seconds: float | None, reason: str = "") -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = None if seconds is None else self.loop.call_later(seconds, self.cut_off, reason)


def client_address(client: tuple[str, int] | None) -> str:
    """What tells clients apart: an address, of version 6 its network."""
    if client is None:
        return ""
    try:
        address = ip_address(client[0].partition("%")[0])
    except ValueError:
        return client[0]
    if isinstance(address, IPv6Address):
        if address.ipv4_mapped is not None:
            return str(address.ipv4_mapped)
        return str(int(address) >> (128 - NETWORK))
    return str(address)


def affordable(wanted: int) -> int:
    """How many connections this process can have, ``wanted`` at most, once it has opened what it always needs.

    Raises:
        UserError: hardly any.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    there = open_descriptors()
    needed = there + BACKLOG + SPARE + wanted
    if soft != resource.RLIM_INFINITY and soft < needed:
        soft = needed if hard == resource.RLIM_INFINITY else min(needed, hard)
        with suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    soft = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    room = wanted if soft == resource.RLIM_INFINITY else min(wanted, soft - there - BACKLOG - SPARE)
    if room < LEAST:
        raise UserError(f"{soft} descriptors are too few for a server: allow it more (ulimit -n {needed})")
    return room


def open_descriptors() -> int:
    """How many descriptors this process has open."""
    for folder in ("/proc/self/fd", "/dev/fd"):
        with suppress(OSError):
            return sum(1 for _ in Path(folder).iterdir())
    return SPARE
