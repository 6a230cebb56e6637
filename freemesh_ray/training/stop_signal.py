"""Ctrl-C, a scheduler's SIGTERM, or a terminal that is closed, to a command that has something to save."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any, Self

#: Seconds after a signal until the work is to stop at the next place where it can be gone on from, and until the
#: process ends whatever it does: schedulers kill it after ten.
URGENT_SECONDS, LAST_SECONDS = 3.0, 7.0


class StopSignal:
    """A signal is remembered in the block, so that the work stops where nothing is lost.

    A second one interrupts at once. Work that does not ask whether there was one is ended; what is saved then may take
    its time. To be entered after Ray is started, which sets a handler of its own.
    """

    def __init__(self, end: Callable[[], None]) -> None:
        """Describe it.

        Args:
            end: ends the process, from whatever thread.
        """
        self._end = end
        self._given_at: float | None = None
        self._timer: threading.Timer | None = None

    def __enter__(self) -> Self:
        self._before: dict[int, Any] = {}
        if threading.current_thread() is not threading.main_thread():
            return self  # signals are the main thread's
        numbers = [signal.SIGINT, signal.SIGTERM]
        if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:  # as `nohup` leaves it
            numbers.append(signal.SIGHUP)
        self._before = {number: signal.signal(number, self._remember) for number in numbers}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        if self._given_at is not None:
            self._arm()  # what follows is to be quick, too

    def was_given(self) -> bool:
        """Whether to stop; who asks does so when told, and takes the time that it needs."""
        if self._given_at is None:
            return False
        self._disarm()
        return True

    def is_urgent(self) -> bool:
        """Whether to stop before the work at hand is done."""
        return self._given_at is not None and time.monotonic() - self._given_at > URGENT_SECONDS

    def _remember(self, number: int, frame: FrameType | None) -> None:
        self._arm()
        if self._given_at is not None:
            raise KeyboardInterrupt
        self._given_at = time.monotonic()

    def _arm(self) -> None:
        self._disarm()
        self._timer = threading.Timer(LAST_SECONDS, self._end)
        self._timer.daemon = True
        self._timer.start()

    def _disarm(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
