"""Observations shifted and scaled to mean 0 and variance 1, by running figures of what was learnt from.

The figures are part of the networks' state, so checkpoints have them and env runners get them with the weights. A
policy that is exported has them folded into its first layer.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import nn

from freemesh_ray.algorithms.averaging import averaged

#: Added to a variance, so that what never changes is not divided by 0.
EPSILON = 1e-6


class Normaliser(nn.Module):
    """(x - mean) / sqrt(variance + EPSILON), component by component; at first the identity but for EPSILON.

    Args:
        size: of an observation.
    """

    mean: torch.Tensor
    variance: torch.Tensor
    count: torch.Tensor

    def __init__(self, size: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("variance", torch.ones(size))
        self.register_buffer("count", torch.zeros(1))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(..., size) -> (..., size)."""
        return (x - self.mean) / (self.variance + EPSILON).sqrt()

    @torch.no_grad()
    def take(self, x: torch.Tensor, *, distributed: bool = False) -> None:
        """Let rows (n, size) count, as if all rows so far had been seen together (Chan et al. 1983).

        Args:
            x: the rows.
            distributed: other learners have as many rows each, which count on every one.
        """
        rows = float(len(x))
        mean, square = x.mean(dim=0), x.square().mean(dim=0)
        if distributed:
            mean, square = averaged([mean, square])
        share = rows / (self.count + rows)
        shift = mean - self.mean
        variance = (square - mean.square()).clamp(min=0.0)
        self.variance.lerp_(variance + (1.0 - share) * shift.square(), share)
        self.mean.add_(share * shift)
        self.count.add_(rows)


def folded(layers: list[tuple[Any, Any]], mean: np.ndarray, variance: np.ndarray) -> list[tuple[Any, Any]]:
    """Layers that do to an observation what these do to a normalised one.

    Args:
        layers: weight (.., inputs, outputs) and bias (.., outputs) of each; the first inputs are the observation.
        mean, variance: of the normaliser.
    """
    (weight, bias), *others = layers
    size = len(mean)
    own = weight[..., :size, :] / np.sqrt(variance + EPSILON)[:, None]
    first = np.concatenate([own, weight[..., size:, :]], axis=-2).astype(np.float32)
    return [(first, (bias - np.einsum("i,...ij->...j", mean, own)).astype(np.float32)), *others]
