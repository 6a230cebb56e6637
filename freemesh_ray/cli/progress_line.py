"""The line that a training shows while it runs."""

from __future__ import annotations

import math
import shutil
import time
from typing import TYPE_CHECKING, TextIO

from freemesh_ray.formatting.table import duration, number
from freemesh_ray.formatting.terminal import OutputLostError, shown, write

if TYPE_CHECKING:
    from freemesh_ray.training.loop import Status

#: Seconds between progress lines where the line cannot be overwritten (a pipe, a log file).
LOG_INTERVAL = 15.0


class ProgressLine:
    """One line that is overwritten on a terminal, and written anew now and then elsewhere.

    Attributes:
        lost: why nothing can be shown any more; None while it can.
    """

    def __init__(self, stream: TextIO) -> None:
        self.lost: OutputLostError | None = None
        self._stream = stream
        self._live = stream.isatty()
        self._width = 0
        self._last = -math.inf

    def show(self, status: Status) -> None:
        """Show the figures."""
        line = (
            f"{status.stage}  step {status.env_steps:,}/{status.budget_steps:,}"
            f"  return {number(status.mean_return, '.1f')}  done {number(status.completion_rate, '.0%')}"
            f"  {status.updates_per_second:.0f} updates/s  {duration(status.seconds_left)} left"
        )
        if self._live:
            # A line that wraps could not be overwritten.
            line = line[: shutil.get_terminal_size().columns - 1]
            self._write("\r" + line.ljust(self._width))
            self._width = len(line)
        elif time.monotonic() - self._last >= LOG_INTERVAL:
            self._write(line + "\n")
            self._last = time.monotonic()

    def note(self, text: str) -> None:
        """A line that stays."""
        self.finish()
        self._write(shown(text) + "\n")

    def finish(self) -> None:
        """End the live line."""
        if self._live and self._width:
            self._write("\r" + " " * self._width + "\r")
            self._width = 0

    def _write(self, text: str) -> None:
        """Write; that it cannot be written does not end a training in the middle of an iteration."""
        try:
            write(self._stream, text)
        except OutputLostError as lost:
            self.lost = lost


class CompilingLine:
    """How far compiling is: one line that is overwritten on a terminal, a few lines elsewhere.

    Args:
        stream: where to.
        notice: a line before the first, if any.
    """

    #: Where a line cannot be overwritten, there is one for each such part.
    PARTS = 4

    def __init__(self, stream: TextIO, notice: str = "") -> None:
        self._stream, self._notice, self._part = stream, notice, 0

    def show(self, done: int, total: int) -> None:
        """Show that ``done`` of ``total`` kernels are compiled."""
        if done == 0 and self._notice:
            write(self._stream, self._notice + "\n")
        line = f"compiling kernels: {done} of {total}"
        if self._stream.isatty():
            write(self._stream, "\r" + line + ("\n" if done == total else ""))
        elif done * self.PARTS >= total * (self._part + 1):
            self._part = done * self.PARTS // total
            write(self._stream, line + "\n")
