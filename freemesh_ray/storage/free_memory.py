"""How much memory is still to be had: asked before what a file or a mesh needs is taken."""

from __future__ import annotations

import math
from pathlib import Path

from envs.errors import UserError


class MemoryShortError(UserError):
    """Something that memory has no room for; one line with its name and what it takes."""


MACHINE = Path("/proc/meminfo")
#: What a container may take and has taken (version 2 of Linux's control groups); there are none outside of one.
CONTAINER = Path("/sys/fs/cgroup")


def available() -> float:
    """Bytes that this machine, or this container, still has; infinity where that is not told."""
    return min(of_machine(), of_container())


def of_machine() -> float:
    """Bytes that can be had without swapping, as Linux estimates them."""
    try:
        lines = MACHINE.read_text(encoding="ascii").splitlines()
        return next(1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:"))
    except (OSError, ValueError, IndexError, StopIteration):
        return math.inf


def of_container() -> float:
    """Bytes between what the container has taken, its cache of files left out, and its limit."""
    try:
        limit, taken, parts = (
            (CONTAINER / f"memory.{name}").read_text(encoding="ascii") for name in ("max", "current", "stat")
        )
        cache = next((float(line.split()[1]) for line in parts.splitlines() if line.startswith("inactive_file ")), 0.0)
        return max(0.0, float(limit) - float(taken) + cache)
    except (OSError, ValueError):  # `max` where there is no limit
        return math.inf


def check(needed: float, source: str, fix: str = "free some, or go on where there is more") -> None:
    """Refuse what memory has no room for.

    Args:
        needed: bytes.
        source: what the message begins with.
        fix: what it ends with.

    Raises:
        MemoryShortError: as said.
    """
    there = available()
    if needed > there:
        raise MemoryShortError(
            f"{source} takes {needed / 1e9:,.3g} GB of memory, {there / 1e9:,.3g} GB are free: {fix}"
        )
