"""A polygon file in: a drawing, as the file states it."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import numpy as np

from envs.polygons.curves import ChordsError
from envs.polygons.drawing import Drawing, Reading
from envs.polygons.rings import check_count, check_rings
from envs.readers.file_check import check_file
from envs.readers.formats import BY_SUFFIX
from envs.types import DomainError


def read(path: Path, reading: Reading) -> Drawing:
    """The drawing in a file.

    Args:
        path: a polygon file; its extension, in any case, tells the format.
        reading: how.

    Returns:
        Its polygons, for each its rings, the outer one first, as the file states them, and what it says of these:
        nothing is checked yet.

    Raises:
        DomainError: no such file, an unknown extension, a file that is too large, broken or without a polygon, or ways
            of reading that its format does not have.
    """
    format = BY_SUFFIX.get(path.suffix.lower())
    if format is None:
        raise DomainError(f"{path}: unknown extension {path.suffix!r}; use one of {', '.join(BY_SUFFIX)}")
    check_file(path, format.most_bytes)
    reader = import_module(f"envs.readers.{format.module}")
    try:
        with np.errstate(all="ignore"):  # numbers beyond floats are for the checks of the rings to name
            if hasattr(reader, "drawing_of_file"):
                drawing: Drawing = reader.drawing_of_file(path, reading)
            else:
                drawing = Drawing(reader.polygons_of_file(path, reading.edge_length))
    except ChordsError as error:
        raise DomainError(f"{path}: {error}") from None
    check_rings(sum(map(len, drawing.polygons)), str(path))
    check_count(sum(len(ring) for rings in drawing.polygons for ring in rings if hasattr(ring, "__len__")), str(path))
    return drawing
