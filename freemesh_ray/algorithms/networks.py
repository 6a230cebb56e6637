"""Plain multi-layer perceptrons: one, and several of a shape evaluated together, with their gradients written out.

Weights are (inputs, outputs) matrices, initialised as torch's ``nn.Linear`` are: uniform in +-1/sqrt(inputs). A stack
holds its networks' weights on a leading axis, so that each layer is one batched product for all of them.

With networks this small automatic differentiation costs a third of an update, so ``trace`` and ``backward`` do it by
hand. For a layer y = relu(x W + b) with gradient g of y, masked by y > 0:

    dW = x^T g        db = sum of g over the batch        dx = g W^T

The last layer is narrow, and libraries are slow at products with few columns: with one it is a sum of components here,
else the product is turned, x W as (W^T x^T)^T; either takes a quarter of the time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import torch
from torch import nn


def _uniform(shape: Sequence[int], inputs: int) -> nn.Parameter:
    bound = 1.0 / math.sqrt(inputs)
    return nn.Parameter(torch.empty(*shape).uniform_(-bound, bound))


def on_cpu(tensor: torch.Tensor) -> bool:
    """Whether it is of float32 numbers in the processor's memory, which compiled kernels can read."""
    return tensor.device.type == "cpu" and tensor.dtype == torch.float32


def above_zero(gradient: torch.Tensor, output: torch.Tensor) -> torch.Tensor:
    """The gradient of a hidden layer's output, in place 0 where that is not above 0."""
    return torch.ops.aten.threshold_backward.grad_input(gradient, output, 0, grad_input=gradient)


class Mlp(nn.Module):
    """inputs -> hidden ReLU layers -> linear outputs.

    Args:
        inputs: features in.
        hidden: units of each hidden layer.
        outputs: features out.
    """

    #: Axes in front of the weights' two, and how a layer is computed with them.
    lead: tuple[int, ...] = ()
    layer: Callable[..., torch.Tensor] = staticmethod(torch.addmm)
    product: Callable[..., torch.Tensor] = staticmethod(torch.mm)

    def __init__(self, inputs: int, hidden: Sequence[int], outputs: int) -> None:
        super().__init__()
        sizes = [inputs, *hidden, outputs]
        pairs = list(zip(sizes[:-1], sizes[1:], strict=True))
        ones = (1,) * len(self.lead)
        self.weights = nn.ParameterList([_uniform((*self.lead, a, b), a) for a, b in pairs])
        self.biases = nn.ParameterList([_uniform((*self.lead, *ones, b), a) for a, b in pairs])

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(batch, inputs) -> (batch, outputs)."""
        return self._layers(x)[-1]

    def _layers(self, x: torch.Tensor) -> list[torch.Tensor]:
        values = [x.expand(*self.lead, *x.shape)]
        *hidden, _ = zip(self.weights, self.biases, strict=True)
        for weight, bias in hidden:
            values.append(self.layer(bias, values[-1], weight).relu_())
        return [*values, self.last(values[-1])]

    def last(self, x: torch.Tensor) -> torch.Tensor:
        """The output from the last hidden layer's."""
        weight, bias = self.weights[-1], self.biases[-1]
        if weight.shape[-1] > 1:
            return self.product(weight.mT, x.mT).mT + bias
        return (x * weight.mT).sum(dim=-1, keepdim=True) + bias

    def last_weight_gradient(self, x: torch.Tensor, gradient: torch.Tensor) -> torch.Tensor:
        """Of the last layer's weights."""
        if gradient.shape[-1] > 1:
            return self.product(gradient.mT, x).mT.contiguous()
        return (x * gradient).sum(dim=-2).unsqueeze(-1)

    def before_last(self, gradient: torch.Tensor) -> torch.Tensor:
        """Of the last layer's input."""
        weight = self.weights[-1]
        return self.product(gradient, weight.mT) if weight.shape[-1] > 1 else gradient * weight.mT

    def refresh(self) -> None:
        """Nothing: the weights are read as they are."""

    @torch.no_grad()
    def trace(self, x: torch.Tensor) -> list[torch.Tensor]:
        """The input, every hidden layer's output and the network's output, for ``backward``."""
        return self._layers(x)

    @torch.no_grad()
    def backward(self, trace: list[torch.Tensor], gradient: torch.Tensor) -> list[torch.Tensor]:
        """Gradients of all weights and then all biases, in the order of ``parameters()``.

        Args:
            trace: of the forward pass.
            gradient: of the network's output.
        """
        last = len(self.weights) - 1
        weights = [self.last_weight_gradient(trace[last], gradient)]
        biases = [gradient.sum(dim=-2, keepdim=bool(self.lead))]
        for i in range(last - 1, -1, -1):
            passed = self.before_last(gradient) if i + 1 == last else self.product(gradient, self.weights[i + 1].mT)
            gradient = above_zero(passed, trace[i + 1])
            weights.append(self.product(trace[i].mT, gradient))
            biases.append(gradient.sum(dim=-2, keepdim=bool(self.lead)))
        return weights[::-1] + biases[::-1]

    @torch.no_grad()
    def backward_to_input(self, trace: list[torch.Tensor], gradient: torch.Tensor) -> torch.Tensor:
        """Gradient of the input, (batch, inputs); of a stack the sum over its networks."""
        gradient = self.before_last(gradient)
        for i in range(len(self.weights) - 2, -1, -1):
            gradient = self.product(above_zero(gradient, trace[i + 1]), self.weights[i].mT)
        return gradient.sum(dim=0) if self.lead else gradient


class MlpStack(Mlp):
    """Mlps with separate weights over the same input: (batch, inputs) -> (count, batch, outputs).

    Args:
        count: of networks.
        inputs, hidden, outputs: of each, see Mlp.
    """

    layer = staticmethod(torch.baddbmm)
    product = staticmethod(torch.bmm)

    def __init__(self, count: int, inputs: int, hidden: Sequence[int], outputs: int) -> None:
        self.lead = (count,)
        super().__init__(inputs, hidden, outputs)
