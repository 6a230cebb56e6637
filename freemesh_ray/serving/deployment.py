"""The application on Ray Serve: one surface, meshers behind it."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from ray import serve
from ray.exceptions import RayActorError
from ray.serve.config import RequestRouterConfig
from ray.serve.exceptions import BackPressureError
from starlette.types import ASGIApp

from freemesh_ray.policies.policy import Policy
from freemesh_ray.serving.answer import Answer, Job
from freemesh_ray.serving.counters import Counters
from freemesh_ray.serving.http_app import Busy, surface
from freemesh_ray.serving.limits import Limits
from freemesh_ray.serving.loopback import listen_on_loopback
from freemesh_ray.serving.supervisor import WorkerError, WorkerOwner

#: Jobs that a mesher has: one at work, one at hand, so that it need not wait for the next.
JOBS = 2

#: Requests that the surface takes at a time, those for health and metrics included.
REQUESTS = 1000

#: Further ones that the proxy keeps for it.
QUEUED = 100

#: Meshers that a job may lose before its client hears of it.
TRIES = 4

#: How often Serve asks a replica whether it is well, and how long it waits for the answer, in seconds.
ASKED_EVERY, ANSWERED_WITHIN = 1.0, 10.0

#: How often a replica that is to stop looks whether it still has requests, in seconds.
LOOKED_EVERY = 0.2

#: How soon Serve looks again for a mesher with room, in seconds: first, and at most.
SOON, AT_MOST = 0.005, 0.02


class Mesher:
    """Does jobs in a worker process of its own, one after another."""

    def __init__(self, policies: Mapping[str, Policy], limits: Limits, loopback: bool) -> None:
        """Start the worker; ready when it is warm.

        Args:
            policies: by density.
            limits: see there.
            loopback: whether to listen on the loopback device alone.
        """
        self._owner, self._thread = WorkerOwner(policies, limits), ThreadPoolExecutor(1)
        self._lost: WorkerError | None = None
        if loopback:
            listen_on_loopback()
        self._owner.start()

    async def do(self, job: Job) -> Answer:
        """The job's answer; a job whose client left is done all the same, or ended when its time is up.

        Raises:
            WorkerError: there is no worker and none can be started; this mesher is then replaced.
        """
        return await asyncio.get_running_loop().run_in_executor(self._thread, self._done, job)

    def _done(self, job: Job) -> Answer:
        try:
            answer = self._owner.do(job)
            # Where the worker was ended, the next job finds another one warm.
            self._thread.submit(self._owner.start)
        except WorkerError as error:
            self._lost = error
            raise
        return answer

    async def check_health(self) -> None:
        """Serve replaces a mesher that has no worker and gets none."""
        if self._lost is not None:
            raise self._lost

    def __del__(self) -> None:
        self._owner.stop()


class Surface:
    """The HTTP surface."""

    def __init__(self, mesher: Any, densities: list[str], limits: Limits, token: bytes | None, loopback: bool) -> None:
        """See surface.surface.

        Args:
            mesher: Serve's handle of the meshers.
            densities, limits, token: as there.
            loopback: as for the meshers.
        """
        if loopback:
            listen_on_loopback()
        self._mesher, self._densities, self._limits, self._token = mesher, densities, limits, token
        self._counters = Counters()

    def __serve_build_asgi_app__(self) -> ASGIApp:
        return surface(
            self._mesh,
            self._running,
            densities=self._densities,
            limits=self._limits,
            token=self._token,
            counters=self._counters,
        )

    async def _mesh(self, job: Job) -> Answer:
        """The job's answer, from another mesher when one dies.

        Raises:
            Busy: the queue is full, or the job waited in it for longer than a job may take.
        """
        try:
            async with asyncio.timeout(2.0 * self._limits.seconds):
                for _ in range(TRIES):
                    try:
                        return await self._mesher.do.remote(job)
                    except (RayActorError, WorkerError):
                        self._counters.retried()
        except (BackPressureError, TimeoutError):
            raise Busy from None
        raise Busy

    async def _running(self) -> int:
        """How many meshers run, as Serve's controller knows it."""
        status = await asyncio.to_thread(serve.status)
        application = status.applications[serve.get_replica_context().app_name]
        return application.deployments[self._mesher.deployment_name].replica_states.get("RUNNING", 0)


def application(
    policies: Mapping[str, Policy], limits: Limits, *, replicas: int, token: bytes | None, loopback: bool
) -> Any:
    """The application that Serve runs.

    Args:
        policies: by density.
        limits: see there.
        replicas: meshers.
        token: digest of the bearer token that is asked for, or None.
        loopback: whether to listen on the loopback device alone, as far as this is up to replicas.
    """
    meshers = serve.deployment(
        Mesher,
        num_replicas=replicas,
        max_ongoing_requests=JOBS,
        max_queued_requests=limits.waiting,
        health_check_period_s=ASKED_EVERY,
        health_check_timeout_s=ANSWERED_WITHIN,
        graceful_shutdown_timeout_s=limits.seconds,
        graceful_shutdown_wait_loop_s=LOOKED_EVERY,
        ray_actor_options={"num_cpus": 1},
        request_router_config=RequestRouterConfig(initial_backoff_s=SOON, max_backoff_s=AT_MOST),
    )
    front = serve.deployment(
        serve.ingress()(Surface),
        max_ongoing_requests=REQUESTS,
        max_queued_requests=QUEUED,
        health_check_period_s=ASKED_EVERY,
        health_check_timeout_s=ANSWERED_WITHIN,
        graceful_shutdown_wait_loop_s=LOOKED_EVERY,
        ray_actor_options={"num_cpus": 0},
    )
    return front.bind(meshers.bind(policies, limits, loopback), sorted(policies), limits, token, loopback)
