"""bfloat16 numbers in kernels against torch's."""

from __future__ import annotations

import math

import numpy as np
import torch
from hypothesis import example, given
from hypothesis import strategies as st

from freemesh_ray.algorithms.bfloat16_bits import paired, rounded, widened

STRANGE = [math.nan, -math.nan, math.inf, -math.inf, 0.0, -0.0, 1e-40, 3.3e38, 1.00390625, 1.01171875]


@given(st.lists(st.floats(width=32) | st.sampled_from(STRANGE).map(lambda x: float(torch.tensor(x))), min_size=1))
@example(STRANGE)
def test_numbers_are_rounded_as_torch_rounds_them(numbers: list[float]) -> None:
    """What is no number stays none."""
    for number in torch.tensor(numbers):
        found = widened(rounded(np.float32(number)))
        torch.testing.assert_close(
            torch.tensor(found), number.bfloat16().float(), rtol=0, atol=0, equal_nan=True, check_dtype=False
        )


@given(st.integers(-(2**15), 2**15 - 1), st.integers(-(2**15), 2**15 - 1))
def test_two_lie_side_by_side(first: int, second: int) -> None:
    both = np.array([paired(np.int16(first), np.int16(second))], np.int32)
    assert both.view(np.int16).tolist() == [first, second]
