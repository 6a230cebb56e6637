"""A plug-in that was found: a call of it fails in one line that says where."""

from __future__ import annotations

import math
import traceback
from dataclasses import dataclass
from typing import Any

from envs.errors import PluginError


@dataclass(frozen=True)
class PlugIn:
    """A plug-in that was found.

    Attributes:
        key: the setting that names it.
        spec: its name.
        value: the object.
        file: that it stands in; empty where there is none.
    """

    key: str
    spec: str
    value: Any
    file: str = ""

    @property
    def name(self) -> str:
        """Its name without the module's."""
        return self.spec.rpartition(":")[2].rpartition(".")[2]

    def __call__(self, *arguments: Any) -> Any:
        """What it returns.

        Raises:
            PluginError: it raised; the line says what, and where.
        """
        try:
            return self.value(*arguments)
        except PluginError:
            raise
        except (Exception, SystemExit) as error:
            raise self.wrong(f"raised {told(error, self.file)}", "mend it") from error

    def number(self, *arguments: Any) -> float:
        """The number that it returns.

        Raises:
            PluginError: it raised, or returned anything else.
        """
        return self.as_number(self(*arguments))

    def as_number(self, value: Any) -> float:
        """A value that it returned.

        Raises:
            PluginError: it is not a finite number.
        """
        try:
            number = float(value)
        except (TypeError, ValueError):
            raise self.wrong(f"returned {value!r:.60}", "return a number") from None
        if not math.isfinite(number):
            raise self.wrong(f"returned {number}", "return a finite number")
        return number

    def wrong(self, what: str, fix: str) -> PluginError:
        """The error that says what is wrong with it."""
        return PluginError(f"{self.key}: {self.spec}: {what}: {fix}")


def told(error: BaseException, file: str = "") -> str:
    """An exception in one line: its type, what it says, and where: in ``file``, if it passed there."""
    lines = str(error).strip().splitlines()
    text = f"{type(error).__name__}: {lines[0][:160]}" if lines else type(error).__name__
    if isinstance(error, SyntaxError):
        return f"{type(error).__name__}: {error.msg} ({error.filename}:{error.lineno})"
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if file and frame.filename == file]
    return "".join([text, *(f" ({frame.filename}:{frame.lineno})" for frame in (own or frames)[-1:])])
