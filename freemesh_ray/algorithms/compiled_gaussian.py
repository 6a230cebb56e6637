"""`squashed_gaussian` of rows on a CPU, without gradients: one compiled loop in place of a dozen small operations."""

from __future__ import annotations

import math

import numpy as np
import torch

from envs.kernels.compiled import compiled
from freemesh_ray.algorithms import squashed_gaussian
from freemesh_ray.policies.policy import LOG_STD_MAX, LOG_STD_MIN

_LEAST, _MOST = np.float32(LOG_STD_MIN), np.float32(LOG_STD_MAX)
_CONSTANT = np.float32(squashed_gaussian.CONSTANT)
_ZERO, _HALF, _ONE, _TWO = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(2.0)


@compiled
def _sample(outputs: np.ndarray, noise: np.ndarray, actions: np.ndarray, log_pi: np.ndarray) -> None:
    """Fill ``actions`` and ``log_pi``; with x = e^(-2 |u|) - 1 is tanh |u| = -x / (2 + x)."""
    rows, width = noise.shape
    for i in range(rows):
        total = -width * _CONSTANT
        for j in range(width):
            z, log_std = noise[i, j], min(max(outputs[i, width + j], _LEAST), _MOST)
            u = outputs[i, j] + math.exp(log_std) * z
            size = abs(u)
            x = math.expm1(-_TWO * size)
            squashed = -x / (_TWO + x)
            actions[i, j] = squashed if u >= _ZERO else -squashed
            total += _TWO * (size + math.log1p(_ONE + x)) - log_std - _HALF * z * z
        log_pi[i] = total


@compiled
def _backward(
    outputs: np.ndarray,
    noise: np.ndarray,
    actions: np.ndarray,
    d_actions: np.ndarray,
    d_log_pi: np.float32,
    found: np.ndarray,
) -> None:
    """Fill ``found`` with the gradient of the outputs."""
    rows, width = noise.shape
    for i in range(rows):
        for j in range(width):
            action, log_std = actions[i, j], outputs[i, width + j]
            d_u = d_actions[i, j] * (_ONE - action * action) + _TWO * d_log_pi * action
            found[i, j] = d_u
            inside = _LEAST <= log_std <= _MOST
            found[i, width + j] = d_u * math.exp(log_std) * noise[i, j] - d_log_pi if inside else _ZERO


def sample(outputs: torch.Tensor, noise: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """As ``squashed_gaussian.sample``: (rows, 2 d) and (rows, d) float32 -> (rows, d) and (rows,)."""
    actions, log_pi = torch.empty_like(noise), torch.empty(len(noise))
    _sample(outputs.contiguous().numpy(), noise.numpy(), actions.numpy(), log_pi.numpy())
    return actions, log_pi


def backward(
    outputs: torch.Tensor,
    noise: torch.Tensor,
    action: torch.Tensor,
    d_action: torch.Tensor,
    d_log_pi: torch.Tensor,
) -> torch.Tensor:
    """As ``squashed_gaussian.backward``, ``d_log_pi`` being (1,)."""
    found = torch.empty(len(noise), 2 * noise.shape[1])
    outputs, d_action = outputs.contiguous(), d_action.contiguous()
    rows = outputs.numpy(), noise.numpy(), action.numpy(), d_action.numpy()
    _backward(*rows, np.float32(d_log_pi.item()), found.numpy())
    return found
