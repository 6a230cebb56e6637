"""What the command prints: results on stdout, all else on stderr; no line holds commands to the terminal.

A stdout that takes no more ends the command: quietly, as SIGPIPE would, where its reader has gone (`freemesh domains |
head -1`), with one line where its disk is full. A stderr that takes no more is written to no more.
"""

from __future__ import annotations

import errno
import logging
import os
import sys
from collections.abc import Iterable
from typing import TextIO

from envs.errors import FAILED
from envs.printable import printable, without_login

#: Exit code of a process that SIGPIPE has ended.
PIPE_CLOSED = 141


class OutputLostError(KeyboardInterrupt):
    """Stdout takes no more; it ends what is at work as Ctrl-C does.

    Attributes:
        reason: why, in words; empty where its reader has gone.
        exit_code: what the command ends with.
    """

    def __init__(self, error: OSError) -> None:
        super().__init__(str(error))
        gone = error.errno in (errno.EPIPE, errno.ESHUTDOWN)
        self.reason = "" if gone else (error.strerror or type(error).__name__)
        self.exit_code = PIPE_CLOSED if gone else FAILED


def prepare() -> None:
    """Make both streams take any text, whatever the locale, and be there, also where they were closed at the start."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
    if logging.lastResort is not None:
        logging.lastResort.setFormatter(_Formatter())


class _Formatter(logging.Formatter):
    """Warnings of the log as they may be printed."""

    def format(self, record: logging.LogRecord) -> str:
        """The record's lines."""
        return shown(super().format(record))


def say(text: str = "", end: str = "\n") -> None:
    """Print lines of results.

    Raises:
        OutputLostError: stdout takes no more.
    """
    write(sys.stdout, shown(text) + end)


def note(text: str = "") -> None:
    """Print lines of progress, or on what went wrong, on stderr."""
    write(sys.stderr, shown(text) + "\n")


def shown(text: str) -> str:
    """Lines as they may be printed, without the passwords of addresses."""
    return "\n".join(printable(without_login(line)) for line in text.split("\n"))


def write(stream: TextIO, text: str) -> None:
    """Write text of the program's own making to stdout or stderr at once.

    Raises:
        OutputLostError: it is stdout, which takes no more.
    """
    try:
        stream.write(text)
        stream.flush()
    except OSError as error:
        _close(stream)
        if stream is not sys.stderr:
            raise OutputLostError(error) from None


def _close(stream: TextIO) -> None:
    """Let what is still in a stream's buffer, and all that comes, go nowhere: Python writes it at its end."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, stream.fileno())
    finally:
        os.close(nowhere)


def paths(found: Iterable[object]) -> str:
    """Paths, or other names, in one line."""
    return ", ".join(printable(str(path)) for path in found)
