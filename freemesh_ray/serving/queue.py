"""Who waits for a free mesher, and for how many there is room."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Generic, TypeVar

Place = TypeVar("Place")


class Busy(Exception):
    """There is no room for one more request."""


class Queue(Generic[Place]):
    """Free places, and those who wait for one, first come, first served; to be used in one event loop."""

    def __init__(self, waiting: int) -> None:
        """Begin without a place.

        Args:
            waiting: how many may wait.
        """
        self._most, self._free, self._waiting = waiting, deque[Place](), deque[asyncio.Future[Place]]()

    async def take(self) -> Place:
        """A place, as soon as there is one.

        Raises:
            Busy: too many wait already.
        """
        if self._free:
            return self._free.popleft()
        self._waiting = deque(one for one in self._waiting if not one.done())
        if len(self._waiting) >= self._most:
            raise Busy
        mine: asyncio.Future[Place] = asyncio.get_running_loop().create_future()
        self._waiting.append(mine)
        try:
            return await mine
        except asyncio.CancelledError:
            if mine.done() and not mine.cancelled():
                self.give(mine.result())
            raise

    def give(self, place: Place) -> None:
        """Here is a free place."""
        while self._waiting:
            if not (first := self._waiting.popleft()).done():
                first.set_result(place)
                return
        self._free.append(place)

    def discard(self, place: Place) -> None:
        """Forget a free place that is there no more."""
        if place in self._free:
            self._free.remove(place)
