"""What a user can mend."""

from __future__ import annotations

from typing import ClassVar


class UserError(Exception):
    """Something that a user can mend; the message is one line that names the place and the fix.

    Attributes:
        exit_code: what the command ends with: 2 for bad input, 1 for work that failed.
    """

    exit_code: ClassVar[int] = 2
