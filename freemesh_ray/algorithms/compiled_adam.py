"""One step of Adam (Kingma and Ba 2015, algorithm 1) in one compiled loop."""

from __future__ import annotations

import numpy as np

from envs.kernels.compiled import compiled_sums


@compiled_sums
def descend(
    parameter: np.ndarray,
    gradient: np.ndarray,
    average: np.ndarray,
    square: np.ndarray,
    rate: np.float32,
    beta1: np.float32,
    beta2: np.float32,
    root: np.float32,
    eps: np.float32,
) -> None:
    """Change a parameter and the averages of its gradient and of its square; all (length,) float32.

    Args:
        rate: the learning rate over 1 - beta1^t, t the steps taken, this one included.
        root: of 1 - beta2^t.
        beta1, beta2, eps: of Adam.
    """
    one = np.float32(1.0)
    for i in range(len(parameter)):
        g = gradient[i]
        average[i] += (one - beta1) * (g - average[i])
        square[i] = beta2 * square[i] + (one - beta2) * g * g
        parameter[i] -= rate * average[i] / (np.sqrt(square[i]) / root + eps)
