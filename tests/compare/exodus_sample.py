"""Exodus II files as SAND92-2137 documents them, appendix A."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.io import netcdf_file


def write_exodus(
    path: Path, points: np.ndarray, blocks: Sequence[tuple[str, np.ndarray]], *, old: bool = False, version: int = 2
) -> None:
    """Write points (n, 2) and blocks of elements, each a type and nodes (m, k) counted from 0.

    Args:
        path: where to.
        points: them.
        blocks: them.
        old: coordinates as one variable, as in versions before 3.
        version: 1 for netCDF's classic format, 2 for its one of 64-bit offsets.
    """
    with netcdf_file(path, "w", version=version) as file:
        file.title = "a sample"
        file.api_version, file.version, file.floating_point_word_size = np.float32(4.98), np.float32(4.98), 8
        file.createDimension("time_step", None)
        file.createDimension("len_string", 33)
        file.createDimension("num_dim", 2)
        file.createDimension("num_nodes", len(points))
        file.createDimension("num_elem", sum(len(nodes) for _, nodes in blocks))
        file.createDimension("num_el_blk", len(blocks))
        file.createVariable("eb_prop1", "i", ("num_el_blk",))[:] = np.arange(1, len(blocks) + 1)
        if old:
            file.createVariable("coord", "d", ("num_dim", "num_nodes"))[:] = points.T
        else:
            for axis, values in zip("xy", points.T, strict=True):
                file.createVariable(f"coord{axis}", "d", ("num_nodes",))[:] = values
        for number, (kind, nodes) in enumerate(blocks, 1):
            file.createDimension(f"num_el_in_blk{number}", len(nodes))
            file.createDimension(f"num_nod_per_el{number}", nodes.shape[1])
            places = (f"num_el_in_blk{number}", f"num_nod_per_el{number}")
            connect = file.createVariable(f"connect{number}", "i", places)
            connect[:] = nodes + 1
            connect.elem_type = kind
