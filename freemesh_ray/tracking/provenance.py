"""Where results come from: the source's git commit and the versions of the packages that decide them."""

from __future__ import annotations

import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

COMMIT = "mlflow.source.git.commit"
#: The variable that says the commit where the source is a copy without its history, as in a job on a cluster.
GIVEN = "FREEMESH_COMMIT"
PACKAGES = ("ray", "torch", "gymnasium", "numpy", "numba", "mlflow")


def provenance() -> dict[str, str]:
    """Tags that say what ran: the source's git commit (``-dirty`` when changed) and the installed versions.

    Outside a repository the commit is what FREEMESH_COMMIT says.
    """
    tags = {"version.python": platform.python_version()}
    for package in PACKAGES:
        try:
            tags[f"version.{package}"] = version(package)
        except PackageNotFoundError:
            continue
    if commit := _commit():
        changed = _git("status", "--porcelain", "--untracked-files=no")
        tags[COMMIT] = f"{commit}-dirty" if changed else commit
    elif given := os.environ.get(GIVEN):
        tags[COMMIT] = given
    return tags


def _commit() -> str:
    """The commit where the source is tracked where it lies; empty for a copy installed inside another repository."""
    return _git("rev-parse", "HEAD") if _git("ls-files", Path(__file__).name) else ""


def _git(*arguments: str) -> str:
    """What git says about this source; empty without git, or outside a repository."""
    try:
        answer = subprocess.run(
            ["git", *arguments], cwd=Path(__file__).parent, capture_output=True, text=True, timeout=2, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return answer.stdout.strip()
