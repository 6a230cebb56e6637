"""A process that does jobs, one after another: ``python -m freemesh_ray.serving.worker DESCRIPTOR``.

Compiled code cannot be interrupted from within. Before each job the process therefore asks the operating system to end
it when the time is up, whoever else is still alive by then; its owner starts another.
"""

from __future__ import annotations

import signal
import sys
import traceback
from collections.abc import Mapping
from http import HTTPStatus
from multiprocessing.connection import Connection

from envs.domains.load import load
from freemesh_ray.mesher import make
from freemesh_ray.policies.policy import Policy
from freemesh_ray.serving.answer import Answer, Job, answer, refusal
from freemesh_ray.serving.limits import Limits

#: Meshed before the first job, so that everything is compiled.
WARM_UP = "D4"

#: What the process says when it is ready for jobs.
READY = "ready"


def serve(connection: Connection) -> None:
    """Take the policies and the limits, then jobs, until the other end is closed."""
    policies, limits = connection.recv()
    for policy in policies.values():
        make(policy, load(WARM_UP), best_of=2)
    connection.send(READY)
    while True:
        job = connection.recv()
        signal.setitimer(signal.ITIMER_REAL, limits.seconds)
        done = safe(job, policies, limits)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        connection.send(done)


def safe(job: Job, policies: Mapping[str, Policy], limits: Limits) -> Answer:
    """The job's answer, also when there is a mistake in the mesher: that is told to the log, not to the client."""
    try:
        return answer(job, policies, limits)
    except Exception:
        traceback.print_exc()
        return refusal(HTTPStatus.INTERNAL_SERVER_ERROR, "the mesher failed; the server's log says how")


def main() -> None:
    """Serve the connection whose descriptor is the one argument."""
    # Ctrl-C is the owner's affair, which then closes the connection.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    try:
        serve(Connection(int(sys.argv[1])))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return


if __name__ == "__main__":
    main()
