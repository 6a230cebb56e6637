"""What every polygon file goes through first: it must be a file, of a sane size, and text where its format is text."""

from __future__ import annotations

import stat
from pathlib import Path

from envs.printable import printable
from envs.types import DomainError


def check_file(path: Path, most: int) -> None:
    """Refuse what is no file, or one of more than ``most`` bytes.

    Raises:
        DomainError: no such file, a folder or a device, no permission, or too many bytes.
    """
    try:
        status = path.stat()
        if stat.S_ISREG(status.st_mode):  # to open a pipe waits for its other end
            path.open("rb").close()
    except FileNotFoundError:
        raise DomainError(f"{path}: no such file; check the path") from None
    except OSError as error:
        raise DomainError(f"{path}: cannot be read ({error.strerror}); check the path and its permissions") from None
    except ValueError as error:
        raise DomainError(f"{path!r}: cannot be read ({error}); check the path") from None
    if not stat.S_ISREG(status.st_mode):
        raise DomainError(f"{path}: cannot be read (not a regular file); save the polygon to one")
    if status.st_size > most:
        raise DomainError(
            f"{path}: {status.st_size / 1e6:.0f} MB, more than the {most / 1e6:.0f} MB such a file may have; "
            "split or simplify it"
        )


def excerpt(text: str, most: int = 60) -> str:
    """What a message quotes of a file: the beginning, and what is not to be printed (line ends, commands to the
    terminal) as its code.
    """
    beginning = text if len(text) <= most else f"{text[: most - 3]}..."
    return printable(beginning)


def bytes_of(path: Path) -> bytes:
    """The file's bytes, not empty.

    Raises:
        DomainError: it cannot be read, or there is nothing in it.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise DomainError(f"{path}: cannot be read ({error.strerror}); check the path and its permissions") from None
    if not content.strip():
        raise DomainError(f"{path}: the file is empty; write a polygon into it")
    return content


def text_of(path: Path, *, errors: str = "strict") -> str:
    """The file's text (UTF-8, with or without a byte-order mark), not empty.

    Args:
        path: it.
        errors: ``replace`` for U+FFFD in place of bytes that are no UTF-8, where a format allows them in comments.
    """
    try:
        text = path.read_text(encoding="utf-8-sig", errors=errors)
    except UnicodeDecodeError as error:
        raise DomainError(f"{path}: not a text file (byte {error.start}); save it as UTF-8") from None
    except OSError as error:
        raise DomainError(f"{path}: cannot be read ({error.strerror}); check the path and its permissions") from None
    if not text.strip():
        raise DomainError(f"{path}: the file is empty; write a polygon into it")
    return text
