"""Processes as Linux's /proc tells of them; elsewhere there are none."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

#: States of a process: stopped by a signal, and dead. One that a debugger holds is in another.
STOPPED, DEAD = "T", "ZX"


class Process(NamedTuple):
    """A process that no later one with its number is taken for.

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
    """The process of this number; None when it is gone."""
    found = _read(number)
    return Process(number, found[1]) if found is not None and found[0] not in DEAD else None


def descendants(roots: Iterable[int]) -> Iterator[Process]:
    """The children of processes, their children, and so on, parents first."""
    for root in roots:
        for number in _children(root):
            if (child := process(number)) is not None:
                yield child
            yield from descendants([number])


def _children(number: int) -> list[int]:
    """Numbers of the children of a process; each was started by one of its threads."""
    found: list[int] = []
    with suppress(OSError):
        for thread in os.listdir(f"/proc/{number}/task"):
            with suppress(OSError):
                found += map(int, Path(f"/proc/{number}/task/{thread}/children").read_text().split())
    return found


def _read(number: int) -> tuple[str, int] | None:
    """State and beginning of a process; None when it is gone."""
    try:
        fields = Path(f"/proc/{number}/stat").read_text(errors="replace").rpartition(")")[2].split()
    except OSError:
        return None
    return fields[0], int(fields[19])
