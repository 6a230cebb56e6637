"""bfloat16 numbers in compiled kernels, which NumPy has none of: their 16 bits, the upper half of a float32's, as
integers. A number is above 0 where its bits are.
"""

from __future__ import annotations

import numpy as np

from envs.kernels.jit import inlined

_UPPER, _ONE, _BELOW_HALF, _QUIET = np.int32(16), np.int32(1), np.int32(0x7FFF), np.int16(0x7FC0)


@inlined
def widened(bits: np.int16) -> np.float32:
    """A bfloat16 number as float32."""
    return np.int32(np.int32(bits) << _UPPER).view(np.float32)


@inlined
def rounded(value: np.float32) -> np.int16:
    """The nearest bfloat16 number, of two the even one; what is no number stays none."""
    bits = np.float32(value).view(np.int32)
    nearest = np.int16(np.int32(bits + _BELOW_HALF + np.int32(np.int32(bits >> _UPPER) & _ONE)) >> _UPPER)
    return nearest if value == value else _QUIET


@inlined
def paired(first: np.int16, second: np.int16) -> np.int32:
    """Two numbers side by side in memory, as one integer."""
    return np.int32(np.int32(second) << _UPPER) | np.int32(np.int32(first) & np.int32(0xFFFF))
