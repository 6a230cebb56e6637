"""meshio in a process of its own that may take neither much time nor much memory: the files are somebody else's.

Its readers believe counts and sizes that a file states, unpack what it has packed, and expand the XML it is written in.
"""

from __future__ import annotations

import multiprocessing
import resource
import signal
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import meshio
import numpy as np

from envs.types import Floats

#: Bytes of memory and seconds of processor time that a file may take.
MOST_MEMORY = 8 * 2**30
MOST_SECONDS = 60

#: Elements by meshio's names, each (m, corners) nodes.
Cells = Sequence[tuple[str, np.ndarray]]


def read_confined(path: Path) -> tuple[Floats, Cells]:
    """A file's points (n, 2 or 3) and elements, as meshio reads them.

    Raises:
        ValueError: it cannot be read, or takes too much time or memory.
    """
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _confine) as pool:
        try:
            found = pool.submit(_read, path).result()
        except BrokenProcessPool:
            raise ValueError("it takes too much time or memory") from None
    if isinstance(found, str):
        raise ValueError(found)
    return found


def _confine() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C is the parent's: the child just ends
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_SECONDS, MOST_SECONDS))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _read(path: Path) -> tuple[Floats, Cells] | str:
    """What the file holds, or why it cannot be read; exceptions of any library need not survive the way back."""
    try:
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):  # meshio prints what it raises
            mesh = meshio.read(path)
        cells = [(block.type, np.asarray(block.data, dtype=np.int64)) for block in mesh.cells]
        return np.asarray(mesh.points, dtype=np.float64), cells
    except SystemExit:  # meshio leaves the program where no reader fits
        return "unknown format"
    except MemoryError:
        return "it takes too much memory"
    except Exception as error:  # nor is what broken files make it raise documented
        return str(error) or type(error).__name__
