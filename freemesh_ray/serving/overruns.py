"""Clients whose requests looked quick and were not."""

from __future__ import annotations

from time import monotonic

#: Seconds for which that is remembered.
REMEMBERED = 30.0


class Overruns:
    """When it was last so, by client; each has cost a second of a worker, so that there are never many."""

    def __init__(self) -> None:
        self._until: dict[str, float] = {}

    def add(self, client: str) -> None:
        """A request of a client took too long for a quick one."""
        now = monotonic()
        self._until = {one: until for one, until in self._until.items() if until > now} | {client: now + REMEMBERED}

    def __contains__(self, client: str) -> bool:
        return self._until.get(client, 0.0) > monotonic()
