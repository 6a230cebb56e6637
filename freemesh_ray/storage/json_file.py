"""JSON files of this program, which may come from anybody: how much there is to read is checked before it is read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from freemesh_ray.storage.regular_file import opened

#: Bytes of a file at most, and values in it.
MOST_BYTES, MOST_VALUES = 20_000_000, 1_000_000


def read_text(path: Path, most: int = MOST_BYTES) -> str:
    """The text of a regular file of ``most`` bytes at most; bytes that are no UTF-8 become U+FFFD.

    Raises:
        ValueError: it is something else, as a pipe, or longer.
        OSError: it cannot be read.
    """
    with opened(path) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise ValueError(f"more than {most:,} bytes")
    return content.decode("utf-8", errors="replace")


def read_json(path: Path) -> Any:
    """The value in a file.

    Raises:
        ValueError: as `read_text`, or it holds no JSON, more than ``MOST_VALUES`` values, or nests them too deep.
        OSError: it cannot be read.
    """
    return parsed(read_text(path))


def parsed(text: str) -> Any:
    """The value in a text.

    Raises:
        ValueError: it is no JSON, more than ``MOST_VALUES`` values, or they are nested too deep.
    """
    if text.count(",") + text.count("[") + text.count("{") > MOST_VALUES:
        raise ValueError(f"more than {MOST_VALUES:,} values")
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("nested too deep") from None
