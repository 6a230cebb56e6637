"""The process that serves: ``python -m freemesh_ray.serving.http_process DESCRIPTOR``.

It is the driver of Ray, has the meshers there, and answers HTTP itself. Whoever started it is at the other end of a
connection, gets a sign of life every second, and is watched in turn.
"""

from __future__ import annotations

import asyncio
import logging
import os
import select
import signal
import sys
import threading
from contextlib import nullcontext, suppress
from functools import partial
from multiprocessing.connection import Connection as Pipe
from typing import TYPE_CHECKING, Any

import uvicorn

from envs.errors import FAILED, UserError
from freemesh_ray.formatting.terminal import note
from freemesh_ray.local_ray import Session, local_ray
from freemesh_ray.local_ray.processes import STOPPED, process
from freemesh_ray.serving.connections import BACKLOG, Connection, Connections, affordable
from freemesh_ray.serving.counters import Counters
from freemesh_ray.serving.http_app import asgi_app
from freemesh_ray.serving.order import Order, ServiceError

if TYPE_CHECKING:
    from freemesh_ray.serving.pool import MesherPool

#: Seconds between two looks at the meshers and at the parent, and after which a service without a mesher ends.
LOOK, WITHOUT = 0.5, 60.0

#: Seconds for what is being meshed when the service is to end.
GRACE = 4


class _Server(uvicorn.Server):
    """uvicorn, with the signals left alone."""

    def capture_signals(self) -> Any:
        return nullcontext()


def serve(order: Order, parent: Pipe, watch: _Watch) -> None:
    """Serve until SIGTERM.

    Args:
        order: what to serve.
        parent: is sent None when it serves, and again and again as a sign of life.
        watch: is told of Ray.

    Raises:
        UserError: it does not start.
    """
    # A worker of Ray gives way to everything else by default; here it is what the machine is for.
    os.environ.setdefault("RAY_worker_niceness", "0")
    with local_ray(order.replicas, supervised=True) as session:
        watch.ray = session
        _keep_ray_quiet()
        asyncio.run(_serve(order, parent, session))


def _keep_ray_quiet() -> None:
    """Keep to the log what Ray's processes say of each other: how a service ends is told in one line."""
    from ray._private import worker

    worker.print_to_stdstream = lambda *_, **__: None  # type: ignore[assignment]


async def _serve(order: Order, parent: Pipe, session: Session) -> None:
    # Ray is imported when its environment is set.
    from freemesh_ray.serving.pool import MesherLost, MesherPool

    loop, counters = asyncio.get_running_loop(), Counters()
    meshers = MesherPool(order.policies, order.limits, order.replicas, counters.retried)
    ending = asyncio.Event()
    loop.add_signal_handler(signal.SIGTERM, ending.set)
    starting = asyncio.ensure_future(meshers.start())
    stopped = asyncio.ensure_future(ending.wait())
    await asyncio.wait({starting, stopped}, return_when=asyncio.FIRST_COMPLETED)
    if ending.is_set():
        return
    try:
        starting.result()
    except MesherLost as error:
        raise ServiceError(f"the service did not start ({error}): Ray's logs say why") from error
    server = _server(order, meshers, counters)
    listening = asyncio.ensure_future(server.serve())
    try:
        while not server.started:
            if listening.done():
                raise ServiceError(f"{order.host}:{order.port}: cannot be listened on: choose another --host or --port")
            await asyncio.sleep(0.02)
        while not ending.is_set() and not listening.done():
            _sign_of_life(parent)
            if meshers.seconds_without() > WITHOUT:
                session.end(f"no mesher could be started for {WITHOUT:g} s: start it again", FAILED)
            with suppress(TimeoutError):
                await asyncio.wait_for(ending.wait(), LOOK)
    finally:
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)  # it tells of requests that it does not wait for
        server.should_exit = True
        with suppress(SystemExit, asyncio.CancelledError):
            await listening


def _server(order: Order, meshers: MesherPool, counters: Counters) -> _Server:
    limits = order.limits
    app = asgi_app(
        meshers.mesh, meshers.able, densities=sorted(order.policies), limits=limits, token=order.token,
        counters=counters, hosts=[order.host], pages=order.hosts,
    )  # fmt: skip
    connections = Connections(affordable(limits.connections), counters.cut)
    logging.getLogger("uvicorn.error").setLevel(logging.ERROR)
    logging.getLogger("asyncio").setLevel(logging.CRITICAL)
    return _Server(
        uvicorn.Config(
            app, host=order.host, port=order.port, loop="asyncio", lifespan="off", ws="none", log_config=None,
            access_log=False, proxy_headers=False, server_header=False, backlog=BACKLOG,
            timeout_keep_alive=limits.idle_seconds, timeout_graceful_shutdown=GRACE,
            http=partial(Connection, limits=limits, connections=connections),  # type: ignore[arg-type]
        )
    )  # fmt: skip


def _sign_of_life(parent: Pipe) -> None:
    """Tell the parent that this loop turns; a parent that does not read is not waited for."""
    if select.select([], [parent], [], 0.0)[1]:
        with suppress(OSError):
            parent.send(None)


class _Watch(threading.Thread):
    """Wakes the parent where it is stopped; ends everything when it is gone."""

    def __init__(self, parent: Pipe) -> None:
        super().__init__(name="watch of the command", daemon=True)
        self.ray: Session | None = None
        self._parent, self._process = parent, process(os.getppid())

    def run(self) -> None:
        # It sends nothing: what can be read is the end.
        while not select.select([self._parent], [], [], LOOK)[0]:
            if self._process is not None and self._process.state == STOPPED:
                self._process.send(signal.SIGCONT)
        line = "the command was killed, and so is the service"
        if self.ray is not None:
            # Its guard ends all that it has started.
            self.ray.end(line, FAILED)
        note(f"freemesh: {line}")
        os._exit(FAILED)


def main() -> None:
    """Serve what the parent orders, at the other end of the connection whose descriptor is the one argument."""
    # Who presses Ctrl-C interrupts the parent, which then ends this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with Pipe(int(sys.argv[1])) as parent:
        order = parent.recv()
        watch = _Watch(parent)
        watch.start()
        try:
            serve(order, parent, watch)
        except UserError as error:
            with suppress(OSError):
                parent.send(error)
            sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
