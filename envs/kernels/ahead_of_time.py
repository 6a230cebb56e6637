"""Compiling ahead of use: whether there is anything to compile, by one process at a time, and how far it is."""

from __future__ import annotations

import dis
import fcntl
import gc
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from itertools import pairwise
from types import ModuleType

from numba.core.event import Event, Listener, install_listener

from envs.kernels.inner import Kernel
from envs.kernels.jit import BASE, cache_folder

#: Is told how many kernels are compiled, and how many there are to compile.
Tell = Callable[[int, int], None]


def missing(entries: Iterable[Kernel]) -> list[Kernel]:
    """Those that have no machine code yet."""
    return [kernel for kernel in entries if not kernel.is_compiled()]


def needed(entries: Iterable[Kernel]) -> set[Kernel]:
    """The kernels, and all that they call."""
    found: set[Kernel] = set()
    waiting = list(entries)
    while waiting:
        if (kernel := waiting.pop()) not in found:
            found.add(kernel)
            waiting += called(kernel)
    return found


def called(kernel: Kernel) -> Iterator[Kernel]:
    """The kernels that a kernel's code names, on their own or as a module's attribute."""
    for load, then in pairwise(dis.get_instructions(kernel.py_func)):
        if load.opname == "LOAD_GLOBAL":
            value = kernel.py_func.__globals__.get(load.argval)
            if isinstance(value, ModuleType):
                value = getattr(value, str(then.argval), None)
            if isinstance(value, Kernel):
                yield value


class Count(Listener):
    """Counts what is compiled of some kernels."""

    def __init__(self, kernels: set[Kernel], tell: Tell) -> None:
        self._waiting, self._total, self._tell = set(kernels), len(kernels), tell

    def on_start(self, event: Event) -> None:
        """Numba begins with a kernel."""

    def on_end(self, event: Event) -> None:
        """Numba has compiled a kernel."""
        self.done({event.data["dispatcher"]})

    def done(self, kernels: set[Kernel]) -> None:
        """Tell, if any of these were waited for."""
        if kernels & self._waiting:
            self._waiting -= kernels
            self._tell(self._total - len(self._waiting), self._total)


@contextmanager
def compiling(entries: Iterable[Kernel], tell: Tell) -> Iterator[None]:
    """Tell how far it is while the body calls kernels, of which some have no machine code yet.

    Another process that is here already is waited for; what it has compiled is loaded then.
    """
    kernels = needed(missing(entries))
    tell(0, len(kernels))
    count = Count(kernels, tell)
    with alone(), seldom_collected(), install_listener("numba:compile", count):
        yield
    count.done(kernels)


@contextmanager
def seldom_collected() -> Iterator[None]:
    """Let go of garbage now and then only: a quarter of the time would go into looking for it."""
    before = gc.get_threshold()
    gc.set_threshold(20_000, 10, 1_000)
    try:
        yield
    finally:
        gc.set_threshold(*before)


@contextmanager
def alone() -> Iterator[None]:
    """Wait until no other process is in here; do not, where files cannot be locked."""
    place = None
    with suppress(OSError):
        place = os.open(cache_folder(BASE), os.O_RDONLY)
        fcntl.flock(place, fcntl.LOCK_EX)
    try:
        yield
    finally:
        if place is not None:
            os.close(place)
