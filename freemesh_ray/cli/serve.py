"""``freemesh serve``: meshing over HTTP."""

from __future__ import annotations

import argparse
import os
import signal
from typing import Any

from freemesh_ray.cli.arguments import add_command, add_policy, positive, seconds, whole
from freemesh_ray.formatting.terminal import say

#: The environment variable with the bearer token.
TOKEN = "FREEMESH_SERVE_TOKEN"

EPILOG = f"""\
examples:
  freemesh serve
  curl --data-binary @part.geojson 'http://127.0.0.1:8000/mesh?edge_length=0.1'
  curl --data-binary @part.geojson 'http://127.0.0.1:8000/mesh?edge_length=0.1&format=inp' -o part.inp

With {TOKEN} set, clients have to send the header Authorization: Bearer TOKEN; without it only 127.0.0.1 is
listened on. Every parameter, limit and status is in docs/serving.md. Ctrl-C stops it.
"""


def add(commands: Any) -> None:
    """Add the command to the grammar."""
    from freemesh_ray.serving.limits import Limits

    usual = Limits()
    serve = add_command(
        commands, "serve", "mesh over HTTP", "Answer GeoJSON polygons with meshes, by meshers on Ray.", EPILOG
    )
    serve.add_argument("--host", default="127.0.0.1", metavar="H", help="address to listen on (127.0.0.1)")
    serve.add_argument("--port", type=whole(1, 65535), default=8000, metavar="P", help="port to listen on (8000)")
    serve.add_argument("--replicas", type=whole(1, 256), default=1, metavar="N", help="meshes made at a time (1)")
    serve.add_argument("--allowed-hosts", type=_names, default=(), metavar="NAMES",
                       help="names of the server beside --host and localhost, with commas in between")  # fmt: skip
    add_policy(serve, "the shipped ones")
    limits = serve.add_argument_group("limits of a request")
    limits.add_argument("--max-body-mb", type=positive, default=usual.body_bytes / 1e6, metavar="MB",
                        help=f"size of a polygon ({usual.body_bytes / 1e6:g})")  # fmt: skip
    limits.add_argument("--max-vertices", type=whole(4, 1_000_000), default=usual.vertices, metavar="N",
                        help=f"vertices of a boundary, after --edge-length ({usual.vertices})")  # fmt: skip
    limits.add_argument("--max-elements", type=whole(1, 100_000_000), default=usual.elements, metavar="N",
                        help=f"expected elements of a mesh ({usual.elements})")  # fmt: skip
    limits.add_argument("--max-memory-gb", type=positive, default=usual.worker_bytes / 1e9, metavar="GB",
                        help=f"memory for a mesh ({usual.worker_bytes / 1e9:g})")  # fmt: skip
    limits.add_argument("--max-seconds", type=seconds, default=usual.seconds, metavar="S",
                        help=f"time of a mesh ({usual.seconds:g})")  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Serve until a signal comes.

    Raises:
        PolicyError: the policy file cannot be used.
        ServiceError: the service cannot be started, or not as it is asked for; or it cannot go on.
        KeyboardInterrupt: Ctrl-C.
    """
    from freemesh_ray.policies.policy import SHIPPED, Policy
    from freemesh_ray.serving.http_app import digest
    from freemesh_ray.serving.limits import Limits
    from freemesh_ray.serving.service import ServiceError, is_loopback, running_service

    files = {"given": options.policy} if options.policy else SHIPPED
    policies = {density: Policy.load(file) for density, file in files.items()}
    limits = Limits(
        body_bytes=int(options.max_body_mb * 1e6), vertices=options.max_vertices, elements=options.max_elements,
        worker_bytes=int(options.max_memory_gb * 1e9), seconds=options.max_seconds,
    )  # fmt: skip
    token = os.environ.get(TOKEN, "")
    before = signal.signal(signal.SIGTERM, _terminate)
    try:
        if not token and not is_loopback(options.host):
            raise ServiceError(f"--host {options.host}: anyone could mesh here: set {TOKEN}, or use 127.0.0.1")
        with running_service(
            policies, limits, host=options.host, port=options.port, replicas=options.replicas,
            token=digest(token) if token else None, hosts=options.allowed_hosts,
        ) as service:  # fmt: skip
            _tell(options, bool(token))
            service.wait()
    except _Terminated:
        pass
    finally:
        signal.signal(signal.SIGTERM, before)
    return 0


class _Terminated(BaseException):
    """SIGTERM came."""


def _terminate(number: int, frame: object) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise _Terminated


def _names(text: str) -> tuple[str, ...]:
    """Names between commas."""
    return tuple(filter(None, (name.strip() for name in text.split(","))))


def _tell(options: argparse.Namespace, guarded: bool) -> None:
    """Say where it is."""
    host = f"[{options.host}]" if ":" in options.host else options.host
    url = f"http://{host}:{options.port}"
    header = f'-H "Authorization: Bearer ${TOKEN}" ' if guarded else ""
    say(f"{url}  curl {header}--data-binary @part.geojson '{url}/mesh?edge_length=0.1'")
