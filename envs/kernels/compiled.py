"""How kernels are compiled: cached on disk, IEEE division, no interpreter lock.

``NUMBA_DISABLE_JIT=1`` runs the same functions as plain Python.

Numba's disk cache looks only at the file of the function it compiles, so a caller keeps the old code of a callee that
changed in another file. Kernels call each other across files here; their cache is therefore a folder named after a
digest of every file with a kernel in it, and can never be stale.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def _cache_folder() -> str:
    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256()
    for source in sorted(package.rglob("*.py")):
        text = source.read_bytes()
        if b"envs.kernels" in text or source.name == "types.py":
            digest.update(text)
    home = package / "__pycache__"
    try:
        home.mkdir(exist_ok=True)
        writable = os.access(home, os.W_OK)
    except OSError:
        writable = False
    root = home if writable else Path(tempfile.gettempdir()) / f"freemesh-kernels-{os.getuid()}"
    return str(root / f"kernels-{digest.hexdigest()[:16]}")


_CACHE = os.environ.get("NUMBA_CACHE_DIR") or _cache_folder()


def _compile(function: F, **options: Any) -> F:
    # The folder is read while decorating; other users of numba in this process keep their own.
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = _CACHE
    try:
        return cast(F, njit(cache=True, error_model="numpy", nogil=True, **options)(function))
    finally:
        numba.config.CACHE_DIR = before


def compiled(function: F) -> F:
    """Compile on first call and keep the machine code."""
    return _compile(function)


def inlined(function: F) -> F:
    """Compile, and fold the body into its callers."""
    return _compile(function, forceinline=True)
