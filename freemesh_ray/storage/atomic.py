"""Files that appear whole or not at all, whatever others have put in their place."""

from __future__ import annotations

import errno
import os
import shlex
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from envs.errors import UserError


class OutputError(UserError, ValueError):
    """A file that cannot be written; one line with its name, what is wrong and the fix."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A draft to write to, of the same name; it takes the place of ``path`` when the block ends without an exception.

    Missing folders are made. The draft lies in a folder beside ``path`` that nobody else may enter, so that no other
    account can put a link in its place. The umask decides who may read the file; a link at ``path`` is replaced.

    Raises:
        OutputError: the place cannot be written to.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with private_folder(path.parent) as folder:
            draft = folder / path.name
            yield draft
            os.replace(draft, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error}): check the place") from error


@contextmanager
def private_folder(beside: Path) -> Iterator[Path]:
    """A new folder in ``beside`` for this account alone, removed at the end.

    On Linux its path goes by this process's open file: it means that folder even if the name is given to another.

    Raises:
        OSError: it cannot be made, or others may enter it.
    """
    made = tempfile.mkdtemp(prefix=".draft-", dir=beside)
    try:
        descriptor = os.open(made, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        try:
            if os.fstat(descriptor).st_mode & 0o077:
                raise PermissionError(errno.EPERM, "the draft's folder was given to another")
            held = Path(f"/proc/self/fd/{descriptor}")
            yield held if held.is_dir() else Path(made)
        finally:
            os.close(descriptor)
    finally:
        shutil.rmtree(made, ignore_errors=True)


def refusing_links(path: str, flags: int) -> int:
    """An ``opener`` for files that are written to in place: a link, a pipe or a device at ``path`` is an OSError."""
    descriptor = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK, 0o666)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, "no regular file", path)
    return descriptor


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
