"""Files of this user below a folder: opened so that no link, pipe, device or file of another's passes for one."""

from __future__ import annotations

import os
import stat
from pathlib import Path

#: Bytes copied at a time.
CHUNK = 1 << 20


class ForeignFileError(OSError):
    """It is not a file of this user below the folder; one line with its path and what it is."""


def opened(folder: Path, path: Path, flags: int = os.O_RDONLY, mode: int = 0o600) -> int:
    """The descriptor of a regular file of this user, with one name, below ``folder`` without any symbolic link.

    Pipes and devices are not waited for, and the file that was checked is the one that is open.

    Args:
        folder: absolute; links above it, and it itself, are followed.
        path: of the file, below it, without ``..``.
        flags, mode: as of ``os.open``.

    Raises:
        ForeignFileError: it is something else, or lies elsewhere.
        OSError: there is none, or it cannot be opened.
    """
    if not path.is_relative_to(folder) or ".." in path.parts or path == folder:
        raise ForeignFileError(f"{path}: does not lie below {folder}")
    *above, name = path.relative_to(folder).parts
    inside = os.open(folder, getattr(os, "O_PATH", os.O_RDONLY) | os.O_DIRECTORY)
    try:
        for part in above:
            try:
                deeper = os.open(
                    part, getattr(os, "O_PATH", os.O_RDONLY) | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=inside
                )
            except NotADirectoryError as error:
                raise ForeignFileError(f"{path}: {part} is no folder of its own") from error
            os.close(inside)
            inside = deeper
        if not flags & os.O_CREAT:
            _check(path, os.stat(name, dir_fd=inside, follow_symlinks=False))
        descriptor = os.open(name, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, mode, dir_fd=inside)
    finally:
        os.close(inside)
    try:
        _check(path, os.fstat(descriptor))
    except ForeignFileError:
        os.close(descriptor)
        raise
    return descriptor


def read(folder: Path, path: Path, limit: int) -> bytes:
    """What such a file holds.

    Args:
        folder, path: as for `opened`.
        limit: bytes at most.

    Raises:
        ForeignFileError: as `opened`, or it is longer.
        OSError: as `opened`.
    """
    descriptor = opened(folder, path)
    with open(descriptor, "rb") as file:
        content = file.read(limit + 1)
    if len(content) > limit:
        raise ForeignFileError(f"{path}: is longer than {limit:,} bytes")
    return content


def copy(folder: Path, path: Path, target: Path, limit: int) -> None:
    """Copy such a file to ``target``, which is made.

    Raises:
        ForeignFileError: as `opened`, or it is longer than ``limit`` bytes.
        OSError: as `opened`, or the target is there, or cannot be written.
    """
    with open(opened(folder, path), "rb") as source:
        if os.fstat(source.fileno()).st_size > limit:
            raise ForeignFileError(f"{path}: is longer than {limit:,} bytes")
        with target.open("xb") as file:
            left = limit
            while left > 0 and (chunk := source.read(min(CHUNK, left))):
                file.write(chunk)
                left -= len(chunk)


def _check(path: Path, about: os.stat_result) -> None:
    """Refuse what is no file of this user's alone.

    Raises:
        ForeignFileError: as said.
    """
    if not stat.S_ISREG(about.st_mode):
        raise ForeignFileError(f"{path}: is no regular file")
    if about.st_uid != os.geteuid():
        raise ForeignFileError(f"{path}: belongs to another user")
    if about.st_nlink != 1:
        raise ForeignFileError(f"{path}: has another name elsewhere")
