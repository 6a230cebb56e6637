"""The guard of an embedded Ray: ``python -m freemesh_ray.local_ray.guard FOLDER PROCESS FIX``, a process of its own.

It looks after what the process has started whose Ray lies in the folder. What somebody has stopped (SIGSTOP) it lets go
on, and when the process is gone, however it ended, it kills what is left and removes the folder. Where Ray's own code
or the kernel has ended the process, the guard says the line that it could not say.
"""

from __future__ import annotations

import os
import select
import shutil
import signal
import sys
from collections import Counter
from contextlib import suppress
from pathlib import Path

from freemesh_ray.local_ray.processes import STOPPED, Process, children, process
from freemesh_ray.local_ray.vital import NEEDED, lost, started

#: Who may be gone: Ray's code ends a process that finds its raylet dead, and a dying process takes its raylet along.
ANY = "this command, or its Ray,"
#: Seconds between two looks.
LOOK_SECONDS = 0.5
#: Looks in a row at which a process is found stopped before it is let go on: a shell's `fg` may be on its way.
STOPPED_LOOKS = 2


class Guard:
    """What is known of the processes of one embedded Ray."""

    def __init__(self, folder: Path, owner: int) -> None:
        """Describe it.

        Args:
            folder: of the Ray.
            owner: the process that has started it.
        """
        self._folder = folder
        self._owner = process(owner)
        self._known: set[Process] = set()
        self._stopped: Counter[Process] = Counter()

    def look(self) -> None:
        """Remember what there is: also the children of processes that are gone later."""
        if self._owner is not None and self._owner.alive:
            self._known.update(started(self._owner.number, self._folder))
        found, new = set[Process](), {one for one in self._known if one.alive}
        while new:
            found |= new
            new = {child for one in new for child in children(one.number)} - found
        self._known = found

    def wake(self) -> None:
        """Let those go on that are stopped, unless their owner is, too, as by a shell's Ctrl-Z."""
        if self._owner is None or self._owner.state == STOPPED:
            return
        stopped = {one for one in self._known if one.state == STOPPED}
        self._stopped = Counter({one: self._stopped[one] + 1 for one in stopped})
        for one, looks in self._stopped.items():
            if looks >= STOPPED_LOOKS:
                one.send(signal.SIGCONT)

    def end(self) -> None:
        """Kill what is left."""
        self.look()
        while self._known:
            for one in self._known:
                one.send(signal.SIGKILL)
            self.look()


def main(folder: str, owner: str, fix: str) -> None:
    """Look until the owner, which holds the other end of the standard input, is gone or closes it.

    Args:
        folder: of its Ray.
        owner: its number.
        fix: what it wants its user to do.
    """
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    guard = Guard(Path(folder), int(owner))
    needed = False
    while True:
        if select.select([0], [], [], LOOK_SECONDS)[0]:
            told = os.read(0, 1)
            if not told:
                break
            needed = told == NEEDED
        guard.look()
        guard.wake()
    if needed:
        with suppress(OSError):
            os.write(2, f"freemesh: {lost(ANY, fix)}\n".encode(errors="replace"))
    guard.end()
    shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
