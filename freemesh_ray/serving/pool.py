"""The meshers: so many actors of Ray, each replaced when it is gone or does not respond."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import ray
from ray.exceptions import RayError

from freemesh_ray.policies.policy import Policy
from freemesh_ray.serving.answer import Answer, MeshRequest
from freemesh_ray.serving.awake import Awake, awake_timeout
from freemesh_ray.serving.lanes import COSTLY, LANES, QUICK
from freemesh_ray.serving.limits import Limits
from freemesh_ray.serving.mesher_actor import Mesher
from freemesh_ray.serving.overruns import Overruns
from freemesh_ray.serving.queue import Busy, Queue

#: MesherPool that may die over one request before its client hears of it.
TRIES = 4

#: How often a mesher is asked whether it is alive, for how long its answer holds, and after how long without one it is
#: replaced, in seconds.
ASKED, HOLDS, SILENT = 0.4, 1.5, 10.0

#: Seconds that a mesher may need to start, kernels to compile included, and before the next is tried where it does not.
START, PAUSE = 300.0, 1.0

#: Seconds beside a mesh's own after which a mesher that does not answer is replaced.
SLACK = 10.0


class MesherLost(Exception):
    """A mesher that died, or does not respond."""


class _Running:
    """A mesher that has started."""

    def __init__(self, actor: Any) -> None:
        self.actor, self.heard = actor, time.monotonic()
        self.lost = asyncio.Event()

    def able(self) -> bool:
        """Whether it said of late that it can mesh."""
        return not self.lost.is_set() and time.monotonic() - self.heard < HOLDS


class MesherPool:
    """Keeps meshers and hands them requests; to be used in one event loop."""

    def __init__(
        self, policies: Mapping[str, Policy], limits: Limits, count: int, retried: Callable[[], None] = lambda: None
    ) -> None:
        """Describe them.

        Args:
            policies: by density.
            limits: of a request.
            count: of meshers.
            retried: called when a request goes to another mesher because one was lost.
        """
        self._policies, self._limits, self._count, self._retried = ray.put(dict(policies)), limits, count, retried
        self._class = ray.remote(num_cpus=1, max_restarts=0, max_task_retries=0)(Mesher)
        self._queues = {lane: Queue[_Running](limits.waiting) for lane in LANES}
        self._overruns = Overruns()
        self._running: set[_Running] = set()
        self._tasks: set[asyncio.Task[Any]] = set()
        self._without = Awake()

    async def start(self) -> None:
        """Start them all.

        Raises:
            MesherLost: one does not start.
        """
        for mesher in await asyncio.gather(*(self._started() for _ in range(self._count))):
            self._spawn(self._keep(mesher))

    def able(self) -> int:
        """How many can take a request."""
        return sum(mesher.able() for mesher in self._running)

    def seconds_without(self) -> float:
        """For how long none could take a request, as seen by those who ask this again and again."""
        if self.able():
            self._without.restart()
        return self._without.seconds()

    async def mesh(self, request: MeshRequest) -> Answer:
        """The answer to a request, from another mesher when one is lost.

        Raises:
            ShareTaken: the client's share of the queue is full.
            Busy: the queue is full, or the request waited in it for longer than a mesh may take.
        """
        lane = QUICK if len(request.body) <= self._limits.quick_bytes else COSTLY
        tries = TRIES
        try:
            async with awake_timeout(2.0 * self._limits.seconds):
                while tries:
                    mesher = await self._queues[lane].take(request.client)
                    asked = replace(request, doubtful=request.client in self._overruns)
                    try:
                        # It goes on when the client leaves, and the mesher is not free before.
                        answer = await asyncio.shield(self._spawn(self._answer(mesher, asked, lane)))
                    except MesherLost:
                        self._retried()
                        tries -= 1
                        continue
                    if answer is not None:
                        return answer
                    lane = COSTLY
        except TimeoutError:
            raise Busy from None
        raise Busy

    async def _answer(self, mesher: _Running, request: MeshRequest, lane: str) -> Answer | None:
        """The answer of one mesher, which then is free again."""
        asked = asyncio.ensure_future(_value(mesher.actor.answer.remote(request, lane)))
        lost = asyncio.ensure_future(mesher.lost.wait())
        try:
            async with awake_timeout(self._limits.seconds + SLACK):
                await asyncio.wait({asked, lost}, return_when=asyncio.FIRST_COMPLETED)
            if not asked.done():
                raise MesherLost
            answer: Answer | None
            answer, overran = asked.result()
        except (RayError, MesherLost, TimeoutError):
            mesher.lost.set()
            raise MesherLost from None
        finally:
            lost.cancel()
            asked.cancel()
        if overran:
            self._overruns.add(request.client)
        if not mesher.lost.is_set():
            self._queues[lane].give(mesher)
        return answer

    async def _keep(self, mesher: _Running) -> None:
        """Have a mesher, another one whenever it is lost."""
        while True:
            self._running.add(mesher)
            for lane in LANES:
                self._queues[lane].give(mesher)
            await self._until_lost(mesher)
            self._running.discard(mesher)
            for lane in LANES:
                self._queues[lane].discard(mesher)
            mesher = await self._another()

    async def _until_lost(self, mesher: _Running) -> None:
        """Ask a mesher whether it is alive for as long as it is."""
        try:
            while not mesher.lost.is_set():
                began = time.monotonic()
                async with awake_timeout(SILENT):
                    if await _value(mesher.actor.alive.remote()):
                        mesher.heard = began
                await asyncio.sleep(ASKED)
        except (RayError, TimeoutError):
            mesher.lost.set()
        _kill(mesher.actor)

    async def _another(self) -> _Running:
        while True:
            try:
                return await self._started()
            except MesherLost:
                await asyncio.sleep(PAUSE)

    async def _started(self) -> _Running:
        actor = self._class.remote(self._policies, self._limits)
        try:
            async with awake_timeout(START):
                await _value(actor.alive.remote())
        except (RayError, TimeoutError) as error:
            _kill(actor)
            raise MesherLost(str(error).strip().rpartition("\n")[2]) from None
        return _Running(actor)

    def _spawn(self, work: Any) -> asyncio.Task[Any]:
        """A task that is not forgotten; a failure that nobody waits for any more is."""
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._ended)
        return task

    def _ended(self, task: asyncio.Task[Any]) -> None:
        self._tasks.discard(task)
        if not task.cancelled():
            task.exception()


async def _value(reference: Any) -> Any:
    return await reference


def _kill(actor: Any) -> None:
    ray.kill(actor, no_restart=True)
