"""MLflow's client, which reads no longer answers than a run can need, whatever the server sends.

MLflow takes an answer whole into memory, however long it is. Its sessions are given a hook that counts; it counts for
the calls of this package alone.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import Any

#: Bytes of an answer: a run with the most metrics that are remembered, its parameters and tags has 7 million.
MOST_BYTES = 16_000_000
#: Bytes that are read at a time.
CHUNK = 1 << 16

_calls = threading.local()


class AnswerTooLongError(OSError):
    """An answer that is not read to its end."""


class Bounded:
    """A client of MLflow's whose calls end with an exception where an answer is too long."""

    def __init__(self, client: Any) -> None:
        _count_in_sessions()
        self._client = client

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._client, name)
        return _counting(found) if callable(found) else found


def _counting(call: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(call)
    def counted(*arguments: Any, **options: Any) -> Any:
        before = getattr(_calls, "count", False)
        _calls.count = True
        try:
            return call(*arguments, **options)
        finally:
            _calls.count = before

    return counted


def _count_in_sessions() -> None:
    """Give MLflow's sessions the hook."""
    from mlflow.utils import request_utils

    made = request_utils._get_request_session
    if hasattr(made, "__wrapped__"):
        return

    @functools.wraps(made)
    def session(*arguments: Any, **options: Any) -> Any:
        found = made(*arguments, **options)
        found.hooks["response"] = [_read]
        return found

    request_utils._get_request_session = session


def _read(response: Any, **options: Any) -> None:
    """Read an answer, in place of `requests`, which would read all of it.

    Raises:
        AnswerTooLongError: there is more.
    """
    if options.get("stream") or not getattr(_calls, "count", False):
        return
    content = bytearray()
    for chunk in response.iter_content(CHUNK):
        content += chunk
        if len(content) > MOST_BYTES:
            response.close()
            raise AnswerTooLongError(f"answers with more than {MOST_BYTES:,} bytes")
    response._content = bytes(content)
