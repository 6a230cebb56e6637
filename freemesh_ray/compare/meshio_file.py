"""A mesh file as meshio reads it, in a process with limits: the files are somebody else's.

Its readers believe counts and sizes that a file states, unpack what it has packed, and expand the XML it is written in.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import meshio
import numpy as np

from envs.types import Floats
from freemesh_ray.compare.child_process import ChildDiedError, Limits, in_child_process

#: What a file may take.
LIMITS = Limits(memory=8 * 2**30, seconds=60)

#: Elements by meshio's names, each (m, corners) nodes.
Cells = Sequence[tuple[str, np.ndarray]]


def read_meshio(path: Path) -> tuple[Floats, Cells]:
    """A file's points (n, 2 or 3) and elements.

    Raises:
        ValueError: it cannot be read, or takes too much time or memory.
    """
    try:
        found = in_child_process(_read, path, limits=LIMITS)
    except ChildDiedError:
        raise ValueError("it takes too much time or memory") from None
    if isinstance(found, str):
        raise ValueError(found)
    return found


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
