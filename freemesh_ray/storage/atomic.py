"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import shlex
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from envs.errors import UserError


class OutputError(UserError, ValueError):
    """A file that cannot be written; one line with its name, what is wrong and the fix."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A draft beside ``path`` to write to; it takes the place of ``path`` when the block ends without an exception.

    Missing folders are made. The draft keeps the suffix, which some writers go by.

    Raises:
        OutputError: the place cannot be written to.
    """
    draft = path.with_name(f".{path.stem}.{os.getpid()}.draft{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield draft
            os.replace(draft, path)
        finally:
            draft.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error}): check the place") from error


def check_writable(path: Path, *, parents: bool = False) -> None:
    """Before any work: whether ``path`` could be written.

    Args:
        path: of a file.
        parents: whether missing folders above it will be made.

    Raises:
        OutputError: it is a folder, or lies where no file can be made.
    """
    existing = path.parent
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    try:
        folder = path.is_dir()
    except OSError as error:
        raise OutputError(f"{path.name[:40]}...: cannot be written ({error.strerror})") from error
    if folder:
        raise OutputError(f"{path}: is a folder: name a file in it")
    if existing != path.parent and not parents:
        fix = shlex.join(["mkdir", "-p", str(path.parent)])
        raise OutputError(f"{path}: there is no folder {path.parent}: `{fix}` makes it")
    try:
        with tempfile.TemporaryFile(dir=existing):  # permissions alone do not tell
            pass
    except OSError as error:
        raise OutputError(f"{path}: nothing can be written to {existing}: choose another place") from error
