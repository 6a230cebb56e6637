"""NumPy archives (``.npz``) from anywhere: plain numbers and texts of a bounded size; nothing is unpickled."""

from __future__ import annotations

import math
import os
import sys
from io import BytesIO

import numpy as np
from numpy.lib import format as npy

from freemesh_ray.storage import regular_file
from freemesh_ray.storage.zip_archive import DAMAGES, opened

#: Bytes of an archive at most, packed and unpacked.
MOST_BYTES = 50_000_000

#: Arrays in it at most.
MOST_ARRAYS = 1000

#: What its arrays can hold: truth values, whole numbers, floats, text.
KINDS = "biufU"

HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def read_arrays(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """The arrays of an archive by name, read-only.

    Nothing is allocated for what a header merely says is there.

    Raises:
        ValueError: it is no archive, damaged, too large when unpacked, or holds something else than numbers and texts.
    """
    with regular_file.opened(path) as file:
        if os.fstat(file.fileno()).st_size > MOST_BYTES:
            raise ValueError(f"larger than {MOST_BYTES:,} bytes")
        try:
            with opened(file, MOST_BYTES) as archive:
                members = archive.infolist()
                if len(members) > MOST_ARRAYS:
                    raise ValueError(f"more than {MOST_ARRAYS:,} arrays")
                return {member.filename.removesuffix(".npy"): array_in(archive.read(member)) for member in members}
        except DAMAGES as error:
            raise ValueError(f"no sound archive: {error}") from error


def array_in(content: bytes) -> np.ndarray:
    """The array in the content of a ``.npy`` file.

    Raises:
        ValueError: it is none, or one of something else than `KINDS`.
    """
    file = BytesIO(content)
    read_header = HEADERS.get(npy.read_magic(file))
    if read_header is None:
        raise ValueError("an array of an unknown version")
    try:
        shape, fortran_order, dtype = read_header(file)
    except Exception as error:  # what a damaged one makes NumPy and its parser raise is not documented
        raise ValueError("an array with a damaged header") from error
    if dtype.kind not in KINDS or any(length < 0 for length in shape):
        raise ValueError(f"an array of {dtype.kind!r}, which is neither numbers nor text")
    count = math.prod(shape)
    if count * dtype.itemsize != len(content) - file.tell():
        raise ValueError("an array of another size than its header says")
    flat = np.frombuffer(content, dtype, count, file.tell()) if count and dtype.itemsize else np.zeros(count, dtype)
    # NumPy believes every number to be a letter; Python's texts with one that is none take the process along.
    if (
        dtype.kind == "U"
        and flat.size
        and flat.view(np.dtype("u4").newbyteorder(dtype.byteorder)).max() > sys.maxunicode
    ):
        raise ValueError("a text with what is no letter")
    return flat.reshape(shape, order="F" if fortran_order else "C")
