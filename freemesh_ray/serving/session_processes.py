"""The processes of a session, whoever their parents are now: what the service has started, all of it.

Linux tells them; elsewhere there are none.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

#: A stopped process, as /proc/PID/stat has it; one that a debugger holds is none.
STOPPED = "T"

#: Seconds until a killed process is gone; one that waits for a device may take longer.
PATIENCE = 2.0


def members(session: int) -> Iterator[tuple[int, str]]:
    """Numbers and states of the processes of a session, dead ones left out."""
    for entry in Path("/proc").glob("[0-9]*"):
        number = int(entry.name)
        if (found := state(number)) is not None and found[1] == session and found[0] not in "ZX":
            yield number, found[0]


def state(process: int) -> tuple[str, int] | None:
    """The state and the session of a process; None when it is gone."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text(errors="replace").rpartition(")")[2].split()
    except OSError:
        return None
    return fields[0], int(fields[3])


def wake(process: int) -> None:
    """Let a stopped process go on."""
    with suppress(ProcessLookupError):
        os.kill(process, signal.SIGCONT)


def wake_stopped(session: int) -> None:
    """Let the stopped processes of a session go on."""
    for process, letter in members(session):
        if letter == STOPPED:
            wake(process)


def end(session: int) -> None:
    """Kill what is left of a session, this process excepted, and wait a moment until it is gone."""
    deadline = time.monotonic() + PATIENCE
    while left := [process for process, _ in members(session) if process != os.getpid()]:
        for process in left:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        if time.monotonic() > deadline:
            return
        time.sleep(0.02)
