"""What lies between the products of a `Bfloat16Mlp`, anywhere.

Hidden outputs and their gradients are (..., rows, units) bfloat16; all else is float32, and so are all sums. The first
axes are those of a stack.
"""

from __future__ import annotations

import torch


def last(x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
    """The network's output, (..., rows, outputs), from the last hidden layer's."""
    return torch.matmul(x.to(weight.dtype), weight) + bias


def last_gradients(x: torch.Tensor, gradient: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Of the last layer's weights, (..., units, outputs), and biases, (..., 1, outputs), from the output's."""
    return torch.matmul(x.to(gradient.dtype).mT, gradient), gradient.sum(dim=-2, keepdim=True)


def before_last(x: torch.Tensor, gradient: torch.Tensor, weight: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Of what the last hidden layer gives before its ReLU, and of its biases, from the output's."""
    passed = torch.matmul(gradient, weight.mT).to(x.dtype)
    return passed, masked(passed, x)


def masked(gradient: torch.Tensor, output: torch.Tensor) -> torch.Tensor:
    """Make the gradient of a hidden layer's output that of what it gives before its ReLU; that of its biases.

    A bfloat16 number is above 0 where its 16 bits are, as an integer, which takes half the time.
    """
    bits, above = gradient.view(torch.int16), output.view(torch.int16)
    torch.ops.aten.threshold_backward.grad_input(bits, above, 0, grad_input=bits)
    return gradient.sum(dim=-2, keepdim=True, dtype=torch.float32)
