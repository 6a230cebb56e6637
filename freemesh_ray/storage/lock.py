"""A folder that one process at a time works in: a lock that the kernel frees when its process ends, however it ends.

It is ``flock`` on a file in the folder. On NFS Linux turns that into a lock of the server's, which holds among machines
and ends with the connection of a machine that is lost; a file system without such locks (some mounts of Lustre) has
none, which is said and the work goes on. The file says who holds the lock; it stays when the lock is given back, since
to remove it could take it from under the next.
"""

from __future__ import annotations

import errno
import fcntl
import json
import logging
import os
import platform
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from envs.errors import UserError

log = logging.getLogger(__name__)

FILE = ".lock"
#: Between two tries of whoever waits.
PAUSE_SECONDS = 0.2
#: What `flock` raises where another holds the lock.
HELD = {errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES}


class InUseError(UserError):
    """A folder that another process works in; one line with the folder, that process, and the fix."""


@contextmanager
def held(folder: Path, fix: str, patience: float = 0.0) -> Iterator[bool]:
    """Hold the lock of ``folder``, which must be there; yields whether its file system has locks.

    Args:
        folder: that no other process, and no one else in this one, shall work in meanwhile.
        fix: what the message ends with.
        patience: seconds to wait for another to give it back; may be infinite.

    Raises:
        InUseError: another holds it.
        UserError: the file is a link, through which another would be written to, or another user's.
        OSError: there is no such folder, or it cannot be written to.
    """
    descriptor = _opened(folder)
    deadline = time.monotonic() + patience
    try:
        while (locked := _locked(descriptor, folder)) is False:
            if time.monotonic() >= deadline:
                raise InUseError(f"{folder}: {_holder(descriptor)}: {fix}")
            time.sleep(PAUSE_SECONDS)
        _write(descriptor, {
            "host": platform.node(), "pid": os.getpid(), "since": f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC",
        })  # fmt: skip
        yield bool(locked)
    finally:
        os.close(descriptor)


def holder(folder: Path) -> str | None:
    """Who holds the lock of ``folder`` now, in words; None where nobody does."""
    try:
        descriptor = os.open(folder / FILE, os.O_RDWR | os.O_NOFOLLOW)
    except OSError:
        return None
    try:
        return _holder(descriptor) if _locked(descriptor, folder) is False else None
    finally:
        os.close(descriptor)


def _opened(folder: Path) -> int:
    """The lock's file, which this user alone may open: whoever may open it may hold the lock."""
    path = folder / FILE
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise UserError(f"{path}: is a link to another file: remove it") from error
        if error.errno == errno.EACCES and path.exists():
            raise UserError(f"{path}: belongs to another user, who works here: choose another folder") from error
        raise
    if os.fstat(descriptor).st_nlink > 1:
        os.close(descriptor)
        raise UserError(f"{path}: is a link to another file: remove it")
    return descriptor


def _locked(descriptor: int, folder: Path) -> bool | None:
    """Whether the lock could be had; None where there are no locks."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in HELD:
            return False
        log.warning("%s: no lock can be had (%s): let no second process work there", folder, error.strerror)
        return None
    return True


def _write(descriptor: int, about: Mapping[str, Any]) -> None:
    """Write who holds the lock, as far as the disk takes it."""
    text = json.dumps(about).encode()
    with suppress(OSError):
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, text, 0)


def _holder(descriptor: int) -> str:
    """Who holds the lock, as the file says; it may be about to be written."""
    try:
        told = json.loads(os.pread(descriptor, 10_000, 0))
        return f"process {told['pid']} on {told['host']} has worked here since {told['since']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process works here"
