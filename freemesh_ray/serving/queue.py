"""Who waits for a free mesher, and for how many there is room: for one client half as many as for all."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Generic, TypeVar

Place = TypeVar("Place")


class Busy(Exception):
    """There is no room for one more request."""


class ShareTaken(Busy):
    """There is none for one more request of this client."""


class Queue(Generic[Place]):
    """Free places, and those who wait for one, first come, first served; to be used in one event loop."""

    def __init__(self, waiting: int) -> None:
        """Begin without a place.

        Args:
            waiting: how many may wait; of one client half of them.
        """
        self._most, self._free = waiting, deque[Place]()
        self._waiting = deque[tuple[str, asyncio.Future[Place]]]()

    async def take(self, client: str) -> Place:
        """A place, as soon as there is one.

        Args:
            client: who waits.

        Raises:
            ShareTaken: too many of this client wait already.
            Busy: too many do.
        """
        if self._free:
            return self._free.popleft()
        self._waiting = deque((whose, one) for whose, one in self._waiting if not one.done())
        if len(self._waiting) >= self._most:
            raise Busy
        if sum(whose == client for whose, _ in self._waiting) >= max(self._most // 2, 1):
            raise ShareTaken
        mine: asyncio.Future[Place] = asyncio.get_running_loop().create_future()
        self._waiting.append((client, mine))
        try:
            return await mine
        except asyncio.CancelledError:
            if mine.done() and not mine.cancelled():
                self.give(mine.result())
            raise

    def give(self, place: Place) -> None:
        """Here is a free place."""
        while self._waiting:
            if not (first := self._waiting.popleft()[1]).done():
                first.set_result(place)
                return
        self._free.append(place)

    def discard(self, place: Place) -> None:
        """Forget a free place that is there no more."""
        if place in self._free:
            self._free.remove(place)
