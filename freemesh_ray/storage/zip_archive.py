"""Zip archives from anywhere: what their directory says is checked before anything is read or unpacked."""

from __future__ import annotations

import lzma
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Any

#: Bytes of an archive's directory at most: some 10,000 members.
MOST_DIRECTORY = 1_000_000

#: What `zipfile` raises of damaged archives; the last of encrypted ones and of other methods of packing.
DAMAGES = (zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, EOFError, OSError, RuntimeError)


class _Bounded:
    """A file of which no more than ``MOST_DIRECTORY`` bytes are read in one go while ``bounded``."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file, self.bounded = file, True
        self._size = file.seek(0, 2)

    def read(self, count: int = -1) -> bytes:
        """As of any file.

        Raises:
            ValueError: of too many bytes.
        """
        wanted = self._size - self._file.tell() if count < 0 else count
        if self.bounded and wanted > MOST_DIRECTORY:
            raise ValueError(f"its directory has more than {MOST_DIRECTORY:,} bytes")
        return self._file.read(count)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


@contextmanager
def opened(file: IO[bytes], most_bytes: int) -> Iterator[zipfile.ZipFile]:
    """The archive in a file; its members take ``most_bytes`` at most, all together and unpacked.

    Raises:
        ValueError: it has a longer directory, or more bytes.
        And ``DAMAGES``.
    """
    bounded = _Bounded(file)
    with zipfile.ZipFile(bounded) as archive:  # type: ignore[arg-type]
        bounded.bounded = False
        if sum(member.file_size for member in archive.infolist()) > most_bytes:
            raise ValueError(f"more than {most_bytes:,} bytes when unpacked")
        yield archive
