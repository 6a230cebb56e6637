"""The processes of a service's workers: those that fork, and those that are forked."""

from __future__ import annotations

import os

from listening import family, named

WORKER = "serving.worker"


def workers(pid: int, quick: bool = True) -> list[int]:
    """Those that answer requests below a process; of the lane for quick requests, or of that for costly ones."""
    return sorted(worker for each in forking(pid, quick) for worker in family(each)[1:])


def forking(pid: int, quick: bool = True) -> list[int]:
    """Those that fork them."""
    everyone = set(named(pid, WORKER))
    forked = {child for each in everyone for child in family(each)[1:]}
    return sorted(each for each in everyone - forked if (os.getpriority(os.PRIO_PROCESS, each) == 0) == quick)
