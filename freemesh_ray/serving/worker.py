"""A process that answers requests, one after another: ``python -m freemesh_ray.serving.worker DESCRIPTOR``.

Compiled code cannot be interrupted from within. Before each request the process therefore asks the operating system to
end it when the time is up, which works without any other process; its supervisor then starts another.
"""

from __future__ import annotations

import signal
import sys
import traceback
from collections.abc import Mapping
from http import HTTPStatus
from multiprocessing.connection import Connection

from envs.domains.load import load
from freemesh_ray.mesher import mesh_domain
from freemesh_ray.policies.policy import Policy
from freemesh_ray.serving.answer import Answer, MeshRequest, answer, refusal
from freemesh_ray.serving.limits import Limits

#: Meshed before the first request, so that everything is compiled.
WARM_UP = "D4"

#: What the process sends when it is ready for requests.
READY = "ready"


def serve(connection: Connection) -> None:
    """Receive the policies and the limits, then answer requests until the other end is closed."""
    policies, limits = connection.recv()
    for policy in policies.values():
        mesh_domain(policy, load(WARM_UP), best_of=2)
    connection.send(READY)
    while True:
        request = connection.recv()
        signal.setitimer(signal.ITIMER_REAL, limits.seconds)
        sent = safe(request, policies, limits)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        connection.send(sent)


def safe(request: MeshRequest, policies: Mapping[str, Policy], limits: Limits) -> Answer:
    """The answer, also when there is a mistake in the mesher: the log has its traceback, the client a line."""
    try:
        return answer(request, policies, limits)
    except Exception:
        traceback.print_exc()
        return refusal(HTTPStatus.INTERNAL_SERVER_ERROR, "the mesher failed; the server's log says how")


def main() -> None:
    """Serve the connection whose descriptor is the one argument."""
    # At Ctrl-C the supervisor closes the connection, which ends this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    try:
        serve(Connection(int(sys.argv[1])))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return


if __name__ == "__main__":
    main()
