"""`bfloat16_layers` on a CPU: each of these is one compiled loop for several small operations.

Kernels read bfloat16 numbers as `bfloat16_bits`. They have one axis of a stack, and the last layer's weights with its
outputs before its units.
"""

from __future__ import annotations

import numpy as np
import torch

from envs.kernels.compiled import compiled_sums
from freemesh_ray.algorithms.bfloat16_bits import rounded, widened

_ZERO, _NOTHING = np.float32(0.0), np.int16(0)


@compiled_sums
def _last(x: np.ndarray, weight: np.ndarray, bias: np.ndarray, found: np.ndarray) -> None:
    """Fill ``found``."""
    for n in range(x.shape[0]):
        for i in range(x.shape[1]):
            for o in range(weight.shape[1]):
                total = _ZERO
                for k in range(x.shape[2]):
                    total += widened(x[n, i, k]) * weight[n, o, k]
                found[n, i, o] = total + bias[n, o]


@compiled_sums
def _last_gradients(x: np.ndarray, gradient: np.ndarray, d_weight: np.ndarray, d_bias: np.ndarray) -> None:
    """Fill ``d_weight`` and ``d_bias``."""
    d_weight[:], d_bias[:] = _ZERO, _ZERO
    for n in range(x.shape[0]):
        for i in range(x.shape[1]):
            for o in range(gradient.shape[2]):
                factor = gradient[n, i, o]
                d_bias[n, o] += factor
                for k in range(x.shape[2]):
                    d_weight[n, o, k] += factor * widened(x[n, i, k])


@compiled_sums
def _before_last(
    x: np.ndarray, gradient: np.ndarray, weight: np.ndarray, row: np.ndarray, passed: np.ndarray, sums: np.ndarray
) -> None:
    """Fill ``passed`` and ``sums``; ``row`` is room for one row."""
    sums[:] = _ZERO
    for n in range(x.shape[0]):
        for i in range(x.shape[1]):
            for k in range(x.shape[2]):
                row[k] = gradient[n, i, 0] * weight[n, 0, k]
            for o in range(1, weight.shape[1]):
                for k in range(x.shape[2]):
                    row[k] += gradient[n, i, o] * weight[n, o, k]
            for k in range(x.shape[2]):
                kept = rounded(row[k]) if x[n, i, k] > 0 else _NOTHING
                passed[n, i, k] = kept
                sums[n, k] += widened(kept)


@compiled_sums
def _masked(gradient: np.ndarray, output: np.ndarray, sums: np.ndarray) -> None:
    """Change ``gradient`` and fill ``sums``."""
    sums[:] = _ZERO
    for n in range(output.shape[0]):
        for i in range(output.shape[1]):
            for k in range(output.shape[2]):
                kept = gradient[n, i, k] if output[n, i, k] > 0 else _NOTHING
                gradient[n, i, k] = kept
                sums[n, k] += widened(kept)


def _bits(x: torch.Tensor) -> np.ndarray:
    """(count, rows, units) int16 of bfloat16 numbers."""
    return _stack(x.view(torch.int16))


def _stack(x: torch.Tensor) -> np.ndarray:
    """With one axis of a stack."""
    array: np.ndarray = x.numpy()
    return array if array.ndim == 3 else array[None]


def last(x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
    """As ``bfloat16_layers.last``."""
    found = weight.new_empty((*x.shape[:-1], weight.shape[-1]))
    weights = _stack(weight.mT.contiguous())
    _last(_bits(x), weights, bias.numpy().reshape(weights.shape[:2]), _stack(found))
    return found


def last_gradients(x: torch.Tensor, gradient: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """As ``bfloat16_layers.last_gradients``."""
    lead, (units, outputs) = x.shape[:-2], (x.shape[-1], gradient.shape[-1])
    d_weight, d_bias = gradient.new_empty((*lead, outputs, units)), gradient.new_empty((*lead, 1, outputs))
    weights = _stack(d_weight)
    _last_gradients(_bits(x), _stack(gradient.contiguous()), weights, d_bias.numpy().reshape(weights.shape[:2]))
    return d_weight.mT.contiguous(), d_bias


def before_last(x: torch.Tensor, gradient: torch.Tensor, weight: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """As ``bfloat16_layers.before_last``."""
    passed, sums = x.new_empty(x.shape), gradient.new_empty((*x.shape[:-2], 1, x.shape[-1]))
    row = np.empty(x.shape[-1], np.float32)
    _before_last(
        _bits(x), _stack(gradient.contiguous()), _stack(weight.mT.contiguous()), row, _bits(passed), _stack(sums)[:, 0]
    )
    return passed, sums


def masked(gradient: torch.Tensor, output: torch.Tensor) -> torch.Tensor:
    """As ``bfloat16_layers.masked``."""
    sums = torch.empty(*output.shape[:-2], 1, output.shape[-1])
    _masked(_bits(gradient), _bits(output), _stack(sums)[:, 0])
    return sums
