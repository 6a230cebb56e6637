"""Plain multi-layer perceptrons: one, and several of a shape evaluated together, with their gradients written out.

Weights are (inputs, outputs) matrices, initialised as torch's ``nn.Linear`` are: uniform in +-1/sqrt(inputs). A stack
holds its networks' weights on a leading axis, so that each layer is one batched product for all of them.

With networks this small automatic differentiation costs a third of an update, so ``trace`` and ``backward`` do it by
hand. For a layer y = relu(x W + b) with gradient g of y, masked by y > 0:

    dW = x^T g        db = sum of g over the batch        dx = g W^T
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import torch
from torch import nn


def _uniform(shape: Sequence[int], inputs: int) -> nn.Parameter:
    bound = 1.0 / math.sqrt(inputs)
    return nn.Parameter(torch.empty(*shape).uniform_(-bound, bound))


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
        last = len(self.weights) - 1
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            y = self.layer(bias, values[-1], weight)
            values.append(y.relu_() if i < last else y)
        return values

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
        weights: list[torch.Tensor] = []
        biases: list[torch.Tensor] = []
        for i in range(len(self.weights) - 1, -1, -1):
            x = trace[i]
            weights.append(self.product(x.mT, gradient))
            biases.append(gradient.sum(dim=-2, keepdim=bool(self.lead)))
            if i:
                gradient = self.through(self.weights[i], x, gradient)
        return weights[::-1] + biases[::-1]

    @torch.no_grad()
    def backward_to_input(self, trace: list[torch.Tensor], gradient: torch.Tensor) -> torch.Tensor:
        """Gradient of the input, (batch, inputs); of a stack the sum over its networks."""
        for i in range(len(self.weights) - 1, 0, -1):
            gradient = self.through(self.weights[i], trace[i], gradient)
        gradient = self.product(gradient, self.weights[0].mT)
        return gradient.sum(dim=0) if self.lead else gradient

    def through(self, weight: torch.Tensor, x: torch.Tensor, gradient: torch.Tensor) -> torch.Tensor:
        """Gradient of a hidden layer's output ``x``, where that is above 0, from that of the next layer's output."""
        passed = self.product(gradient, weight.mT)
        return torch.ops.aten.threshold_backward.grad_input(passed, x, 0.0, grad_input=passed)


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
