"""The one error for what a user can mend, and the exit codes of commands."""

from __future__ import annotations

from typing import ClassVar

from envs.printable import printable, without_login

#: Exit codes: work that failed, bad input, Ctrl-C.
FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130


class UserError(Exception):
    """Something that a user can mend; the message is one line that names the place and the fix. What it quotes of files
    and command lines cannot break it, nor tell the terminal anything; it holds no address's password.

    Attributes:
        exit_code: what a command ends with: ``BAD_INPUT``, or ``FAILED`` for work that failed.
    """

    exit_code: ClassVar[int] = BAD_INPUT

    def __init__(self, message: str = "") -> None:
        super().__init__(printable(without_login(message)))


class PluginError(UserError, RuntimeError):
    """Code of a user's own, named in a setting or given to a call, that is missing, of another form, or raised; one
    line with its name, what is wrong and the fix."""
