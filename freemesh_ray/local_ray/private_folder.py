"""The folder of an embedded Ray: its user's alone, and with a path as short as sockets need it."""

from __future__ import annotations

import os
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from envs.errors import UserError
from freemesh_ray.storage.atomic import OutputError
from freemesh_ray.storage.lock import FILE, held

#: What the folder of an embedded Ray begins with.
FOLDER = "ray-"

#: Bytes of a socket's path at most (`sun_path` less its zero), and the longest that Ray adds to its folder, which is
#: one within ours: Ray opens it to everybody.
SOCKET_PATH = 103 if sys.platform == "darwin" else 107
SOCKET = "/r/session_2026-01-01_00-00-00_000000_4194304/sockets/plasma_store.0"

#: A folder younger than this may be about to be locked.
NEW_SECONDS = 60.0

#: Where Ray's folder may lie besides the user's own place for temporary files, the first that will do.
SHORT_FOLDERS = ("/tmp", "/dev/shm", "/var/tmp")


@contextmanager
def private_folder(environment: Mapping[str, str] = os.environ) -> Iterator[Path]:
    """A folder of this user's alone for the sockets and logs of a Ray, with a path as short as sockets need it.

    It lies below RAY_TMPDIR, which nothing replaces, or below TMPDIR or the first of `SHORT_FOLDERS` that is short
    enough, can be written to, and where no other user could put another folder in its place. It is locked, and removed
    at the end; what a killed process left there is removed too.

    Raises:
        OutputError: there is no such place.
    """
    own = environment.get("RAY_TMPDIR")
    parents = [own] if own else [environment.get("TMPDIR") or "/tmp", *SHORT_FOLDERS]
    for parent in parents:
        try:
            if not _is_safe(Path(parent).resolve()):
                continue
            folder = Path(tempfile.mkdtemp(prefix=FOLDER, dir=parent)).resolve()
        except OSError:
            continue
        try:
            if len(os.fsencode(folder)) + len(SOCKET) <= SOCKET_PATH:
                with held(folder, "wait") as locked:
                    if locked:
                        _remove_left(Path(parent))
                    yield folder
                return
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    longest = SOCKET_PATH - len(SOCKET) - len(f"/{FOLDER}12345678")
    raise OutputError(
        f"{', '.join(dict.fromkeys(parents))}: no place for Ray's sockets: set RAY_TMPDIR to a folder that you can "
        f"write to and others cannot, with a path of {longest} bytes at most"
    )


def _is_safe(folder: Path) -> bool:
    """Whether nobody but this user and root can rename what lies in a folder, or one of the folders above."""
    for each in (folder, *folder.parents):
        about = each.stat()
        shared = about.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not about.st_mode & stat.S_ISVTX
        if shared or about.st_uid not in (0, os.getuid()):
            return False
    return True


def _remove_left(parent: Path) -> None:
    """Remove the folders of this user's below ``parent`` that nobody holds any more."""
    for folder in parent.glob(f"{FOLDER}*"):
        with suppress(OSError, UserError):
            about = folder.lstat()
            # In a folder of somebody else's the lock might be a link to any file.
            if not stat.S_ISDIR(about.st_mode) or about.st_uid != os.getuid() or about.st_mode & 0o077:
                continue
            if abs(time.time() - (folder / FILE).stat().st_mtime) > NEW_SECONDS:
                with held(folder, "wait"):
                    shutil.rmtree(folder, ignore_errors=True)
