"""The processes of an embedded Ray without which nothing goes on."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from freemesh_ray.local_ray.processes import Process, children, command_line

#: What they are called, and what the command line tells each by, early and late: Ray ends a raylet that has lost one of
#: its agents.
VITAL = {
    "GCS": ("/gcs_server",),
    "raylet": ("/raylet/raylet",),
    "dashboard agent": ("/dashboard/agent.py", "ray::DashboardAgent"),
    "runtime env agent": ("/runtime_env/agent/main.py", "ray::RuntimeEnvAgent"),
}
#: What a process tells its guard: Ray is up and all of it is needed; it is about to end.
NEEDED, NOT_NEEDED = b"1", b"0"
#: Words of a command line that say what it runs; a raylet's further ones name its agents.
WORDS = 4


def started(owner: int, folder: Path) -> list[Process]:
    """The processes of Ray's that ``owner`` has started itself: their command lines name Ray's folder."""
    return [child for child in children(owner) if f"{folder}/r" in command_line(child.number)]


def vital(owner: int, folder: Path) -> dict[int, str]:
    """The processes of `VITAL` that run now: a descriptor that can be read when one is dead, and what to call it."""
    ours = started(owner, folder)
    found = {}
    for one in [*ours, *(child for parent in ours for child in children(parent.number))]:
        words = command_line(one.number).split()[:WORDS]
        for name, endings in VITAL.items():
            if any(word.endswith(endings) for word in words):
                with suppress(OSError):
                    found[os.pidfd_open(one.number)] = f"Ray's {name} (process {one.number})"
    return found


def lost(name: str, fix: str) -> str:
    """The line that tells of a death.

    Args:
        name: of whom.
        fix: what to do.
    """
    return f"{name} is gone, killed or out of memory: {fix}"
