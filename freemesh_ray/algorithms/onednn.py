"""Networks whose products are oneDNN's, in float32 on a CPU.

torch takes MKL's, which are half as fast on processors that are not Intel's. oneDNN adds the bias and applies the ReLU
on the way, too. Its one product is x W^T + b of two matrices, which others are written as; a stack is taken network by
network.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch

from freemesh_ray.algorithms.networks import Mlp, above_zero


def available() -> bool:
    """Whether torch has been built with it."""
    return bool(torch.backends.mkldnn.is_available() and hasattr(torch.ops.mkldnn, "_linear_pointwise"))


def product(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """a b, of two matrices."""
    found: torch.Tensor = torch.ops.mkldnn._linear_pointwise(a, b.mT, None, "none", [], "")
    return found


def layer(bias: torch.Tensor, x: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """relu(x W + b) of a hidden layer: (batch, inputs) -> (batch, outputs)."""
    found: torch.Tensor = torch.ops.mkldnn._linear_pointwise(x, weight.mT, bias, "relu", [], "")
    return found


class OneDnnMlp:
    """An Mlp, or a stack of them, evaluated so; it has the methods of an Mlp that a written-out step needs.

    Args:
        network: its weights are read as they are, wherever they change.
    """

    def __init__(self, network: Mlp) -> None:
        self._network = network
        weights, biases = ([tensor.detach() for tensor in part] for part in (network.weights, network.biases))
        # By layer and network.
        self._weights = [self._each(weight) for weight in weights[:-1]]
        self._biases = [[bias.reshape(-1) for bias in self._each(bias)] for bias in biases[:-1]]

    def _each(self, tensor: torch.Tensor) -> Sequence[torch.Tensor]:
        """What a tensor of a stack holds of each network."""
        return tensor.unbind() if self._network.lead else (tensor,)

    def _joined(self, tensors: Sequence[torch.Tensor]) -> torch.Tensor:
        """The opposite."""
        return torch.stack(list(tensors)) if self._network.lead else tensors[0]

    def refresh(self) -> None:
        """Nothing: the weights are read as they are."""

    @torch.no_grad()
    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        """(batch, inputs) -> (batch, outputs), as ``Mlp.forward``; without gradient."""
        return self.trace(x)[-1]

    @torch.no_grad()
    def trace(self, x: torch.Tensor) -> list[torch.Tensor]:
        """The input, every hidden layer's output and the network's output, for ``backward``."""
        network = self._network
        values = [x.expand(*network.lead, *x.shape)]
        each: Sequence[torch.Tensor] = [x] * len(self._weights[0])
        for weights, biases in zip(self._weights, self._biases, strict=True):
            each = [layer(*of_one) for of_one in zip(biases, each, weights, strict=True)]
            values.append(self._joined(each))
        return [*values, network.last(values[-1])]

    @torch.no_grad()
    def backward(self, trace: list[torch.Tensor], gradient: torch.Tensor) -> list[torch.Tensor]:
        """Gradients as ``Mlp.backward`` gives them.

        Args:
            trace: of the forward pass.
            gradient: of the network's output.
        """
        network = self._network
        weights = [network.last_weight_gradient(trace[-2], gradient)]
        biases = [gradient.sum(dim=-2, keepdim=bool(network.lead))]
        passed = network.before_last(gradient)
        for i in range(len(self._weights) - 1, -1, -1):
            gradient = above_zero(passed, trace[i + 1])
            each = self._each(gradient)
            weights.append(self._joined([product(x.mT, g) for x, g in zip(self._each(trace[i]), each, strict=True)]))
            biases.append(gradient.sum(dim=-2, keepdim=bool(network.lead)))
            if i:
                passed = self._before(i, each)
        return weights[::-1] + biases[::-1]

    @torch.no_grad()
    def backward_to_input(self, trace: list[torch.Tensor], gradient: torch.Tensor) -> torch.Tensor:
        """Gradient of the input, (batch, inputs); of a stack the sum over its networks."""
        gradient = self._network.before_last(gradient)
        for i in range(len(self._weights) - 1, -1, -1):
            gradient = self._before(i, self._each(above_zero(gradient, trace[i + 1])))
        return gradient.sum(dim=0) if self._network.lead else gradient

    def _before(self, i: int, gradients: Sequence[torch.Tensor]) -> torch.Tensor:
        """The gradient of hidden layer i's input from that of what it gives before its ReLU."""
        return self._joined([product(g, weight.mT) for g, weight in zip(gradients, self._weights[i], strict=True)])
