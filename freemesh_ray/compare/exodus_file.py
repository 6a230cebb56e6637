"""The elements of an Exodus II file: netCDF, in its classic format, which needs no library beyond SciPy.

A node is a place in ``coordx`` and ``coordy``, in older files a column of ``coord``. A block of elements is a variable
``connect1``, ``connect2`` and so on, a row of nodes an element, counted from 1, with the element's type as attribute
``elem_type`` (Schoof, Yarberry: Exodus II, SAND92-2137, appendix A).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import netcdf_file

from envs.types import Floats, Ints

#: The first bytes of netCDF's classic formats, and of HDF5, in which its newer ones are.
CLASSIC, HDF5 = b"CDF", b"\x89HDF"

#: Kinds of element that lie in a surface.
SURFACE = re.compile(r"(QUAD|SHELL|TRI)", re.IGNORECASE)

#: Nodes of an element -> its corners.
CORNERS = {3: 3, 6: 3, 7: 3, 4: 4, 8: 4, 9: 4}


def read_exodus(path: Path) -> tuple[Floats, Ints, Ints]:
    """Nodes (n, 2), quadrilaterals (m, 4) and triangles (t, 3) of a file; nodes at edge middles are left out.

    Raises:
        ValueError: it is no such file, or an element is of a node that is not there.
        OSError: it cannot be read.
    """
    with open(path, "rb") as file:
        begin = file.read(4)
    if begin == HDF5:
        raise ValueError("netCDF-4 in place of netCDF's classic format")
    if begin[:3] != CLASSIC:
        raise ValueError("no netCDF file")
    blocks: dict[int, list[Ints]] = {3: [np.empty((0, 3), np.int64)], 4: [np.empty((0, 4), np.int64)]}
    try:
        with netcdf_file(path, "r", mmap=False) as file:
            points = _points(file.variables)
            for name, variable in file.variables.items():
                kind = getattr(variable, "elem_type", b"").decode("ascii", "replace")
                corners = CORNERS.get(variable.shape[-1], 0) if variable.shape else 0
                if name.startswith("connect") and SURFACE.match(kind) and corners:
                    blocks[corners].append(np.array(variable[:, :corners], dtype=np.int64) - 1)
    except Exception as error:  # what broken files make SciPy raise is not documented
        raise ValueError(f"a broken file ({error})") from None
    quads, triangles = np.concatenate(blocks[4]), np.concatenate(blocks[3])
    used = np.concatenate([quads.ravel(), triangles.ravel()])
    if len(used) and not 0 <= used.min() <= used.max() < len(points):
        raise ValueError("an element of a node that is not there")
    return points, quads, triangles


def _points(variables: Mapping[str, Any]) -> Floats:
    if "coord" in variables:
        return np.array(variables["coord"][:2], dtype=np.float64).T
    return np.array([variables["coordx"][:], variables["coordy"][:]], dtype=np.float64).T
