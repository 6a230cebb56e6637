"""Checkpoints of a training: written whole or not at all, found again newest first, old ones removed."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import Any, Protocol

PROGRESS = "progress.json"


class CheckpointError(RuntimeError):
    """There is no checkpoint to go on from, or it cannot be read; the message names the folder and the fix."""


class Checkpointed(Protocol):
    """What an algorithm must be able to do."""

    def save_to_path(self, path: str) -> Any:
        """Write everything below ``path``."""

    def restore_from_path(self, path: str) -> Any:
        """Take over everything below ``path``."""


def save(algorithm: Checkpointed, progress: dict[str, Any], folder: Path, keep: int) -> Path:
    """Write a checkpoint named after ``progress["env_steps"]``; remove all but the ``keep`` newest.

    The folder is filled under another name and then renamed, so that a kill at any moment leaves either no checkpoint
    of this name or a whole one.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"step_{progress['env_steps']:09d}"
    partial = folder / f".partial_{path.name}"
    shutil.rmtree(partial, ignore_errors=True)
    write(algorithm, progress, partial)
    if path.exists():
        discard(path)
    os.rename(partial, path)
    for old in found(folder)[keep:]:
        discard(old)
    return path


def write(algorithm: Checkpointed, progress: dict[str, Any], path: Path) -> None:
    """Write a checkpoint into folder ``path``; its progress last, so that one without it is known to be cut short."""
    algorithm.save_to_path(str((path / "algorithm").absolute()))
    with open(path / PROGRESS, "w") as file:
        json.dump(progress, file, indent=1)
        file.flush()
        os.fsync(file.fileno())


def discard(path: Path) -> None:
    """Remove a checkpoint; under another name first, so that a kill in between leaves no half of one to be found."""
    doomed = path.with_name(f".discarded_{path.name}")
    shutil.rmtree(doomed, ignore_errors=True)
    os.rename(path, doomed)
    shutil.rmtree(doomed, ignore_errors=True)


def found(folder: Path) -> list[Path]:
    """Whole checkpoints below ``folder``, newest first."""
    return sorted((path for path in folder.glob("step_*") if (path / PROGRESS).is_file()), reverse=True)


def restore(algorithm: Checkpointed, path: Path) -> dict[str, Any]:
    """Take over a checkpoint; its progress.

    Raises:
        CheckpointError: it cannot be read.
    """
    try:
        progress = json.loads((path / PROGRESS).read_text())
        algorithm.restore_from_path(str((path / "algorithm").absolute()))
        if not isinstance(progress, dict):
            raise TypeError(f"{PROGRESS} holds no table")
    except Exception as error:  # unpickling what a disk has damaged can raise anything
        brief = (str(error) or type(error).__name__).splitlines()[0][:160]
        raise CheckpointError(
            f"{path}: unreadable checkpoint ({brief}); remove it to go on from the one before"
        ) from error
    return progress
