"""Whether a mesh has room in memory, asked before any of it is taken."""

from __future__ import annotations

import math
from pathlib import Path

from envs.types import DomainError

#: Bytes that a mesh takes for each expected element, from its front to its finish (measured: 290 to 1200).
BYTES_PER_ELEMENT = 1500

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


def check_memory(expected: float, source: str) -> None:
    """Refuse a mesh that memory has no room for.

    Args:
        expected: elements, as `envs.polygons.mesh_size` expects them.
        source: what the message begins with.

    Raises:
        DomainError: as said.
    """
    needed, there = expected * BYTES_PER_ELEMENT, available()
    if needed > there:
        raise DomainError(
            f"{source}: a mesh of about {expected:.3g} elements takes about {needed / 1e9:.3g} GB of memory, "
            f"{there / 1e9:.3g} GB are free; use a larger edge length"
        )
