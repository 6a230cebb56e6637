"""Data in a page of HTML."""

from __future__ import annotations

import json
from typing import Any


def embedded(data: Any) -> str:
    """JSON that no name can break out of: without ``<``, which could begin a tag, and in ASCII."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
