"""What is to be served, and what may keep it from that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from envs.errors import FAILED, UserError
from freemesh_ray.policies.policy import Policy
from freemesh_ray.serving.limits import Limits


class ServiceError(UserError, RuntimeError):
    """A service that cannot be started; one line with what is wrong and the fix."""


class ServiceEnded(ServiceError):
    """A service that cannot go on."""

    exit_code = FAILED


@dataclass(frozen=True)
class Order:
    """What to serve, and where.

    Attributes:
        policies: by density.
        limits: of a request.
        host, port: to listen on.
        replicas: meshers.
        token: digest of the bearer token that is asked for, or None.
        hosts: names that the server goes by beside ``host`` and those of this machine; their pages may use it.
    """

    policies: Mapping[str, Policy]
    limits: Limits
    host: str
    port: int
    replicas: int
    token: bytes | None
    hosts: tuple[str, ...]
