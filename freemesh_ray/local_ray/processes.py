"""Processes as Linux's /proc tells of them; elsewhere there are none."""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

#: States of a process: stopped by a signal, and dead. One that a debugger holds is in another.
STOPPED, DEAD = "T", "ZX"


class Process(NamedTuple):
    """A process; a later one that gets its number is another.

    Attributes:
        number: of the process.
        began: clock ticks from the machine's start to its own.
    """

    number: int
    began: int

    @property
    def state(self) -> str:
        """A letter; one of `DEAD` when it is gone."""
        found = _read(self.number)
        return found[0] if found is not None and found[1] == self.began else DEAD[-1]

    @property
    def alive(self) -> bool:
        """Whether it is there, be it stopped."""
        return self.state not in DEAD

    def send(self, number: signal.Signals) -> None:
        """Send it a signal, if it is there."""
        with suppress(ProcessLookupError, PermissionError):
            if self.alive:
                os.kill(self.number, number)


def process(number: int) -> Process | None:
    """The living process of this number, if there is one."""
    found = _read(number)
    return Process(number, found[1]) if found is not None and found[0] not in DEAD else None


def of_session(session: int) -> list[Process]:
    """The living processes of a session, whoever their parents are now."""
    found = []
    for name in os.listdir("/proc") if os.path.isdir("/proc") else ():
        with suppress(OSError):
            if name.isdecimal() and os.getsid(int(name)) == session:
                found.append(process(int(name)))
    return [one for one in found if one is not None]


def children(number: int) -> list[Process]:
    """The living children of a process."""
    found: list[int] = []
    with suppress(OSError):
        for thread in os.listdir(f"/proc/{number}/task"):  # each knows those that it started
            with suppress(OSError):
                found += map(int, Path(f"/proc/{number}/task/{thread}/children").read_text().split())
    return [one for one in map(process, found) if one is not None]


def command_line(number: int) -> str:
    """The words of a process, with spaces in between; empty when it is gone."""
    try:
        return Path(f"/proc/{number}/cmdline").read_text(errors="replace").replace("\0", " ")
    except OSError:
        return ""


def _read(number: int) -> tuple[str, int] | None:
    """State and beginning of a process; None when it is gone."""
    try:
        fields = Path(f"/proc/{number}/stat").read_text(errors="replace").rpartition(")")[2].split()
    except OSError:
        return None
    return fields[0], int(fields[19])
