"""Sizes as a user says them: an expression in x and y, or a file."""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path

import numpy as np

from envs.polygons.size_cells import Size
from envs.readers.file_check import check_file
from envs.readers.size_expression import expression
from envs.types import DomainError, Floats

#: The file beside this one that reads each, and its most bytes.
READERS = {".csv": ("size_points", 100_000_000), ".pos": ("size_view", 100_000_000), ".msh": ("size_mesh", 200_000_000)}

#: What help and documents say of it.
MEANING = (
    "an expression in x and y, as '0.1 + 0.2 * hypot(x, y)'; a .csv of rows x, y, size; a Gmsh view, .pos; or a .msh "
    "with node data"
)


def size_of(given: str | os.PathLike[str]) -> Size | Floats:
    """What a text or a path says: a function of (m, 2) places to (m,) sizes, or (m, 3) rows x, y and a size.

    Raises:
        DomainError: a file that is not there, or broken.
        UserError: an expression that is not understood, or sizes that are none.
    """
    path = Path(given)
    suffix = path.suffix.lower()
    if isinstance(given, str) and suffix not in READERS:
        return expression(given)
    if suffix not in READERS:
        raise DomainError(f"{path}: no file of sizes; use one of {', '.join(READERS)}")
    module, most = READERS[suffix]
    check_file(path, most)
    with np.errstate(all="ignore"):
        found: Size | Floats = import_module(f"envs.readers.{module}").sizes_of_file(path)
    return found
