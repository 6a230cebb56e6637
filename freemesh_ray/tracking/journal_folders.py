"""Where journals lie below a folder: in the ``tracking`` of each folder, and in the ``shared`` of that."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from freemesh_ray.tracking.journal import shared

log = logging.getLogger(__name__)

#: Entries of folders that are looked at, and levels: a study's trials lie four below the folder above all studies.
ENTRIES, LEVELS = 1_000_000, 8


def found(folder: Path) -> Iterator[Path]:
    """The journals below a folder; what cannot be read, and links, are passed by.

    Args:
        folder: absolute; it need not exist.
    """
    left, waiting = ENTRIES, [(folder, 0)]
    while waiting:
        here, level = waiting.pop()
        inside = here.name == "tracking" and level > 0
        for entry in _entries(here):
            left -= 1
            if left < 0:
                log.warning("tracking: %s holds too much to be searched whole: name a folder in it", folder)
                return
            path = Path(entry.path)
            if _is_folder(entry):
                if level < LEVELS and (not inside or path == shared(here)):
                    waiting.append((path, level + 1))
            elif path.suffix == ".jsonl" and (inside or here == shared(here.parent)) and not entry.is_symlink():
                yield path


def _entries(folder: Path) -> Iterator[os.DirEntry[str]]:
    with suppress(OSError), os.scandir(folder) as entries:
        yield from entries


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir(follow_symlinks=False)
    except OSError:
        return False
