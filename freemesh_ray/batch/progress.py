"""How far a batch is: one line that is overwritten on a terminal, a line for each file elsewhere."""

from __future__ import annotations

import math
import time
from typing import TextIO

from freemesh_ray.batch.inputs import Job
from freemesh_ray.batch.outcome import Outcome
from freemesh_ray.batch.summary import counted, figures
from freemesh_ray.formatting.table import duration
from freemesh_ray.formatting.terminal import shown, write


class Progress:
    """Of files.

    Args:
        total: their number.
        stream: where to.
    """

    def __init__(self, total: int, stream: TextIO) -> None:
        self._total, self._stream = total, stream
        self._done, self._failed, self._skipped, self._began = 0, 0, 0, time.monotonic()
        self._width = 0

    def begin(self) -> None:
        """Show that nothing is done yet, on a terminal."""
        if self._stream.isatty():
            self._line()

    def tell(self, job: Job, outcome: Outcome) -> None:
        """Show that a file is done, what it was told, and why it failed."""
        self._done += 1
        self._failed += bool(outcome.error)
        self._skipped += outcome.skipped
        lines = list(outcome.notes)
        if outcome.error:
            lines.append(outcome.error)
        if not self._stream.isatty():
            what = "failed" if outcome.error else "meshed before" if outcome.skipped else figures(outcome)
            lines.append(f"{self._done} of {self._total}: {job.source}: {what}")
        self.clear()
        write(self._stream, "".join(f"{shown(line)}\n" for line in lines))
        if self._stream.isatty():
            self._line()

    def clear(self) -> None:
        """Take the line off the terminal."""
        if self._width and self._stream.isatty():
            write(self._stream, "\r" + " " * self._width + "\r")
        self._width = 0

    def _line(self) -> None:
        worked = self._done - self._skipped
        left = (time.monotonic() - self._began) / worked * (self._total - self._done) if worked else math.inf
        line = f"{self._done} of {counted(self._total, 'file')}, {self._failed} failed, {duration(left)} left"
        self._width = len(line)
        write(self._stream, "\r" + line)
