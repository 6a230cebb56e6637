"""What learners in several processes tell each other; RLlib has joined them to a torch process group."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import torch
from torch import distributed


def averaged(gradients: Sequence[torch.Tensor]) -> list[torch.Tensor]:
    """The mean over all learners of each gradient, the same bits on every learner; one message for all of them."""
    flat = torch.cat([gradient.reshape(-1) for gradient in gradients])
    distributed.all_reduce(flat)
    flat /= distributed.get_world_size()
    parts = flat.split([gradient.numel() for gradient in gradients])
    return [part.view(gradient.shape) for part, gradient in zip(parts, gradients, strict=True)]


def begin_alike(tensors: Iterable[torch.Tensor]) -> None:
    """Overwrite every learner's tensors with the first learner's."""
    for tensor in tensors:
        distributed.broadcast(tensor, src=0)
