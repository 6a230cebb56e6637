"""Data-parallel learners: mean gradients and equal weights, over the torch process group that RLlib has made."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import torch
from torch import distributed


def averaged(gradients: Sequence[torch.Tensor]) -> list[torch.Tensor]:
    """Each gradient's mean over all learners, the same bits on every one; all gradients go in one message."""
    flat = torch.cat([gradient.reshape(-1) for gradient in gradients])
    distributed.all_reduce(flat)
    flat /= distributed.get_world_size()
    pieces = flat.split([gradient.numel() for gradient in gradients])
    return [piece.view(gradient.shape) for piece, gradient in zip(pieces, gradients, strict=True)]


def broadcast_from_first(tensors: Iterable[torch.Tensor]) -> None:
    """Overwrite every learner's tensors with the first learner's."""
    for tensor in tensors:
        distributed.broadcast(tensor, src=0)
