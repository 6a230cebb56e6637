"""Files that Gmsh scripts include: below the script's folder alone."""

from __future__ import annotations

from pathlib import Path

from envs.readers.file_check import check_file, text_of
from envs.readers.geo_words import Mark, Words
from envs.types import DomainError

#: Bytes of included files at most, each counted as often as it is read.
MOST_INCLUDED = 20_000_000

#: Included files in each other at most.
DEPTH = 50


def included(folder: Path, words: Words, name: str, line: int) -> Mark:
    """The beginning of a file that a script means by a name.

    Args:
        folder: the script's.
        words: those of the script, or of a file that it includes, which the name is relative to.
        name: as the script has it.
        line: where.

    Raises:
        DomainError: it lies outside the script's folder, is not there or too large, or no text.
    """
    top = folder.resolve()
    try:
        path = ((top / words.file).parent if words.file else top) / name
        path = path.resolve()
    except (OSError, ValueError, RuntimeError):  # no such path can be
        path = Path()
    if not path.is_relative_to(top):
        raise words.fault(f"{name[:60]!r} lies outside the script's folder; put it there", line)
    try:
        check_file(path, MOST_INCLUDED)
        text = text_of(path, errors="replace")
    except DomainError as error:
        raise words.fault(f"Include: {error}", line) from None
    return Mark(text, str(path.relative_to(top)), 0, 1)
