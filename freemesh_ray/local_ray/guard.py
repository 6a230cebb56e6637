"""The guard of an embedded Ray, a process of its own: ``python -m freemesh_ray.local_ray.guard FOLDER PROCESS``.

It looks after what the process has started whose Ray lies in the folder. What somebody has stopped (SIGSTOP) it lets go
on, and when the process is gone, however it ended, it kills what is left and removes the folder.
"""

from __future__ import annotations

import os
import select
import shutil
import signal
import sys
from collections import Counter

from freemesh_ray.local_ray.processes import STOPPED, Process, children, command_line, process

#: Seconds between two looks.
LOOK_SECONDS = 0.5
#: Looks in a row at which a process is found stopped before it is let go on: a shell's `fg` may be on its way.
STOPPED_LOOKS = 2


class Guard:
    """What is known of the processes of one embedded Ray."""

    def __init__(self, folder: str, owner: int) -> None:
        """Describe it.

        Args:
            folder: of the Ray, which the command lines of its processes name.
            owner: the process that has started it.
        """
        self._folder = folder
        self._owner = process(owner)
        self._known: set[Process] = set()
        self._stopped: Counter[Process] = Counter()

    def look(self) -> None:
        """Remember what there is: also the children of processes that are gone later."""
        if self._owner is not None and self._owner.alive:
            for child in children(self._owner.number):
                if child.number != os.getpid() and self._folder in command_line(child.number):
                    self._known.add(child)
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


def main(folder: str, owner: str) -> None:
    """Look until the owner, which holds the other end of the standard input, is gone or closes it."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    guard = Guard(folder, int(owner))
    while not select.select([sys.stdin], [], [], LOOK_SECONDS)[0]:
        guard.look()
        guard.wake()
    guard.end()
    shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
