"""Checks of many files in child processes that may not take much memory or long: a child that dies is a finding."""

from __future__ import annotations

import faulthandler
import multiprocessing
import re
import resource
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path

#: What a child may have beside what it has when it begins: bytes of addresses, and of them really used.
MOST_ADDRESSES = 2**30
MOST_MEMORY = 512 * 2**20

#: Seconds that one file may take on the slowest machine; then the child prints where it hangs, and ends.
DEADLINE = 60.0


@contextmanager
def confined_pool() -> Iterator[ProcessPoolExecutor]:
    """Two fresh processes that cannot allocate more than ``MOST_ADDRESSES``."""
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn"), confine) as pool:
        yield pool


def confine() -> None:
    """Limit this process; what it needs is imported first."""
    import ezdxf.recover  # noqa: F401
    import scipy.interpolate  # noqa: F401

    import envs.domains.load  # noqa: F401
    import freemesh_ray.policies.policy  # noqa: F401

    size = re.search(r"VmSize:\s+(\d+)", Path("/proc/self/status").read_text())
    assert size is not None
    most = int(size[1]) * 1024 + MOST_ADDRESSES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def peak_memory() -> int:
    """Bytes that this process had at most so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def each(files: Iterator[bytes], path: Path, check: Callable[[Path, int], bool]) -> int:
    """Write each content to ``path`` and check it; what a check killed the process with stays there.

    Returns:
        How many the check accepted.
    """
    accepted, before = 0, peak_memory()
    for i, content in enumerate(files):
        path.write_bytes(content)
        faulthandler.dump_traceback_later(DEADLINE, exit=True)
        accepted += check(path, i)
        faulthandler.cancel_dump_traceback_later()
    assert peak_memory() - before < MOST_MEMORY
    return accepted
