"""Checkpoints of a training: written whole or not at all, found again newest first, old ones removed.

A checkpoint is a folder: ``state.npz``, all that the algorithm is (see ``state_file``), and ``progress.json``. Nothing
in it is pickled: reading one runs no code of its writer's.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
from pathlib import Path
from typing import Any, Protocol

from envs.errors import UserError
from freemesh_ray.storage import state_file
from freemesh_ray.storage.atomic import OutputError, replacing
from freemesh_ray.storage.json_file import read_json
from freemesh_ray.storage.regular_file import copied

PROGRESS = "progress.json"
STATE = "state.npz"


class CheckpointError(UserError, RuntimeError):
    """There is no checkpoint to go on from, or it cannot be read; the message names the folder and the fix."""


class Checkpointed(Protocol):
    """What an algorithm must be able to do."""

    def get_state(self) -> dict[str, Any]:
        """All that it is, as ``state_file.save`` takes it."""

    def set_state(self, state: dict[str, Any]) -> None:
        """Take over a state."""


def save(algorithm: Checkpointed, progress: dict[str, Any], folder: Path, keep: int) -> Path:
    """Write a checkpoint named after ``progress["env_steps"]``; remove all but the ``keep`` newest.

    The folder is filled under another name and then renamed, so that a kill at any moment leaves either no checkpoint
    of this name or a whole one. What could not be written, on a full disk, is removed.

    Raises:
        OSError: it cannot be written.
    """
    folder.mkdir(exist_ok=True)  # not those above: they are there, or a shared folder has gone
    path = folder / f"step_{progress['env_steps']:09d}"
    for left in folder.glob(".partial_*"):  # by a kill
        shutil.rmtree(left, ignore_errors=True)
    partial = folder / f".partial_{path.name}_{secrets.token_hex(8)}"
    try:
        partial.mkdir()
        write(algorithm, progress, partial)
    except OSError:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    if path.exists():
        discard(path)
    os.rename(partial, path)
    for old in found(folder)[keep:]:
        discard(old)
    return path


def adopt(source: Path, folder: Path, keep: int = 1) -> Path:
    """Make a checkpoint that lies elsewhere one of ``folder``, in which the ``keep`` newest stay.

    Its files are linked, so that they take no room of their own; across file systems they are copied.

    Raises:
        OSError, ValueError: it cannot be read or written.
    """
    steps = read_json(source / PROGRESS)["env_steps"]
    folder.mkdir(exist_ok=True)
    path = folder / f"step_{steps:09d}"
    if (path / PROGRESS).is_file():
        return path
    partial = folder / f".partial_{path.name}_{secrets.token_hex(8)}"
    try:
        partial.mkdir()
        for name in (STATE, PROGRESS):
            _link(source / name, partial / name)
        os.rename(partial, path)
    except (OSError, OutputError):
        shutil.rmtree(partial, ignore_errors=True)
        raise
    for old in found(folder)[keep:]:
        discard(old)
    return path


def _link(source: Path, path: Path) -> None:
    try:
        os.link(source, path)
    except OSError:
        with replacing(path) as draft:
            copied(source, draft)


def write(algorithm: Checkpointed, progress: dict[str, Any], path: Path) -> None:
    """Write a checkpoint into folder ``path``; its progress last, so that one without it is known to be cut short."""
    path.mkdir(parents=True, exist_ok=True)
    state_file.save(algorithm.get_state(), path / STATE)
    (path / PROGRESS).unlink(missing_ok=True)
    with open(path / PROGRESS, "x", encoding="utf-8") as file:
        json.dump(progress, file, indent=1)
        file.flush()
        os.fsync(file.fileno())


def discard(path: Path) -> None:
    """Remove a checkpoint; under another name first, so that a kill in between leaves no half of one to be found."""
    doomed = path.with_name(f".discarded_{path.name}")
    shutil.rmtree(doomed, ignore_errors=True)
    os.rename(path, doomed)
    shutil.rmtree(doomed, ignore_errors=True)


def set_aside(path: Path) -> Path:
    """Rename a checkpoint that cannot be read, so that it is not found again; its new path."""
    aside = path.with_name(f".damaged_{path.name}")
    shutil.rmtree(aside, ignore_errors=True)
    os.rename(path, aside)
    return aside


def found(folder: Path) -> list[Path]:
    """Whole checkpoints below ``folder``, newest first."""
    return sorted((path for path in folder.glob("step_*") if (path / PROGRESS).is_file()), reverse=True)


def read(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The state and the progress in folder ``path``.

    Raises:
        CheckpointError: it is damaged, or none of this version.
        MemoryShortError: memory has no room for it.
    """
    try:
        progress = read_json(path / PROGRESS)
        state = state_file.load(path / STATE)
        if not isinstance(progress, dict) or not isinstance(state, dict):
            raise ValueError("no table")
    except (OSError, ValueError) as error:
        brief = (str(error) or type(error).__name__).splitlines()[0][:160]
        raise CheckpointError(f"{path}: unreadable checkpoint ({brief}): remove it") from error
    return state, progress


def hand_over(algorithm: Checkpointed, state: dict[str, Any], path: Path) -> None:
    """Give an algorithm the state that was read from ``path``.

    Raises:
        CheckpointError: it is of another algorithm.
    """
    try:
        algorithm.set_state(state)
    except (ValueError, KeyError, TypeError, AttributeError, RuntimeError) as error:
        brief = (str(error) or type(error).__name__).splitlines()[0][:160]
        raise CheckpointError(f"{path}: not a checkpoint of this training ({brief}): begin another") from error
