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
        commands, "serve", "mesh over HTTP", "Answer GeoJSON polygons with meshes, on Ray Serve.", EPILOG
    )
    serve.add_argument("--host", default="127.0.0.1", metavar="H", help="address to listen on (127.0.0.1)")
    serve.add_argument("--port", type=whole(1, 65535), default=8000, metavar="P", help="port to listen on (8000)")
    serve.add_argument("--replicas", type=whole(1, 256), default=1, metavar="N", help="meshes made at a time (1)")
    add_policy(serve, "the shipped ones")
    limits = serve.add_argument_group("limits of a request")
    limits.add_argument("--max-body-mb", type=positive, default=usual.body_bytes / 1e6, metavar="MB",
                        help=f"size of a polygon ({usual.body_bytes / 1e6:g})")  # fmt: skip
    limits.add_argument("--max-vertices", type=whole(4, 1_000_000), default=usual.vertices, metavar="N",
                        help=f"vertices of a boundary, after --edge-length ({usual.vertices})")  # fmt: skip
    limits.add_argument("--max-seconds", type=seconds, default=usual.seconds, metavar="S",
                        help=f"time of a mesh ({usual.seconds:g})")  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Serve until a signal comes.

    Raises:
        PolicyError: the policy file cannot be used.
        ServiceError: the service cannot be started, or not as it is asked for.
        KeyboardInterrupt: Ctrl-C.
    """
    from freemesh_ray.policies.policy import SHIPPED, Policy
    from freemesh_ray.serving.http_app import digest
    from freemesh_ray.serving.limits import Limits
    from freemesh_ray.serving.service import ServiceError, is_loopback, running_service

    files = {"given": options.policy} if options.policy else SHIPPED
    policies = {density: Policy.load(file) for density, file in files.items()}
    limits = Limits(
        body_bytes=int(options.max_body_mb * 1e6), vertices=options.max_vertices, seconds=options.max_seconds
    )
    token = os.environ.get(TOKEN, "")
    try:
        if not token and not is_loopback(options.host):
            raise ServiceError(f"--host {options.host}: anyone could mesh here: set {TOKEN}, or use 127.0.0.1")
        with running_service(
            policies, limits, host=options.host, port=options.port, replicas=options.replicas,
            token=digest(token) if token else None,
        ):  # fmt: skip
            _wait(options, bool(token))
    except SystemExit:
        pass  # SIGTERM: a handler of ours, or of Ray's while it starts
    return 0


def _terminate(number: int, frame: object) -> None:
    raise SystemExit


def _wait(options: argparse.Namespace, guarded: bool) -> None:
    """Say where it is, and wait for a signal."""
    host = f"[{options.host}]" if ":" in options.host else options.host
    url = f"http://{host}:{options.port}"
    header = f'-H "Authorization: Bearer ${TOKEN}" ' if guarded else ""
    say(f"{url}  curl {header}--data-binary @part.geojson '{url}/mesh?edge_length=0.1'")
    # Ray has a handler of its own, which would tell of a failure.
    signal.signal(signal.SIGTERM, _terminate)
    while True:
        signal.pause()
