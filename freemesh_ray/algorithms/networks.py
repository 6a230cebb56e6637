"""Plain multi-layer perceptrons: one, and two of the same shape evaluated together.

Weights are (inputs, outputs) matrices, initialised as torch's ``nn.Linear`` are: uniform in +-1/sqrt(inputs). The
twin stacks both networks' weights on a leading axis, so that each layer is one batched product in place of two.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

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

    def __init__(self, inputs: int, hidden: Sequence[int], outputs: int) -> None:
        super().__init__()
        sizes = [inputs, *hidden, outputs]
        pairs = list(zip(sizes[:-1], sizes[1:], strict=True))
        self.weights = nn.ParameterList([_uniform((a, b), a) for a, b in pairs])
        self.biases = nn.ParameterList([_uniform((b,), a) for a, b in pairs])

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(batch, inputs) -> (batch, outputs)."""
        last = len(self.weights) - 1
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = torch.addmm(bias, x, weight)
            if layer < last:
                x = x.relu_()
        return x


class TwinMlp(nn.Module):
    """Two Mlps with separate weights over the same input; arguments as for Mlp."""

    def __init__(self, inputs: int, hidden: Sequence[int], outputs: int) -> None:
        super().__init__()
        sizes = [inputs, *hidden, outputs]
        pairs = list(zip(sizes[:-1], sizes[1:], strict=True))
        self.weights = nn.ParameterList([_uniform((2, a, b), a) for a, b in pairs])
        self.biases = nn.ParameterList([_uniform((2, 1, b), a) for a, b in pairs])

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(batch, inputs) -> (2, batch, outputs)."""
        x = x.unsqueeze(0).expand(2, -1, -1)
        last = len(self.weights) - 1
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = torch.baddbmm(bias, x, weight)
            if layer < last:
                x = x.relu_()
        return x
