"""A call in a process of its own, perhaps one that may take neither much time nor much memory."""

from __future__ import annotations

import multiprocessing
import resource
import signal
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any, TypeVar

Result = TypeVar("Result")


class ChildDiedError(RuntimeError):
    """The process ended before its call did."""


@dataclass(frozen=True)
class Limits:
    """What a process may take.

    Attributes:
        memory: bytes of addresses.
        seconds: whole seconds of processor time.
    """

    memory: int
    seconds: int


def in_child_process(call: Callable[..., Result], *arguments: Any, limits: Limits | None = None) -> Result:
    """``call(*arguments)`` in a fresh process; the call, its arguments and its result are pickled.

    Raises:
        ChildDiedError: it crashed, or took more than its limits.
    """
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _begin, (limits,)) as pool:
        try:
            return pool.submit(call, *arguments).result()
        except BrokenProcessPool:
            raise ChildDiedError("its process died") from None


def _begin(limits: Limits | None) -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C is the parent's: the child just ends
    if limits is not None:
        resource.setrlimit(resource.RLIMIT_AS, (limits.memory, limits.memory))
        resource.setrlimit(resource.RLIMIT_CPU, (limits.seconds, limits.seconds))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
