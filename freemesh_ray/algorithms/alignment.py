"""Where numbers lie in memory: the last bits of a matrix product depend on it, and its speed.

MKL takes other code for operands that begin at other addresses, and sums in another order. It promises the same bits
again only for operands that begin at a multiple of 64 bytes, as torch's own do. NumPy's begin at any multiple of 16,
those that a message brought at any of 8.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch

BYTES = 64


def aligned(tensor: torch.Tensor) -> torch.Tensor:
    """The tensor itself if it begins at a multiple of BYTES, else a copy that does."""
    return tensor.clone() if tensor.data_ptr() % BYTES else tensor


def aligned_empty(shape: Sequence[int], dtype: type[np.generic]) -> np.ndarray:
    """An array of any content that begins at a multiple of BYTES: registers and tiles are filled from elsewhere in up
    to five times the time.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    memory = np.empty(size + BYTES, np.uint8)
    first = -memory.ctypes.data % BYTES
    return memory[first : first + size].view(dtype).reshape(shape)


def aligned_zeros(shape: Sequence[int], dtype: type[np.generic]) -> np.ndarray:
    """The same, of zeros."""
    array = aligned_empty(shape, dtype)
    array.fill(0)
    return array
