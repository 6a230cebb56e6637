"""The one error for what a user can mend, and the exit codes of the command."""

from __future__ import annotations

from envs.errors import UserError

#: Exit codes: work that failed, bad input (:attr:`UserError.exit_code`), Ctrl-C.
FAILED = 1
BAD_INPUT = UserError.exit_code
INTERRUPTED = 130

__all__ = ["BAD_INPUT", "FAILED", "INTERRUPTED", "UserError"]
