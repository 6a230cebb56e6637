"""Networks in compiled passes against products of the same rounded numbers, and against those of float32 ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from freemesh_ray.algorithms import alignment, dot_products, tiles
from freemesh_ray.algorithms.compiled_mlp import CompiledMlp
from freemesh_ray.algorithms.networks import Mlp, MlpStack

#: What multiplies, by the type that tells kernels so.
PROCESSORS = {"tiles": tiles, "dot products": dot_products}


@pytest.fixture(params=PROCESSORS)
def processor(request: pytest.FixtureRequest) -> np.ndarray:
    """Every kind of instruction that this processor has."""
    multiplies = PROCESSORS[request.param]
    if not multiplies.available():
        pytest.skip(f"this processor has no {request.param} of bfloat16 numbers")
    return multiplies.SHAPE


class Case:
    """A network, what it takes, and the gradient of its output.

    Args:
        count: networks in a stack; 0 where there is none.
        rows, sizes: of the input, every hidden layer and the output.
        seed: of the numbers.
    """

    def __init__(self, count: int, rows: int, sizes: list[int], seed: int = 0) -> None:
        torch.manual_seed(seed)
        inputs, *hidden, outputs = sizes
        self.network = MlpStack(count, inputs, hidden, outputs) if count else Mlp(inputs, hidden, outputs)
        self.x = torch.randn(rows, inputs)
        self.gradient = torch.randn(*self.network.lead, rows, outputs)

    def results(self, evaluated: Any) -> dict[str, torch.Tensor]:
        """What a network's methods make of them, by name."""
        trace = evaluated.trace(self.x)
        gradients = evaluated.backward(trace, self.gradient)
        return {
            "output": trace[-1],
            **dict(zip(dict(self.network.named_parameters()), gradients, strict=True)),
            "input": evaluated.backward_to_input(trace, self.gradient),
        }


class Rounded:
    """The same with torch's products of float32 numbers, which are rounded before."""

    def __init__(self, network: Mlp) -> None:
        self._network = network

    def trace(self, x: torch.Tensor) -> list[torch.Tensor]:
        values = [near(x).expand(*self._network.lead, *x.shape)]
        for weight, bias in zip(list(self._network.weights)[:-1], list(self._network.biases)[:-1], strict=True):
            values.append(near((values[-1] @ near(weight) + bias).relu()))
        return [*values, values[-1] @ self._network.weights[-1] + self._network.biases[-1]]

    def backward(self, trace: list[torch.Tensor], gradient: torch.Tensor) -> list[torch.Tensor]:
        weights, biases = [trace[-2].mT @ gradient], [gradient.sum(dim=-2, keepdim=True)]
        for i, passed in self._passed(trace, gradient):
            weights.append(trace[i].mT @ passed)
            biases.append(passed.sum(dim=-2, keepdim=True))
        found = [*weights[::-1], *biases[::-1]]
        shapes = [parameter.shape for parameter in self._network.parameters()]
        return [one.reshape(shape) for one, shape in zip(found, shapes, strict=True)]

    def backward_to_input(self, trace: list[torch.Tensor], gradient: torch.Tensor) -> torch.Tensor:
        *_, (_, passed) = self._passed(trace, gradient)
        found = passed @ near(self._network.weights[0]).mT
        return found.sum(dim=0) if self._network.lead else found

    def _passed(self, trace: list[torch.Tensor], gradient: torch.Tensor) -> Any:
        weights = list(self._network.weights)
        passed = gradient @ weights[-1].mT
        for i in range(len(weights) - 2, -1, -1):
            passed = near(passed * (trace[i + 1] > 0))
            yield i, passed
            passed = passed @ near(weights[i]).mT


def near(x: torch.Tensor) -> torch.Tensor:
    """The nearest bfloat16 numbers."""
    return x.detach().bfloat16().float()


CASES = st.builds(
    Case,
    st.integers(0, 3),
    st.integers(1, 70),
    st.lists(st.integers(1, 70), min_size=3, max_size=5),
    st.integers(0, 2**32),
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(case=CASES)
@example(case=Case(0, 256, [15, 128, 128, 128, 6]))
@example(case=Case(2, 256, [18, 128, 128, 128, 1]))
def test_they_are_products_of_rounded_numbers(processor: np.ndarray, case: Case) -> None:
    expected = case.results(Rounded(case.network))
    for name, found in case.results(CompiledMlp(case.network, processor)).items():
        wanted = expected[name].detach()
        assert (found.dtype, found.shape) == (torch.float32, wanted.shape), name
        # Sums are in another order; a number near the middle of two bfloat16 ones is then rounded to either.
        difference = float((found - wanted).norm())
        assert difference <= 0.01 * float(wanted.norm()) + 1e-4, name


@pytest.mark.parametrize(("count", "sizes"), [(0, [15, 128, 128, 128, 6]), (2, [18, 128, 128, 128, 1])])
def test_they_differ_from_float32_by_rounding_alone(processor: np.ndarray, count: int, sizes: list[int]) -> None:
    case = Case(count, 256, sizes)
    expected = case.results(case.network)
    for name, found in case.results(CompiledMlp(case.network, processor)).items():
        wanted = expected[name].detach()
        assert float((found - wanted).norm() / wanted.norm()) < (0.01 if name == "output" else 0.12), name


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(case=CASES)
def test_they_come_to_the_same_bits_again(processor: np.ndarray, case: Case) -> None:
    first, again = (
        case.results(CompiledMlp(case.network, processor)),
        case.results(CompiledMlp(case.network, processor)),
    )
    assert all(torch.equal(first[name], again[name]) for name in first)


def test_the_first_rows_of_a_trace_are_a_trace(processor: np.ndarray) -> None:
    case = Case(0, 64, [15, 40, 33, 6])
    evaluated = CompiledMlp(case.network, processor)
    for rows in (32, 17):
        whole = [part[:rows] for part in evaluated.trace(case.x)]
        own = evaluated.trace(case.x[:rows])
        assert torch.equal(whole[-1], own[-1])
        for found, wanted in zip(
            evaluated.backward(whole, case.gradient[:rows]), evaluated.backward(own, case.gradient[:rows]), strict=True
        ):
            assert torch.equal(found, wanted)


def test_weights_are_read_when_it_is_told_and_written_back(processor: np.ndarray) -> None:
    case = Case(2, 40, [5, 8, 2])
    evaluated = CompiledMlp(case.network, processor)
    before = evaluated(case.x)
    with torch.no_grad():
        for parameter in case.network.parameters():
            parameter.mul_(3.0)
    assert torch.equal(evaluated(case.x), before)
    evaluated.write()
    assert torch.equal(evaluated(case.x), before)
    evaluated.refresh()
    assert torch.equal(evaluated(case.x), before)
    with torch.no_grad():
        for parameter in case.network.parameters():
            parameter.mul_(3.0)
    evaluated.refresh()
    assert not torch.equal(evaluated(case.x), before)


def test_what_is_no_number_comes_out(processor: np.ndarray) -> None:
    """Of a weight, of what the network takes, and of a gradient."""
    case = Case(0, 40, [5, 8, 2])
    case.x[3, 1] = float("nan")
    found = case.results(CompiledMlp(case.network, processor))
    assert found["output"].isnan().any(dim=1).nonzero().flatten().tolist() == [3]
    case.x[3, 1] = 0.0
    case.gradient[7, 0] = float("nan")
    found = case.results(CompiledMlp(case.network, processor))
    assert found["weights.1"].isnan().any()
    with torch.no_grad():
        case.network.weights[0][0, 0] = float("nan")
    assert CompiledMlp(case.network, processor)(case.x).isnan().any()


@given(st.lists(st.integers(1, 5), min_size=1, max_size=3), st.sampled_from([np.int16, np.int32, np.float32]))
def test_arrays_begin_where_tiles_are_filled_from(shape: list[int], dtype: type[np.generic]) -> None:
    room = alignment.aligned_zeros(shape, dtype)
    assert room.ctypes.data % alignment.BYTES == 0
    assert (room.shape, room.dtype) == (tuple(shape), dtype)
    assert room.flags.c_contiguous
    assert not room.any()
