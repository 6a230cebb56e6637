"""The line that a training shows while it runs."""

from __future__ import annotations

import math
import shutil
import sys
import time
from typing import TYPE_CHECKING, TextIO

from freemesh_ray.formatting.table import duration, number
from freemesh_ray.formatting.terminal import OutputLostError, shown, write
from freemesh_ray.training.callback import Callback

if TYPE_CHECKING:
    from freemesh_ray.training.loop import Status
    from freemesh_ray.training.run import Run

#: Seconds between progress lines where the line cannot be overwritten (a pipe, a log file).
LOG_INTERVAL = 15.0


class ProgressLine(Callback):
    """One line that is overwritten on a terminal, and written anew now and then elsewhere.

    Attributes:
        lost: why nothing can be shown any more, which interrupts the training; None while it can.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        """Write to a stream; without one to standard output."""
        self.lost: OutputLostError | None = None
        self._stream = stream = stream or sys.stdout
        self._live = stream.isatty()
        self._width = 0
        self._last = -math.inf

    def on_iteration(self, status: Status) -> None:
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
        if self.lost is not None:
            raise KeyboardInterrupt

    def on_note(self, line: str) -> None:
        """A line that stays."""
        self.finish()
        self._write(shown(line) + "\n")

    def on_end(self, run: Run) -> None:
        """Leave the place to what follows."""
        self.finish()

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
