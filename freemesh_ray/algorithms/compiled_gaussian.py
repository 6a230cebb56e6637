"""`squashed_gaussian` of rows on a CPU, without gradients: one compiled loop in place of a dozen small operations."""

from __future__ import annotations

import math

import numpy as np
import torch

from envs.kernels.jit import compiled, inlined
from freemesh_ray.algorithms import squashed_gaussian
from freemesh_ray.policies.policy import LOG_STD_MAX, LOG_STD_MIN

_LEAST, _MOST = np.float32(LOG_STD_MIN), np.float32(LOG_STD_MAX)
_CONSTANT = np.float32(squashed_gaussian.CONSTANT)
_ZERO, _HALF, _ONE, _TWO = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(2.0)
#: Where e^x is nothing beside 1; log 2 in two parts, the first short enough that its multiples are exact; 1.5 2^23.
_FAR, _PER_LOG_2, _SHIFT = np.float32(-87.0), np.float32(1.0 / math.log(2.0)), np.float32(12582912.0)
_LOG_2, _LOG_2_REST = np.float32(0.693359375), np.float32(math.log(2.0) - 0.693359375)
_BIAS, _MANTISSA = np.int32(127), np.int32(23)
#: Coefficients of e^r for |r| < log(2) / 2 (Cephes' expf) and of artanh.
_E3, _E4, _E5 = np.float32(1.6666665459e-1), np.float32(4.1665795894e-2), np.float32(8.3334519073e-3)
_E6, _E7 = np.float32(1.3981999507e-3), np.float32(1.9875691500e-4)
_R3, _R5, _R7, _R9, _R11, _R13, _R15 = (np.float32(1.0 / k) for k in range(3, 17, 2))


@inlined
def _clamped(log_std: np.float32) -> np.float32:
    """What is no number stays none."""
    return _LEAST if log_std < _LEAST else _MOST if log_std > _MOST else log_std


@inlined
def _exponential(x: np.float32) -> tuple[np.float32, np.float32]:
    """2^k and q with e^x = 2^k (1 + q) for x in -87 to 87: from the nearest multiple k of log 2 on by a polynomial."""
    shifted = x * _PER_LOG_2 + _SHIFT  # its last bits are k
    k = shifted - _SHIFT
    r = (x - k * _LOG_2) - k * _LOG_2_REST
    p = ((((_E7 * r + _E6) * r + _E5) * r + _E4) * r + _E3) * r + _HALF
    scale = np.int32(np.int32(np.float32(shifted).view(np.int32) + _BIAS) << _MANTISSA).view(np.float32)
    return scale, p * (r * r) + r


@inlined
def _log_of_1_and(y: np.float32) -> np.float32:
    """log(1 + y) for y in 0 to 1, 2 artanh(y / (2 + y)), by its series."""
    s = y / (_TWO + y)
    t = s * s
    p = ((((((_R15 * t + _R13) * t + _R11) * t + _R9) * t + _R7) * t + _R5) * t + _R3) * t
    return _TWO * (s + s * p)


@compiled
def sample_rows(
    outputs: np.ndarray, noise: np.ndarray, log_std: np.ndarray, actions: np.ndarray, log_pi: np.ndarray
) -> None:
    """Fill ``actions`` and ``log_pi``; with x = e^(-2 |u|) - 1 is tanh |u| = -x / (2 + x).

    The loop in the middle is over all components in a row, many of which the processor takes at once. ``log_std`` is
    room for them.
    """
    rows, width = noise.shape
    for i in range(rows):
        for j in range(width):
            log_std[i * width + j], actions[i * width + j] = _clamped(outputs[i, width + j]), outputs[i, j]
    z = noise.reshape(-1)
    for i in range(rows * width):
        scale, q = _exponential(log_std[i])
        u = actions[i] + (scale + scale * q) * z[i]
        size = abs(u)
        scale, q = _exponential(_FAR if size > -_HALF * _FAR else -_TWO * size)
        x = scale * q + (scale - _ONE)
        squashed = -x / (_TWO + x)
        actions[i] = squashed if u >= _ZERO else -squashed
        log_std[i] = _TWO * (size + _log_of_1_and(_ONE + x)) - log_std[i] - _HALF * z[i] * z[i]
    for i in range(rows):
        total = -width * _CONSTANT
        for j in range(width):
            total += log_std[i * width + j]
        log_pi[i] = total


@compiled
def backward_rows(
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
    room = np.empty(noise.numel(), np.float32)
    sample_rows(outputs.contiguous().numpy(), noise.numpy(), room, actions.numpy().reshape(-1), log_pi.numpy())
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
    backward_rows(*rows, np.float32(d_log_pi.item()), found.numpy())
    return found
