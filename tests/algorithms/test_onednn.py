"""Products by oneDNN against torch's own, and against automatic differentiation in float64."""

from __future__ import annotations

import copy
from collections.abc import Callable

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from freemesh_ray.algorithms import onednn
from freemesh_ray.algorithms.networks import Mlp, MlpStack
from freemesh_ray.algorithms.onednn import OneDnnMlp

pytestmark = pytest.mark.skipif(not onednn.available(), reason="torch has been built without oneDNN")

NETWORKS: dict[str, Callable[[], Mlp]] = {
    "one": lambda: Mlp(15, [128, 128, 128], 6),
    "stack": lambda: MlpStack(2, 18, [128, 128, 128], 1),
    "shallow": lambda: MlpStack(3, 7, [16], 2),
}


@pytest.mark.parametrize("name", NETWORKS)
def test_outputs_and_gradients_are_those_of_automatic_differentiation(name: str) -> None:
    torch.manual_seed(0)
    network = NETWORKS[name]()
    fast, exact = OneDnnMlp(network), copy.deepcopy(network).double()
    x = torch.randn(256, network.weights[0].shape[-2])
    inputs = x.double().requires_grad_()
    outputs = exact(inputs)
    trace = fast.trace(x)
    close = {"rtol": 1e-4, "atol": 1e-5}
    torch.testing.assert_close(trace[-1].double(), outputs.detach(), **close)
    assert torch.equal(fast(x), trace[-1])
    gradient = torch.randn_like(trace[-1])
    expected = torch.autograd.grad(outputs, [*exact.parameters(), inputs], gradient.double())
    found = fast.backward(trace, gradient)
    for ours, theirs in zip(found, expected[:-1], strict=True):
        assert ours.is_contiguous() or ours.shape[-1] == 1
        torch.testing.assert_close(ours.double(), theirs, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(fast.backward_to_input(trace, gradient).double(), expected[-1], rtol=1e-4, atol=1e-4)


def test_weights_that_change_are_those_it_goes_on_with() -> None:
    network, x = Mlp(5, [8], 2), torch.randn(4, 5)
    fast = OneDnnMlp(network)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.mul_(3.0)
    torch.testing.assert_close(fast(x), network(x).detach())


@settings(max_examples=30, deadline=None)
@given(rows=st.integers(1, 70), depth=st.integers(1, 40), columns=st.integers(1, 40), shift=st.integers(0, 15))
def test_a_product_has_the_same_bits_wherever_its_factors_lie(rows: int, depth: int, columns: int, shift: int) -> None:
    a, b = torch.randn(rows, depth), torch.randn(depth, columns)
    moved = torch.empty(rows * depth + shift)[shift:].view(rows, depth)
    moved.copy_(a)
    torch.testing.assert_close(onednn.product(a, b), a @ b, rtol=1e-4, atol=1e-5)
    assert torch.equal(onednn.product(moved, b), onednn.product(a, b))
