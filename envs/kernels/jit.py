"""How kernels are compiled: cached on disk, IEEE division, no interpreter lock.

``NUMBA_DISABLE_JIT=1`` runs the same functions as plain Python.

Numba's disk cache looks only at the file of the function it compiles, so a caller keeps the old code of a callee that
changed in another file. Kernels call each other across files here, and kernels of other packages call those of this
one; each package's cache is therefore a folder named after a digest of every file with a kernel in it, its own and
this package's, and can never be stale. Constants that kernels use belong into files with kernels, or into ``types.py``.

``NUMBA_CACHE_DIR`` is another home for these folders. What they hold does not depend on where the source lies, so that
copies of it, as every job on a cluster has one, share the machine code.
"""

from __future__ import annotations

import functools
import hashlib
import inspect
import os
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core.caching import UserProvidedCacheLocator

from envs.kernels.inner import InnerKernel, Kernel

F = TypeVar("F", bound=Callable[..., Any])

#: The package that all kernels build on.
BASE = Path(__file__).resolve().parent.parent

_OPTIONS = {"nopython": True, "error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}
_LEAN = {"_nrt": False}
_FUSED = {"fastmath": {"contract"}}
_REORDERED = {"fastmath": {"contract", "reassoc"}}
_KERNELS: list[Kernel] = []


def _kernel_texts(package: Path) -> Iterator[bytes]:
    for source in sorted(package.rglob("*.py")):
        text = source.read_bytes()
        if b"envs.kernels" in text or source.name == "types.py":
            yield text


@functools.cache
def cache_folder(package: Path = BASE) -> str:
    """Where the machine code of a top-level package's kernels is kept."""
    digest = hashlib.sha256()
    for folder in dict.fromkeys((BASE, package)):
        for text in _kernel_texts(folder):
            digest.update(text)
    elsewhere = os.environ.get("NUMBA_CACHE_DIR")
    home = Path(elsewhere) if elsewhere else package / "__pycache__"
    try:
        home.mkdir(parents=True, exist_ok=True)
        writable = os.access(home, os.W_OK)
    except OSError:
        writable = False
    root = home if writable else _own_place()
    return str(root / f"kernels-{digest.hexdigest()[:16]}")


def _own_place() -> Path:
    """A folder for temporary files that no other user can put machine code into; where there is none, no folder."""
    with suppress(OSError):
        place = Path(tempfile.gettempdir()) / f"freemesh-kernels-{os.getuid()}"
        place.mkdir(mode=0o700, exist_ok=True)
        about = place.lstat()
        if stat.S_ISDIR(about.st_mode) and about.st_uid == os.getuid() and not about.st_mode & 0o022:
            return place
    return Path(os.devnull)


class ByModule(UserProvidedCacheLocator):
    """Within the cache's folder, a folder named after the function's package; Numba's own is named after its path."""

    def __init__(self, py_func: Callable[..., Any], py_file: str) -> None:
        super().__init__(py_func, py_file)
        self._cache_path = os.path.join(numba.config.CACHE_DIR, py_func.__module__.rpartition(".")[0])


def _package_of(function: Callable[..., Any]) -> Path:
    """The folder of the top-level package that a function is defined in."""
    source = Path(inspect.getfile(function)).resolve()
    return source.parents[max(0, len(function.__module__.split(".")) - 2)]


def _for_python(function: Callable[..., Any], **options: Any) -> Kernel:
    """A kernel that Python calls, its machine code kept."""
    # They are read while caching is enabled; other users of numba in this process keep their own.
    before = numba.config.CACHE_DIR, numba.config.CACHE_LOCATOR_CLASSES
    numba.config.CACHE_DIR = cache_folder(_package_of(function))
    numba.config.CACHE_LOCATOR_CLASSES = f"{__name__}.{ByModule.__name__}"
    try:
        kernel = Kernel(function, targetoptions=_OPTIONS | options)
        kernel.enable_caching()
    finally:
        numba.config.CACHE_DIR, numba.config.CACHE_LOCATOR_CLASSES = before
    return kernel


def _for_kernels(function: Callable[..., Any], **options: Any) -> Kernel:
    """A kernel that other kernels call."""
    return InnerKernel(function, _OPTIONS | _LEAN | options, lambda: _for_python(function, **options))


def _registered(make: Callable[..., Kernel], function: F, **options: Any) -> F:
    """The kernel that is made of a function; the function itself where nothing is compiled."""
    if numba.config.DISABLE_JIT:
        return function
    kernel = make(function, **options)
    _KERNELS.append(kernel)
    return cast(F, kernel)


def kernels() -> list[Kernel]:
    """All kernels of the modules imported so far."""
    return list(_KERNELS)


def compiled(function: F) -> F:
    """Compile for Python, on the first call, and keep the machine code.

    The function may neither make nor return arrays: there are no reference counts, which loops over arrays in tuples
    can spend most of their time on.
    """
    return _registered(_for_python, function, **_LEAN)


def compiled_fused(function: F) -> F:
    """Compile like :func:`compiled`, with x * y + z rounded once: for sums that nothing compares bit for bit."""
    return _registered(_for_python, function, **_LEAN, **_FUSED)


def compiled_sums(function: F) -> F:
    """Compile like :func:`compiled_fused`, and add up in the order that is fastest, the same at every call."""
    return _registered(_for_python, function, **_LEAN, **_REORDERED)


def inner(function: F) -> F:
    """Compile for other kernels, with each that Python calls; arrays that the function returns are its arguments'."""
    return _registered(_for_kernels, function)


def inner_fused(function: F) -> F:
    """Compile like :func:`inner`, with x * y + z rounded once."""
    return _registered(_for_kernels, function, **_FUSED)


def inlined(function: F) -> F:
    """Compile like :func:`inner`, and fold the body into its callers."""
    return _registered(_for_kernels, function, forceinline=True)
