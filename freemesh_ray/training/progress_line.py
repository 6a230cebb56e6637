"""The line that a training shows while it runs."""

from __future__ import annotations

import math
import shutil
import sys
import time
from typing import TYPE_CHECKING, TextIO

from freemesh_ray.formatting.table import duration, number
from freemesh_ray.formatting.terminal import shown, write
from freemesh_ray.training.callback import Callback

if TYPE_CHECKING:
    from freemesh_ray.training.run import Run
    from freemesh_ray.training.status import Status

#: Seconds between progress lines where the line cannot be overwritten (a pipe, a log file).
LOG_INTERVAL = 15.0


class ProgressLine(Callback):
    """One line that is overwritten on a terminal, and written anew now and then elsewhere."""

    def __init__(self, stream: TextIO | None = None) -> None:
        """Write to a stream; without one to standard output."""
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
            write(self._stream, "\r" + line.ljust(self._width))
            self._width = len(line)
        elif time.monotonic() - self._last >= LOG_INTERVAL:
            write(self._stream, line + "\n")
            self._last = time.monotonic()

    def on_note(self, line: str) -> None:
        """A line that stays."""
        self.finish()
        write(self._stream, shown(line) + "\n")

    def on_end(self, run: Run) -> None:
        """Leave the place to what follows."""
        self.finish()

    def finish(self) -> None:
        """End the live line."""
        if self._live and self._width:
            write(self._stream, "\r" + " " * self._width + "\r")
            self._width = 0
