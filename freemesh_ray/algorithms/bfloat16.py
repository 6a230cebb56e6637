"""Networks whose products multiply bfloat16 numbers, three to four times as fast where the device has them.

Weights, biases, gradients and the last layer stay float32, and so do all sums (Micikevicius et al. 2018): what is
rounded, to 8 bits, are the factors of the hidden layers' products and the hidden layers' outputs.
"""

from __future__ import annotations

import torch

from freemesh_ray.algorithms import bfloat16_layers
from freemesh_ray.algorithms.networks import Mlp, on_cpu
from freemesh_ray.algorithms.onednn import available as onednn_available
from freemesh_ray.algorithms.onednn import layer as onednn_layer


def native() -> bool:
    """Whether this processor multiplies bfloat16 numbers itself (AVX512-BF16 or AMX); others imitate it, slowly."""
    return bool(torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported())


def _relu(x: torch.Tensor) -> torch.Tensor:
    """ReLU in place, in a third of the time: a bfloat16 number is below 0 where its 16 bits are, as an integer."""
    x.view(torch.int16).clamp_min_(0)
    return x


def wanted(precision: str, device: torch.device) -> bool:
    """Whether a learner on a device rounds: ``auto`` does where that is faster."""
    return precision == "bfloat16" or (precision == "auto" and device.type == "cpu" and native())


class Bfloat16Mlp:
    """An Mlp, or a stack of them, evaluated so; it has the methods of an Mlp that a written-out step needs.

    Args:
        network: its weights are read when this is made and in ``refresh``.
    """

    def __init__(self, network: Mlp) -> None:
        self._network = network
        self._read = [*list(network.weights)[:-1], *list(network.biases)[:-1]]
        self._rounded = [tensor.detach().to(torch.bfloat16) for tensor in self._read]
        hidden = len(network.weights) - 1
        self._weights, self._biases = self._rounded[:hidden], self._rounded[hidden:]
        self._stacked = bool(network.lead)
        self._last = network.weights[-1].detach(), network.biases[-1].detach()
        self._fused = on_cpu(network.weights[0]) and not self._stacked and onednn_available()

    def refresh(self) -> None:
        """Read the weights, after they have changed."""
        torch._foreach_copy_(self._rounded, self._read)

    @torch.no_grad()
    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        """(batch, inputs) -> (batch, outputs) float32, as ``Mlp.forward``; without gradient."""
        return self.trace(x)[-1]

    @torch.no_grad()
    def trace(self, x: torch.Tensor) -> list[torch.Tensor]:
        """The input and every hidden layer's output in bfloat16, and the output in float32."""
        network = self._network
        values = [x.to(torch.bfloat16).expand(*network.lead, *x.shape)]
        for weight, bias in zip(self._weights, self._biases, strict=True):
            values.append(self._layer(bias, values[-1], weight))
        return [*values, bfloat16_layers.last(values[-1], *self._last)]

    def _layer(self, bias: torch.Tensor, x: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
        return onednn_layer(bias, x, weight) if self._fused else _relu(self._network.layer(bias, x, weight))

    @torch.no_grad()
    def backward(self, trace: list[torch.Tensor], gradient: torch.Tensor) -> list[torch.Tensor]:
        """Gradients as ``Mlp.backward`` gives them, float32.

        Args:
            trace: of the forward pass.
            gradient: of the network's output.
        """
        product, end = self._network.product, len(self._weights)
        last_weight, last_bias = bfloat16_layers.last_gradients(trace[end], gradient)
        weights, biases = [last_weight], [last_bias]
        passed, sums = bfloat16_layers.before_last(trace[end], gradient, self._last[0])
        for i in range(end - 1, -1, -1):
            biases.append(sums)
            weights.append(product(trace[i].mT, passed).to(gradient.dtype))
            if i:
                passed = product(passed, self._weights[i].mT)
                sums = bfloat16_layers.masked(passed, trace[i])
        shaped = biases if self._stacked else [bias.squeeze(0) for bias in biases]
        return weights[::-1] + shaped[::-1]

    @torch.no_grad()
    def backward_to_input(self, trace: list[torch.Tensor], gradient: torch.Tensor) -> torch.Tensor:
        """Gradient of the input, (batch, inputs) float32; of a stack the sum over its networks."""
        product, end = self._network.product, len(self._weights)
        passed, _ = bfloat16_layers.before_last(trace[end], gradient, self._last[0])
        for i in range(end - 1, 0, -1):
            passed = product(passed, self._weights[i].mT)
            bfloat16_layers.masked(passed, trace[i])
        found = product(passed, self._weights[0].mT).to(gradient.dtype)
        return found.sum(dim=0) if self._stacked else found
