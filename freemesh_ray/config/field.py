"""What one key accepts, and a value checked against it."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from typing import Any

from freemesh_ray.errors import UserError


class ConfigError(UserError, ValueError):
    """A setting that cannot be used; one line with the place, the key, what is wrong and the fix."""


@dataclass(frozen=True)
class Field:
    """What one key accepts.

    Attributes:
        kind: the value's type; with ``many``, each item's.
        low, high: inclusive range of numbers.
        words: texts that are accepted; for a number, in its place. Empty: any text that is not blank.
        optional: whether null is accepted.
        many: a list of one or more values in place of one; with ``distinct``, none of them twice.
        pattern: what a text must match as a whole, with ``hint`` saying it in words.
    """

    kind: type
    low: float = -math.inf
    high: float = math.inf
    words: tuple[str, ...] = ()
    optional: bool = False
    many: bool = False
    distinct: bool = False
    pattern: str = r"(?s).*\S.*"
    hint: str = "text"

    def __str__(self) -> str:
        """What is accepted, in words: the part of a message that tells the fix."""
        span = "" if math.isinf(self.low) else f" in [{self.low:.12g}, {self.high:.12g}]"
        plain = {bool: "true or false", int: f"a whole number{span}", float: f"a number{span}", str: self.hint}
        choices = ([] if self.kind is str and self.words else [plain[self.kind]]) + list(self.words)
        one = " or ".join([*choices, *(["null"] if self.optional else [])])
        return f"a list of one or more{' different values' if self.distinct else ''}, each {one}" if self.many else one


def check(value: Any, field: Field, place: str, key: str) -> Any:
    """The value as ``field`` takes it.

    Raises:
        ConfigError: the value is of another type or out of range.
    """
    try:
        if value is None and field.optional:
            return None
        if not field.many:
            return _fitted(value, field)
        if isinstance(value, list) and value:
            items = [_fitted(item, field) for item in value]
            if not field.distinct or len(set(items)) == len(items):
                return items
    except (ValueError, OverflowError):
        pass
    quote = ": put it in quotes" if field.kind is str and isinstance(value, int | float) else ""
    raise ConfigError(f"{place}: {key}: must be {field}, not {_shown(value)}{quote}")


def _fitted(value: Any, field: Field) -> Any:
    """One value in the field's type; ValueError or OverflowError when it does not fit."""
    if isinstance(value, str):
        fits = value in field.words if field.words else field.kind is str and re.fullmatch(field.pattern, value)
    elif isinstance(value, bool) or not isinstance(value, int | float):
        fits = isinstance(value, bool) and field.kind is bool
    else:
        fits = field.kind in (int, float) and field.low <= value <= field.high and field.kind(value) == value
        value = field.kind(value) if fits else value
    if not fits:
        raise ValueError(value)
    return value


def _shown(value: Any) -> str:
    """A value as one short piece of a message line."""
    try:
        text = json.dumps(value, ensure_ascii=False, default=str)
    except ValueError:  # Python writes no number of so many digits
        text = "a number of thousands of digits"
    return text if len(text) <= 60 else text[:57] + "..."
