"""A mesher: the actor of Ray that has a worker for quick requests and one for costly ones."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor

from freemesh_ray.policies.policy import Policy
from freemesh_ray.serving.answer import Answer, MeshRequest
from freemesh_ray.serving.lanes import LANES
from freemesh_ray.serving.limits import Limits
from freemesh_ray.serving.supervisor import Supervisor


class Mesher:
    """Answers requests in processes of its own, one at a time in each lane."""

    def __init__(self, policies: Mapping[str, Policy], limits: Limits) -> None:
        """Start the workers and wait until their kernels are compiled.

        Args:
            policies: by density.
            limits: of a request.

        Raises:
            WorkerError: they do not start.
        """
        self._supervisors = {lane: Supervisor(policies, limits, lane) for lane in LANES}
        self._threads = {lane: ThreadPoolExecutor(1) for lane in LANES}
        for ready in [self._threads[lane].submit(self._supervisors[lane].start) for lane in LANES]:
            ready.result()

    async def process(self) -> int:
        """Its number."""
        return os.getpid()

    async def alive(self) -> bool:
        """Whether it has its workers; one that is missing is started."""
        missing = [lane for lane in LANES if not self._supervisors[lane].alive()]
        for lane in missing:
            self._threads[lane].submit(self._supervisors[lane].start)
        return not missing

    async def answer(self, request: MeshRequest, lane: str) -> tuple[Answer | None, bool]:
        """Mesh what is asked for; where its client has left, this goes on to its end or until its time is up.

        Returns:
            None for a request that is too costly for the quick lane; and whether it looked quick and took too
            long.

        Raises:
            WorkerError: there is no worker and none can be started.
        """
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._threads[lane], self._answer, request, lane)

    def _answer(self, request: MeshRequest, lane: str) -> tuple[Answer | None, bool]:
        """In the lane's thread."""
        supervisor = self._supervisors[lane]
        return supervisor.answer(request), supervisor.overran
