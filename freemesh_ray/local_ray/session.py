"""A running Ray of this process's own, watched: without its raylet or its GCS nothing goes on, and nobody would tell.

Ray's calls then wait for ever, or end the process with a page of log. Here the process ends with one line, and takes
along what it has started. A process of the session that somebody has stopped (SIGSTOP) is let go on.
"""

from __future__ import annotations

import os
import select
import shutil
import signal
import threading
from collections import Counter
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from envs.errors import FAILED
from freemesh_ray.local_ray.processes import STOPPED, Process, descendants, process

#: Seconds between two looks; the death of a process is told at once.
LOOK_SECONDS = 0.5
#: Looks in a row at which a process is found stopped before it is let go on: a shell's `fg` may be on its way.
STOPPED_LOOKS = 2


class Session:
    """A running Ray, in a ``with`` block; one of somebody else's has no processes here."""

    def __init__(
        self,
        folder: Path | None = None,
        processes: Mapping[str, int] | None = None,
        vital: Collection[str] = (),
        fix: str = "",
    ) -> None:
        """Describe it.

        Args:
            folder: Ray's, which is removed when the process ends before its time.
            processes: numbers of those that this process has started, by name; they have children.
            vital: names of those without which nothing goes on.
            fix: what the line that this process then ends with tells its user to do.
        """
        self._folder, self._fix = folder, fix
        self._known: set[Process] = set()
        self._vital: dict[int, str] = {}
        for name, number in (processes or {}).items():
            if (found := process(number)) is not None:
                self._known.add(found)
                if name in vital:
                    self._vital[os.pidfd_open(number)] = f"Ray's {name} (process {number})"
        self._stopped: Counter[Process] = Counter()
        self._over, self._end_of_block = os.pipe()
        self._ending = threading.Lock()
        self._thread = threading.Thread(target=self._watch, name="Ray's watch", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._end_of_block)
        self._thread.join()
        for descriptor in (self._over, *self._vital):
            os.close(descriptor)

    def end(self, line: str, code: int) -> None:
        """End this process at once, from whatever thread, and all that Ray has started.

        Args:
            line: what it says.
            code: its exit code.
        """
        self._ending.acquire()  # a second one waits for the end
        with suppress(OSError):
            os.write(2, f"freemesh: {line}\n".encode(errors="replace"))
            silence = os.open(os.devnull, os.O_WRONLY)
            for stream in (1, 2):  # Ray's own story would follow
                os.dup2(silence, stream)
        self._look()
        for one in self._known:
            one.send(signal.SIGKILL)
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
        os._exit(code)

    def _watch(self) -> None:
        looks = select.poll()
        for descriptor in (self._over, *self._vital):
            looks.register(descriptor, select.POLLIN | select.POLLHUP)
        while True:
            told = [descriptor for descriptor, _ in looks.poll(1000 * LOOK_SECONDS)]
            if self._over in told:
                return
            for descriptor in told:
                self.end(f"{self._vital[descriptor]} is gone, killed or out of memory: {self._fix}", FAILED)
            self._look()
            self._wake()

    def _look(self) -> None:
        """Remember what Ray has started, whoever is its parent now."""
        self._known = {one for one in self._known if one.alive}
        self._known.update(descendants([one.number for one in self._known]))

    def _wake(self) -> None:
        """Let those go on that are stopped."""
        stopped = {one for one in self._known if one.state == STOPPED}
        self._stopped = Counter({one: self._stopped[one] + 1 for one in stopped})
        for one, looks in self._stopped.items():
            if looks >= STOPPED_LOOKS:
                one.send(signal.SIGCONT)
