"""Readable labels: settings in a few words, as ``gamma 0.9, hidden 128x128``."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

#: Letters of a name above which it is its words' first letters, where names are shortened.
LONG = 8


def label(settings: Mapping[str, Any]) -> str:
    """Every setting by the end of its key and its value."""
    names = ends(list(settings))
    return ", ".join(f"{names[key]} {text(value)}" for key, value in settings.items())


def short_label(settings: Mapping[str, Any]) -> str:
    """The same in less space: long names by their first letters (``learning_rate`` is ``lr``), three digits."""
    names = initials(list(settings))
    return ", ".join(f"{names[key]} {text(value, 3)}" for key, value in settings.items())


def ends(keys: Sequence[str]) -> dict[str, str]:
    """Dotted key -> its last part; the whole key where two have the same."""
    last = {key: key.rpartition(".")[2] for key in keys}
    times = Counter(last.values())
    return {key: end if times[end] == 1 else key for key, end in last.items()}


def initials(keys: Sequence[str]) -> dict[str, str]:
    """Dotted key -> its last part, a long one as its words' first letters; the longer name where two have the same."""
    whole = ends(keys)
    short = {
        key: "".join(word[0] for word in name.split("_") if word)
        if "_" in name and "." not in name and len(name) > LONG
        else name
        for key, name in whole.items()
    }
    times = Counter(short.values())
    return {key: name if times[name] == 1 else whole[key] for key, name in short.items()}


def text(value: Any, digits: int = 6) -> str:
    """One value: numbers to so many digits, lists as ``128x128``, of paths and plug-ins the name."""
    match value:
        case None:
            return "none"
        case bool():
            return "on" if value else "off"
        case float():
            return f"{value:.{digits}g}"
        case list() | tuple():
            return "x".join(text(each, digits) for each in value) or "none"
        case str():
            return re.sub(r"[^\w.+-]+", "-", Path(value.rpartition(":")[2]).stem if "/" in value else value)
        case _:
            return str(value)


def file_name(label: str) -> str:
    """A label as part of a folder's name."""
    return re.sub(r"[^\w.+=-]+", "-", label).strip("-")[:120]
