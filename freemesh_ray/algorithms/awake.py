"""For how long this process has been awake, by a clock that stands still while the process does.

``time.monotonic`` leaves out that a machine sleeps on Linux and macOS, but not that a process is stopped (Ctrl-Z), nor,
everywhere, that a virtual machine is paused. A thread that does nothing but look at the time tells: where it could not
for `GAP_SECONDS`, nothing in this process could do anything.
"""

from __future__ import annotations

import os
import threading
import time

#: Seconds between two looks, and from which on a gap between them is sleep: a busy machine makes short ones.
LOOK_SECONDS, GAP_SECONDS = 1.0, 30.0


class _Clock:
    """The clock of this process."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._looked = time.monotonic()
        self._asleep = 0.0
        self._process = 0

    def look(self) -> tuple[float, float]:
        """Seconds awake, from any moment on, and asleep."""
        with self._lock:
            now = time.monotonic()
            if now - self._looked > GAP_SECONDS:
                self._asleep += now - self._looked
            self._looked = now
            if self._process != os.getpid():  # at first, and in a fork, which has no thread
                self._process = os.getpid()
                threading.Thread(target=self._keep_looking, name="awake", daemon=True).start()
            return now - self._asleep, self._asleep

    def _keep_looking(self) -> None:
        while True:
            time.sleep(LOOK_SECONDS)
            self.look()


_clock = _Clock()


def awake() -> float:
    """Seconds that this process has been awake, from any moment on: differences count."""
    return _clock.look()[0]


def asleep() -> float:
    """Seconds that it was asleep or stopped since the first look."""
    return _clock.look()[1]
