"""A running Ray of this process's own, watched: when a part of it dies nothing goes on, and nobody would tell.

Ray's calls then wait for ever, or end the process with a page of log. Here the process ends with one line. Its guard,
another process, ends the rest of Ray with it, however it ended.
"""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from envs.errors import FAILED
from freemesh_ray.local_ray.processes import STOPPED, process
from freemesh_ray.local_ray.vital import NEEDED, NOT_NEEDED, lost, vital

#: Seconds between two looks at the guard.
LOOK_SECONDS = 0.5
#: Seconds that the guard gets to end what is left, which takes a few milliseconds.
GUARD_SECONDS = 10.0


class Session:
    """A Ray, in a ``with`` block that begins before it does; one of somebody else's has no processes here."""

    def __init__(self, folder: Path | None = None, fix: str = "", *, supervised: bool = False) -> None:
        """Describe it.

        Args:
            folder: Ray's; None for somebody else's.
            fix: what the line that this process may end with tells its user to do.
            supervised: another process says a line when this one is killed; else the guard does.
        """
        self._supervised = supervised
        self._folder, self._fix = folder, fix
        self._guard: subprocess.Popen[bytes] | None = None
        self._thread: threading.Thread | None = None
        self._ending = threading.Lock()
        self._told = NOT_NEEDED

    def __enter__(self) -> Self:
        if self._folder is not None and process(os.getpid()) is not None:
            self._start_guard()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.unwatch()
        if self._guard is not None and self._guard.stdin is not None:
            self._guard.stdin.close()
            with suppress(subprocess.TimeoutExpired):
                self._guard.wait(GUARD_SECONDS)

    def watch(self) -> None:
        """End this process with a line as soon as Ray, which is up now, is not any more; until `unwatch`."""
        if not self._supervised:
            self._tell_guard(NEEDED)
        watched = vital(os.getpid(), self._folder) if self._folder is not None else {}
        if watched:
            self._over, self._end_of_watch = os.pipe()
            self._thread = threading.Thread(target=self._watch, args=(watched,), name="Ray's watch", daemon=True)
            self._thread.start()

    def unwatch(self) -> None:
        """Ray is going to be ended."""
        self._tell_guard(NOT_NEEDED)
        if self._thread is not None:
            os.close(self._end_of_watch)
            self._thread.join()
            self._thread = None

    def end(self, line: str, code: int) -> None:
        """End this process at once, from whatever thread; its guard ends what it has started.

        Args:
            line: what it says.
            code: its exit code.
        """
        self._ending.acquire()  # a second one waits for the end
        self._tell_guard(NOT_NEEDED)
        with suppress(OSError):
            os.write(2, f"freemesh: {line}\n".encode(errors="replace"))
        os._exit(code)

    def _start_guard(self) -> None:
        # A process group of its own: Ctrl-C is for us. And nothing from the folder that we were started in (-P).
        arguments = [str(self._folder), str(os.getpid()), self._fix]
        self._guard = subprocess.Popen(
            [sys.executable, "-P", "-m", "freemesh_ray.local_ray.guard", *arguments],
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}, stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL, process_group=0,
        )  # fmt: skip

    def _tell_guard(self, what: bytes) -> None:
        self._told = what
        if self._guard is not None and self._guard.stdin is not None:
            with suppress(OSError):  # it was killed
                os.write(self._guard.stdin.fileno(), what)

    def _watch(self, watched: dict[int, str]) -> None:
        signs = select.poll()
        for descriptor in (self._over, *watched):
            signs.register(descriptor, select.POLLIN | select.POLLHUP)
        while self._over not in (told := [descriptor for descriptor, _ in signs.poll(1000 * LOOK_SECONDS)]):
            for descriptor in told:
                self.end(lost(watched[descriptor], self._fix), FAILED)
            self._keep_guard()
        for descriptor in (self._over, *watched):
            os.close(descriptor)

    def _keep_guard(self) -> None:
        """Start another guard where this one was killed, and let it go on where it was stopped."""
        if self._guard is not None and self._guard.poll() is not None:
            self._start_guard()
            self._tell_guard(self._told)
        elif self._guard is not None and (found := process(self._guard.pid)) is not None and found.state == STOPPED:
            found.send(signal.SIGCONT)
