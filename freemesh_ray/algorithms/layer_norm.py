"""Critics with layer normalisation (Ba et al. 2016) before every ReLU, as Hiraoka et al. (2022, DroQ) have them."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import nn

from freemesh_ray.algorithms.networks import MlpStack

#: Added to a variance.
EPSILON = 1e-5


class LayerNorm(nn.Module):
    """Each row shifted and scaled to mean 0 and variance 1 over its features, then by a learnt gain and shift.

    Args:
        shape: of gain and shift, which broadcasts against a batch: (networks, 1, features).
    """

    def __init__(self, *shape: int) -> None:
        super().__init__()
        self.gain, self.shift = nn.Parameter(torch.ones(shape)), nn.Parameter(torch.zeros(shape))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(networks, rows, features) -> the same."""
        return torch.nn.functional.layer_norm(x, x.shape[-1:], eps=EPSILON) * self.gain + self.shift


class LayerNormMlpStack(MlpStack):
    """An MlpStack whose hidden layers are normalised."""

    def __init__(self, count: int, inputs: int, hidden: Sequence[int], outputs: int) -> None:
        super().__init__(count, inputs, hidden, outputs)
        self.layer_norms = nn.ModuleList(LayerNorm(*self.lead, 1, w.shape[-1]) for w in list(self.weights)[:-1])

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(batch, inputs) -> (networks, batch, outputs)."""
        x = x.expand(*self.lead, *x.shape)
        for bias, weight, norm in zip(self.biases, self.weights, self.layer_norms, strict=False):
            x = norm(torch.baddbmm(bias, x, weight)).relu()
        return self.last(x)
