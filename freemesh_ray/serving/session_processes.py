"""What the service has started, all of it: the processes of its session, whoever their parents are now."""

from __future__ import annotations

import signal
import time

from freemesh_ray.local_ray.processes import STOPPED, of_session

#: Seconds for the guard of Ray to end what is left of it and to remove its folder, and then until a killed process is
#: gone; one that waits for a device may take longer.
GUARD, KILLED = 4.0, 2.0


def wake_stopped(session: int) -> None:
    """Let the stopped processes of a session go on."""
    for process in of_session(session):
        if process.state == STOPPED:
            process.send(signal.SIGCONT)


def end(session: int) -> None:
    """Wait until a session is over that has lost its first process; kill what is left of it after a moment."""
    began = time.monotonic()
    while (left := of_session(session)) and (waited := time.monotonic() - began) < GUARD + KILLED:
        for process in left if waited > GUARD else ():
            process.send(signal.SIGKILL)
        time.sleep(0.02)
