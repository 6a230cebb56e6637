"""One step of Adam (Kingma and Ba 2015, algorithm 1) in one compiled loop."""

from __future__ import annotations

import math

import numpy as np

from envs.kernels.jit import compiled_sums


@compiled_sums
def descend(
    parameters: np.ndarray,
    gradient: np.ndarray,
    average: np.ndarray,
    square: np.ndarray,
    steps: int,
    rate: float,
    beta1: float,
    beta2: float,
    eps: float,
) -> None:
    """Change parameters and the averages of their gradient and of its square; all (length,) float32.

    Args:
        steps: taken, this one included.
        rate, beta1, beta2, eps: of Adam.
    """
    step = np.float32(rate / (1.0 - beta1**steps))
    root = np.float32(math.sqrt(1.0 - beta2**steps))
    share1, share2, kept, small = np.float32(1.0 - beta1), np.float32(1.0 - beta2), np.float32(beta2), np.float32(eps)
    for i in range(len(parameters)):
        g = gradient[i]
        mean = average[i] + share1 * (g - average[i])
        squares = kept * square[i] + share2 * g * g
        average[i], square[i] = mean, squares
        parameters[i] -= step * mean / (np.sqrt(squares) / root + small)
