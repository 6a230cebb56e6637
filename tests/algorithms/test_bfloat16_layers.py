"""The compiled loops between a network's products against torch's own operations."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st

from freemesh_ray.algorithms import bfloat16_layers, compiled_bfloat16_layers

BFLOAT16 = torch.bfloat16
STRANGE = [math.nan, -math.nan, math.inf, -math.inf, 0.0, -0.0, 1e-40, 3.3e38, 1.00390625, 1.01171875]


class Layer:
    """A last hidden layer's outputs, their gradient, and the last layer.

    Args:
        count: networks in a stack; 0 where there is none.
        rows, units, outputs: sizes.
        seed: of the numbers.
    """

    def __init__(self, count: int, rows: int, units: int, outputs: int, seed: int) -> None:
        self._generator = torch.Generator().manual_seed(seed)
        lead = (count,) if count else ()
        self.x = self._drawn(*lead, rows, units).relu().to(BFLOAT16)
        self.passed = self._drawn(*lead, rows, units).to(BFLOAT16)
        self.gradient = self._drawn(*lead, rows, outputs)
        self.weight = self._drawn(*lead, units, outputs)
        self.bias = self._drawn(*lead, 1, outputs) if count else self._drawn(outputs)

    def _drawn(self, *sizes: int) -> torch.Tensor:
        return torch.randn(sizes, generator=self._generator)

    def results(self, layers: Any) -> dict[str, torch.Tensor]:
        """What a module's functions make of them, by name."""
        passed = self.passed.clone()
        return {
            "last": layers.last(self.x, self.weight, self.bias),
            **dict(zip(("d_weight", "d_bias"), layers.last_gradients(self.x, self.gradient), strict=True)),
            **dict(zip(("before", "sums"), layers.before_last(self.x, self.gradient, self.weight), strict=True)),
            "masked sums": layers.masked(passed, self.x),
            "masked": passed,
        }


SIZES = st.builds(
    Layer, st.integers(0, 3), st.integers(1, 40), st.integers(1, 70), st.integers(1, 7), st.integers(0, 2**32)
)


@given(SIZES)
@example(Layer(2, 256, 128, 1, 0))
@example(Layer(0, 256, 128, 6, 0))
def test_they_are_torch_s_operations(layer: Layer) -> None:
    expected = layer.results(bfloat16_layers)
    for name, found in layer.results(compiled_bfloat16_layers).items():
        wanted = expected[name]
        assert (found.dtype, found.shape, found.is_contiguous()) == (wanted.dtype, wanted.shape, True), name
        # Sums are in another order; a number near the middle of two bfloat16 ones is then rounded to either.
        tolerance = 1e-2 if name in ("before", "sums") else 1e-4
        torch.testing.assert_close(found, wanted, rtol=tolerance, atol=tolerance, msg=lambda m, n=name: f"{n}: {m}")
    assert torch.equal(layer.results(compiled_bfloat16_layers)["masked"], expected["masked"])


@given(SIZES)
def test_they_come_to_the_same_bits_again(layer: Layer) -> None:
    first = layer.results(compiled_bfloat16_layers)
    for name, again in layer.results(compiled_bfloat16_layers).items():
        assert torch.equal(first[name], again), name


@given(st.lists(st.floats(width=32) | st.sampled_from(STRANGE).map(lambda x: float(torch.tensor(x))), min_size=1))
@example(STRANGE)
def test_numbers_are_rounded_as_torch_rounds_them(numbers: list[float]) -> None:
    """What is no number, too: it stays none."""
    gradient = torch.tensor(numbers).unsqueeze(-1)
    x, weight = torch.ones(len(numbers), 1, dtype=BFLOAT16), torch.ones(1, 1)
    found, _ = compiled_bfloat16_layers.before_last(x, gradient, weight)
    torch.testing.assert_close(found, gradient.to(BFLOAT16), rtol=0, atol=0, equal_nan=True)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("where", ["x", "passed", "gradient", "weight", "bias"])
def test_what_is_no_number_goes_where_it_goes_with_torch(where: str, value: float) -> None:
    layer = Layer(2, 9, 21, 2, 0)
    getattr(layer, where)[1, 0, 0] = value
    expected = layer.results(bfloat16_layers)
    for name, found in layer.results(compiled_bfloat16_layers).items():
        assert torch.equal(found.isfinite(), expected[name].isfinite()), name


def turned(tensor: torch.Tensor) -> torch.Tensor:
    """The same numbers, column by column."""
    return tensor.mT.contiguous().mT


@pytest.mark.parametrize("order", [turned, lambda tensor: torch.cat([tensor, tensor], dim=-1).chunk(2, dim=-1)[0]])
def test_however_they_lie_in_memory(order: Callable[[torch.Tensor], torch.Tensor]) -> None:
    layer, other = Layer(2, 9, 21, 3, 0), Layer(2, 9, 21, 3, 0)
    for name in ("x", "gradient", "weight"):
        setattr(other, name, order(getattr(other, name)))
    expected = layer.results(compiled_bfloat16_layers)
    for name, found in other.results(compiled_bfloat16_layers).items():
        torch.testing.assert_close(found, expected[name], rtol=1e-5, atol=1e-5)
