"""A polygon file in: a list of polygons, each a list of rings as the file states them."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from envs.drawing import Reading
from envs.polygons.curves import ChordsError
from envs.polygons.rings import check_count, check_rings
from envs.readers.formats import BY_SUFFIX
from envs.readers.source import check_file
from envs.types import DomainError

Polygons = list[list[Any]]


def read(path: Path, edge_length: float | None = None) -> Polygons:
    """The polygons in a file.

    Args:
        path: a polygon file; its extension, in any case, tells the format.
        edge_length: what outlines are to be discretised by; None: curves are flattened for good.

    Returns:
        For each polygon its rings, the outer one first, as the file states them: nothing is checked yet.

    Raises:
        DomainError: no such file, an unknown extension, a file that is too large, broken or without a polygon.
    """
    format = BY_SUFFIX.get(path.suffix.lower())
    if format is None:
        raise DomainError(f"{path}: unknown extension {path.suffix!r}; use one of {', '.join(BY_SUFFIX)}")
    check_file(path, format.most_bytes)
    reader = import_module(f"envs.readers.{format.module}")
    try:
        with np.errstate(all="ignore"):  # numbers beyond floats are for the checks of the rings to name
            if hasattr(reader, "drawing_of_file"):
                polygons: Polygons = [list(rings) for rings in reader.drawing_of_file(path, Reading(edge_length)).polygons]
            else:
                polygons = reader.polygons_of_file(path, edge_length)
    except ChordsError as error:
        raise DomainError(f"{path}: {error}") from None
    check_rings(sum(map(len, polygons)), str(path))
    check_count(sum(len(ring) for rings in polygons for ring in rings if hasattr(ring, "__len__")), str(path))
    return polygons
