"""Regular files of anybody's: what may be a pipe, or a device without an end, is not waited for."""

from __future__ import annotations

import os
import shutil
import stat
from pathlib import Path
from typing import BinaryIO


def opened(path: str | os.PathLike[str]) -> BinaryIO:
    """A file, to be read.

    Raises:
        ValueError: it is no regular file.
        OSError: it cannot be opened.
    """
    file = open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK))  # noqa: SIM115
    if stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        return file
    file.close()
    raise ValueError("no regular file")


def copied(path: Path, draft: Path) -> None:
    """Copy a file into a draft.

    Raises:
        ValueError, OSError: as `opened`, or the draft cannot be written.
    """
    with opened(path) as source, open(draft, "xb") as file:
        shutil.copyfileobj(source, file)
