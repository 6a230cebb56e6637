"""The line that compiling shows."""

from __future__ import annotations

from typing import TextIO

from freemesh_ray.formatting.terminal import write


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
