"""The processes that answer requests: ``python -m freemesh_ray.serving.worker DESCRIPTOR FOLDER``.

The process itself answers none. It loads policies and kernels, then forks a worker, which begins at once, and another
when that one is gone: each has a connection of its own, which the supervisor is sent with how the one before ended.
Their temporary files lie in a folder of this process's, where nothing stays of a worker that is gone.

Compiled code cannot be interrupted from within. Before each request a worker therefore asks the operating system to
end it when the time is up, which works without any other process. Its address space is limited, too.
"""

from __future__ import annotations

import ctypes
import os
import resource
import select
import shutil
import signal
import socket
import sys
import tempfile
import time
import traceback
from collections.abc import Mapping
from http import HTTPStatus
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

from envs.domains.load import load
from freemesh_ray.mesher import mesh_domain
from freemesh_ray.policies.policy import Policy
from freemesh_ray.serving.answer import Answer, MeshRequest, answer, refusal
from freemesh_ray.serving.expected_time import stuck_seconds
from freemesh_ray.serving.lanes import NICENESS, QUICK
from freemesh_ray.serving.limits import Limits

#: Meshed before the first request, so that everything is compiled.
WARM_UP = "D4"

#: Seconds between two forks: a worker that ends at once shall not keep a core busy.
PAUSE = 0.05

#: prctl(2): the signal that a process gets when its parent ends.
PR_SET_PDEATHSIG = 1


def keep_a_worker(control: socket.socket, folder: Path) -> None:
    """Fork workers, one at a time, until the other end of ``control`` is closed.

    Args:
        control: to the supervisor, which first sends policies, limits and lane.
        folder: of their temporary files.
    """
    policies, limits, lane = Connection(os.dup(control.fileno())).recv()
    for policy in policies.values():
        mesh_domain(policy, load(WARM_UP), best_of=2)
    stuck_seconds(load(WARM_UP))  # imports what no request is to wait for
    tempfile.tempdir = str(folder)
    limit_memory(limits.worker_bytes)
    os.nice(NICENESS[lane])
    woken, waker = os.pipe()
    os.set_blocking(waker, False)
    signal.set_wakeup_fd(waker)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    ended = 0
    while True:
        empty(folder)
        pid = fork(control, ended, policies, limits, lane)
        while (status := status_of(pid, control, woken)) is not None and os.WIFSTOPPED(status):
            os.kill(pid, signal.SIGKILL)
        if status is None:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            return
        ended = os.waitstatus_to_exitcode(status)
        time.sleep(PAUSE)


def fork(control: socket.socket, ended: int, policies: Mapping[str, Policy], limits: Limits, lane: str) -> int:
    """Start a worker; the other end of its connection goes to the supervisor, with how the one before ended."""
    mine, theirs = Pipe()
    if pid := os.fork():
        theirs.close()
        with mine:
            socket.send_fds(control, [ended.to_bytes(4, "big", signed=True)], [mine.fileno()])
        return pid
    status = 1
    try:
        end_with_the_parent()
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        control.close()
        mine.close()
        serve(theirs, policies, limits, lane)
    except (EOFError, ConnectionError):
        status = 0
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(status)


def empty(folder: Path) -> None:
    """Remove the temporary files that a worker has left, which was killed before it could."""
    for left in folder.iterdir():
        shutil.rmtree(left, ignore_errors=True)


def status_of(pid: int, control: socket.socket, woken: int) -> int | None:
    """How a worker stopped or ended; None when the supervisor is gone before."""
    while True:
        found, status = os.waitpid(pid, os.WNOHANG | os.WUNTRACED)
        if found:
            return status
        # The supervisor sends nothing: what can be read is the end.
        ready, _, _ = select.select([control.fileno(), woken], [], [])
        if control.fileno() in ready:
            return None
        os.read(woken, 1024)


def serve(connection: Connection, policies: Mapping[str, Policy], limits: Limits, lane: str) -> None:
    """Answer requests until the other end is closed."""
    while True:
        request = connection.recv()
        limit_time(limits.seconds, limits.quick_seconds if lane == QUICK else 0.0)
        sent = safe(request, policies, limits, lane)
        limit_time(0.0, 0.0)
        connection.send(sent)


def safe(request: MeshRequest, policies: Mapping[str, Policy], limits: Limits, lane: str) -> Answer | None:
    """The answer, also when there is a mistake in the mesher: the log has its traceback, the client a line."""
    try:
        return answer(request, policies, limits, lane)
    except MemoryError:
        return refusal(
            HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
            f"the mesh takes more than {limits.worker_bytes / 1e9:g} GB of memory; use a larger edge_length or a "
            "simpler polygon",
        )
    except Exception:
        traceback.print_exc()
        return refusal(HTTPStatus.INTERNAL_SERVER_ERROR, "the mesher failed; the server's log says how")


def limit_time(wall: float, processor: float) -> None:
    """Have the system end this process when its time is up; 0: there is no limit any more.

    A quick request's limit is processor time: where the machine is busy it takes longer, and is no costlier.

    Args:
        wall: seconds, after which it ends by SIGALRM.
        processor: seconds that it has a core for, all of its threads together, after which it ends by SIGPROF.
    """
    signal.setitimer(signal.ITIMER_REAL, wall)
    signal.setitimer(signal.ITIMER_PROF, processor)


def limit_memory(more: int) -> None:
    """Let this process, and those that it forks, take so many more bytes of address space, where there is /proc."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[0])
    except OSError:
        return
    most = pages * resource.getpagesize() + more
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    if hard == resource.RLIM_INFINITY or most < hard:
        resource.setrlimit(resource.RLIMIT_AS, (most, most))


def end_with_the_parent() -> None:
    """Have the system kill this process when its parent ends, however that does; only Linux can."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def main() -> None:
    """Keep a worker for the supervisor at the other end of the socket whose descriptor is the first argument."""
    folder = Path(sys.argv[2])
    with socket.socket(fileno=int(sys.argv[1])) as control:
        try:
            folder.mkdir(mode=0o700)
            keep_a_worker(control, folder)
        except (EOFError, ConnectionError):
            return
        finally:
            shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
