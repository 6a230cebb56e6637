"""What one key accepts, and a value checked against it."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Any

from envs.errors import UserError
from envs.plug_ins.lookup import is_spec
from envs.types import Setting


class ConfigError(UserError, ValueError):
    """A setting that cannot be used; one line with the place, the key, what is wrong and the fix."""


@dataclass(frozen=True)
class Field(Setting):
    """What one key accepts.

    Attributes:
        many: a list of one or more values in place of one; with ``empty`` also of none, with ``distinct`` none of them
            twice.
        plug_in: the name of a plug-in, ``package.module:Name``, is accepted in place of the words.
        pattern: what a text must match as a whole where there are no ``words``, with ``hint`` saying it in words.
    """

    many: bool = False
    distinct: bool = False
    empty: bool = False
    plug_in: bool = False
    pattern: str = r"(?s).*\S.*"
    hint: str = "text"

    def fitted(self, value: Any) -> Any:
        """The value in the field's type; each item's, where there are many."""
        if not self.many:
            return self._one(value)
        items = [self._one(item) for item in value] if isinstance(value, list) else []
        none = not items and not (self.empty and value == [])
        if none or (self.distinct and len(set(items)) < len(items)):
            raise ValueError(value)
        return items

    def __str__(self) -> str:
        """What is accepted, in words: the part of a message that tells the fix."""
        one = super().__str__()
        if self.kind is str and not self.words:
            one = self.hint + (f" or {one}" if one else "")
        if self.plug_in:
            one += " or package.module:Name"
        if not self.many:
            return one
        amount = ["values"] if self.empty else ["one or more", *(["different values"] if self.distinct else [])]
        return f"a list of {' '.join(amount)}, each {one}"

    def _one(self, value: Any) -> Any:
        """One value, where there may be many."""
        if self.plug_in and is_spec(value):
            return value
        if self.kind is str and not self.words and isinstance(value, str) and re.fullmatch(self.pattern, value):
            return value
        return super().fitted(value)


def check(value: Any, field: Setting, place: str, key: str) -> Any:
    """The value as ``field`` takes it.

    Raises:
        ConfigError: the value is of another type or out of range.
    """
    try:
        return field.fitted(value)
    except (ValueError, OverflowError):
        quote = ": put it in quotes" if field.kind is str and isinstance(value, int | float) else ""
        raise ConfigError(f"{place}: {key}: must be {field}, not {_shown(value)}{quote}") from None


#: What may be a user and a password, however it is written.
LOGIN = re.compile("://.*@")


def _shown(value: Any) -> str:
    """A value as one short piece of a message line."""
    try:
        text = json.dumps(value, ensure_ascii=False, default=str)
    except ValueError:  # Python writes no number of so many digits
        text = "a number of thousands of digits"
    text = LOGIN.sub("://", text)
    return text if len(text) <= 60 else text[:57] + "..."
