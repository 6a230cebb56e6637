"""The events of a journal: what a run records, one JSON object each; and which JSON objects are events."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable
from typing import Any

Event = dict[str, Any]

#: The form of our ids of runs, which are files' names and parts of queries.
ID = re.compile(r"[0-9A-Za-z-]{1,200}")
#: Entries of one mapping, and characters of one text.
ENTRIES, TEXT = 20_000, 20_000
STATUSES = ("FINISHED", "FAILED", "KILLED")
#: Kinds of events after which a run records nothing more, unless it is taken up again.
LAST = ("end", "delete")
#: Charts of one view, and characters of a metric's name.
CHARTS, NAME = 30, 250


def new_event(kind: str, **content: Any) -> Event:
    """An entry for a journal, with the time."""
    return {"kind": kind, "time": now(), **content}


def now() -> int:
    """Milliseconds since the epoch."""
    return int(time.time() * 1000)


def parsed(line: bytes) -> Event:
    """The event that a journal's line is; ``{}`` for anything else, so that what follows need not look."""
    try:
        event = json.loads(line)
        kind = event["kind"]
        fields = FIELDS[kind]
        whole = {"kind": kind} | {name: event[name] for name in fields}
        return whole if all(fits(whole[name]) for name, fits in fields.items()) else {}
    except (ValueError, TypeError, KeyError, RecursionError):
        return {}


def is_id(value: object) -> bool:
    """Whether it may be one of our ids."""
    return isinstance(value, str) and ID.fullmatch(value) is not None


def _whole(value: object) -> bool:
    return type(value) is int and abs(value) < 2**53


def _text(value: object) -> bool:
    """Text that can be sent: JSON may spell halves of characters."""
    try:
        return isinstance(value, str) and len(value) <= TEXT and value.encode() is not None
    except UnicodeEncodeError:
        return False


def _texts(value: object) -> bool:
    return (
        isinstance(value, dict) and len(value) <= ENTRIES
        and all(_text(key) and _text(each) for key, each in value.items())
    )  # fmt: skip


def _numbers(value: object) -> bool:
    return (
        isinstance(value, dict)
        and len(value) <= ENTRIES
        and all(_text(key) and (_number(each) or each in ("nan", "inf", "-inf")) for key, each in value.items())
    )


def _number(value: object) -> bool:
    return type(value) is float or _whole(value)


def _charts(value: object) -> bool:
    """Lists of metrics' names, by kind of chart."""
    return (
        isinstance(value, dict) and set(value) <= {"curves", "finals", "seeds"}
        and all(isinstance(names, list) and len(names) <= CHARTS for names in value.values())
        and all(_text(name) and len(name) <= NAME for names in value.values() for name in names)
    )  # fmt: skip


def _below(value: object) -> bool:
    """None, or a folder below another."""
    if value is None or not _text(value):
        return value is None
    parts = str(value).split("/")
    return all(re.fullmatch(r"[\w.-]+", part) for part in parts) and not {".", ".."} & set(parts)


#: What each kind of event has, and what it must be.
FIELDS: dict[str, dict[str, Callable[[object], bool]]] = {
    "start": {"time": _whole, "name": _text, "params": _texts, "tags": _texts,
              "parent": lambda value: value is None or is_id(value)},
    "metrics": {"time": _whole, "step": _whole, "values": _numbers},
    "artifact": {"time": _whole, "path": _text, "folder": _below},
    "model": {"time": _whole, "path": _text, "mark": is_id, "name": _text, "alias": _text, "tags": _texts,
              "description": _text},
    "summary": {"time": _whole, "step": _whole, "text": _text, "values": _numbers, "charts": _charts},
    "end": {"time": _whole, "status": lambda value: value in STATUSES},
    "delete": {"time": _whole},
}  # fmt: skip
