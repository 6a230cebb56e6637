"""What the service has started, all of it: the processes of its session, whoever their parents are now."""

from __future__ import annotations

import os
import signal
import time

from freemesh_ray.local_ray.processes import STOPPED, of_session

#: Seconds until a killed process is gone; one that waits for a device may take longer.
PATIENCE = 2.0


def wake_stopped(session: int) -> None:
    """Let the stopped processes of a session go on."""
    for process in of_session(session):
        if process.state == STOPPED:
            process.send(signal.SIGCONT)


def end(session: int) -> None:
    """Kill what is left of a session, this process excepted, and wait a moment until it is gone."""
    deadline = time.monotonic() + PATIENCE
    while left := [process for process in of_session(session) if process.number != os.getpid()]:
        for process in left:
            process.send(signal.SIGKILL)
        if time.monotonic() > deadline:
            return
        time.sleep(0.02)
