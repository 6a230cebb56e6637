"""Deadlines that count only while the process that set them could run.

A machine that slept, or processes that were all stopped and let go on, find every deadline passed, and nobody had the
time to keep one. So whoever waits looks at the time again and again, and of the time between two looks only so much
counts.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Final

#: Seconds between two looks, and how many count between two of them at most.
LOOK: Final = 1.0
MOST: Final = 3.0


class Awake:
    """A clock that stands still while its process does; to be looked at every `LOOK` seconds."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Begin anew."""
        self._looked, self._seconds, self.asleep = time.monotonic(), 0.0, 0.0

    def seconds(self) -> float:
        """Seconds from its beginning, those left out that its process was asleep."""
        now = time.monotonic()
        passed, self._looked = now - self._looked, now
        counted = min(passed, MOST)
        self._seconds += counted
        self.asleep += passed - counted
        return self._seconds


@asynccontextmanager
async def awake_timeout(seconds: float) -> AsyncIterator[None]:
    """As ``asyncio.timeout``, but of seconds that this process is awake.

    Raises:
        TimeoutError: the block has not ended in time.
    """
    async with asyncio.timeout(None) as limit:
        expiring = asyncio.ensure_future(_expire(limit, seconds))
        try:
            yield
        finally:
            expiring.cancel()


async def _expire(limit: asyncio.Timeout, seconds: float) -> None:
    clock = Awake()
    while (left := seconds - clock.seconds()) > 0.0:
        await asyncio.sleep(min(LOOK, left))
    limit.reschedule(0.0)
