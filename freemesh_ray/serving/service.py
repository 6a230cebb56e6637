"""Starting and stopping the service, on a Ray of its own or on the one that RAY_ADDRESS names."""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from ipaddress import ip_address

from envs.errors import UserError
from freemesh_ray.local_ray import local_ray
from freemesh_ray.policies.policy import Policy
from freemesh_ray.serving.limits import Limits

#: What Serve calls the application.
NAME = "freemesh"


class ServiceError(UserError, RuntimeError):
    """A service that cannot be started; one line with what is wrong and the fix."""


def is_loopback(host: str) -> bool:
    """Whether no other machine can reach a host's name or address."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def check_free(host: str, port: int) -> None:
    """Refuse an address that cannot be listened on, before anything is started.

    Raises:
        ServiceError: the port is taken, or the host is not this machine.
    """
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
        # As Serve does: what has just been closed is free.
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        raise ServiceError(
            f"{host}:{port}: cannot be listened on ({error.strerror}): choose another --host or --port"
        ) from None


@contextmanager
def running_service(
    policies: Mapping[str, Policy],
    limits: Limits,
    *,
    host: str = "127.0.0.1",
    port: int = 8000,
    replicas: int = 1,
    token: bytes | None = None,
) -> Iterator[None]:
    """A service that answers while the block runs.

    Args:
        policies: by density.
        limits: of a request.
        host, port: to listen on.
        replicas: polygons that are meshed at a time.
        token: digest of the bearer token that is asked for, or None.

    Raises:
        ServiceError: the port is taken, the cluster serves something already, or the meshers do not start.
    """
    own = not os.environ.get("RAY_ADDRESS")
    if own:
        check_free(host, port)
    os.environ.setdefault("RAY_SERVE_LOG_TO_STDERR", "0")
    with local_ray(replicas):
        from ray import serve
        from ray.exceptions import RayError
        from ray.serve.exceptions import RayServeException
        from ray.serve.schema import LoggingConfig

        from freemesh_ray.serving.deployment import application

        if not own and serve.status().proxies:
            raise ServiceError("the cluster of RAY_ADDRESS serves something already: stop that, or use another one")
        quiet = LoggingConfig(log_level="ERROR", enable_access_log=False)
        logging.getLogger("ray.serve").setLevel(logging.ERROR)
        try:
            try:
                serve.start(proxy_location="HeadOnly", http_options={"host": host, "port": port}, logging_config=quiet)
                app = application(policies, limits, replicas=replicas, token=token, loopback=own)
                serve.run(app, name=NAME, logging_config=quiet)
            except (RuntimeError, RayServeException, RayError) as error:
                line = str(error).partition("\n")[0]
                raise ServiceError(f"the service did not start ({line}): Ray's logs say why") from error
            yield
        finally:
            # What is being meshed is finished. A Ray of our own takes Serve along when it ends.
            serve.delete(NAME)
            if not own:
                serve.shutdown()
