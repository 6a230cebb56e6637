"""The application on Ray Serve: one ingress, meshers behind it."""

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
from freemesh_ray.serving.answer import Answer, MeshRequest
from freemesh_ray.serving.counters import Counters
from freemesh_ray.serving.http_app import Busy, asgi_app
from freemesh_ray.serving.limits import Limits
from freemesh_ray.serving.loopback import listen_on_loopback
from freemesh_ray.serving.supervisor import Supervisor, WorkerError

#: Requests that a mesher holds: one at work, one ready, so that it need not wait for the next.
MESHER_REQUESTS = 2

#: Requests that the ingress takes at a time, those for health and metrics included, and that the proxy queues for it.
INGRESS_REQUESTS, INGRESS_QUEUE = 1000, 100

#: Meshers that may die over one request before its client hears of it.
TRIES = 4

#: Serve's health checks of a replica: how often, and how long the answer may take, in seconds.
HEALTH_PERIOD, HEALTH_TIMEOUT = 1.0, 10.0

#: How often a replica that is to stop checks whether it still has requests, in seconds.
SHUTDOWN_CHECK = 0.2

#: How soon Serve looks again for a mesher with room, in seconds: at first, and at most.
BACKOFF, LONGEST_BACKOFF = 0.005, 0.02


class Mesher:
    """Answers requests in a worker process of its own, one after another."""

    def __init__(self, policies: Mapping[str, Policy], limits: Limits, loopback: bool) -> None:
        """Start the worker and wait until its kernels are compiled.

        Args:
            policies: by density.
            limits: of a request.
            loopback: whether to listen on the loopback device alone.
        """
        self._supervisor, self._thread = Supervisor(policies, limits), ThreadPoolExecutor(1)
        self._lost: WorkerError | None = None
        if loopback:
            listen_on_loopback()
        self._supervisor.start()

    async def answer(self, request: MeshRequest) -> Answer:
        """Mesh what is asked for; where its client has left, this goes on to its end or until its time is up.

        Raises:
            WorkerError: there is no worker and none can be started; this mesher is then replaced.
        """
        return await asyncio.get_running_loop().run_in_executor(self._thread, self._answered, request)

    def _answered(self, request: MeshRequest) -> Answer:
        try:
            answer = self._supervisor.answer(request)
            # Where the worker was ended, the next request finds another one ready.
            self._thread.submit(self._supervisor.start)
        except WorkerError as error:
            self._lost = error
            raise
        return answer

    async def check_health(self) -> None:
        """Serve replaces a mesher that has no worker and gets none."""
        if self._lost is not None:
            raise self._lost

    def __del__(self) -> None:
        self._supervisor.stop()


class Ingress:
    """The HTTP app as a replica of Serve."""

    def __init__(self, mesher: Any, densities: list[str], limits: Limits, token: bytes | None, loopback: bool) -> None:
        """Describe the app.

        Args:
            mesher: Serve's handle of the meshers.
            densities, limits, token: see `http_app.asgi_app`.
            loopback: as for the meshers.
        """
        if loopback:
            listen_on_loopback()
        self._mesher, self._densities, self._limits, self._token = mesher, densities, limits, token
        self._counters = Counters()

    def __serve_build_asgi_app__(self) -> ASGIApp:
        return asgi_app(
            self._mesh,
            self._running,
            densities=self._densities,
            limits=self._limits,
            token=self._token,
            counters=self._counters,
        )

    async def _mesh(self, request: MeshRequest) -> Answer:
        """The answer to a request, from another mesher when one dies.

        Raises:
            Busy: the queue is full, or the request waited in it for longer than a mesh may take.
        """
        try:
            async with asyncio.timeout(2.0 * self._limits.seconds):
                for _ in range(TRIES):
                    try:
                        return await self._mesher.answer.remote(request)
                    except (RayActorError, WorkerError):
                        self._counters.retried()
        except (BackPressureError, TimeoutError):
            raise Busy from None
        raise Busy

    async def _running(self) -> int:
        """How many meshers run, as Serve's controller knows."""
        status = await asyncio.to_thread(serve.status)
        application = status.applications[serve.get_replica_context().app_name]
        return application.deployments[self._mesher.deployment_name].replica_states.get("RUNNING", 0)


def application(
    policies: Mapping[str, Policy], limits: Limits, *, replicas: int, token: bytes | None, loopback: bool
) -> Any:
    """The application that Serve runs.

    Args:
        policies: by density.
        limits: of a request.
        replicas: how many meshers.
        token: digest of the bearer token that is asked for, or None.
        loopback: whether to listen on the loopback device alone, as far as this is up to replicas.
    """
    meshers = serve.deployment(
        Mesher,
        num_replicas=replicas,
        max_ongoing_requests=MESHER_REQUESTS,
        max_queued_requests=limits.waiting,
        health_check_period_s=HEALTH_PERIOD,
        health_check_timeout_s=HEALTH_TIMEOUT,
        graceful_shutdown_timeout_s=limits.seconds,
        graceful_shutdown_wait_loop_s=SHUTDOWN_CHECK,
        ray_actor_options={"num_cpus": 1},
        request_router_config=RequestRouterConfig(initial_backoff_s=BACKOFF, max_backoff_s=LONGEST_BACKOFF),
    )
    ingress = serve.deployment(
        serve.ingress()(Ingress),
        max_ongoing_requests=INGRESS_REQUESTS,
        max_queued_requests=INGRESS_QUEUE,
        health_check_period_s=HEALTH_PERIOD,
        health_check_timeout_s=HEALTH_TIMEOUT,
        graceful_shutdown_wait_loop_s=SHUTDOWN_CHECK,
        ray_actor_options={"num_cpus": 0},
    )
    return ingress.bind(meshers.bind(policies, limits, loopback), sorted(policies), limits, token, loopback)
