"""A policy's networks in compiled code: the layers in one flat array, and the forward pass of one observation.

A layer y = relu(x W + b) is computed as a sum of W's rows, a few at a time, so that the inner loop runs along
contiguous weights in vector registers. Rows whose x is 0 are passed over: after a ReLU that is every other one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from envs.kernels.jit import inner_fused

Layer = tuple[np.ndarray, np.ndarray]

#: Layer widths are padded to a multiple of this, the float32 values in a register of 512 bits.
LANES = 16

#: Rows that are added at a time.
ROWS = 4


class Network(NamedTuple):
    """A multi-layer perceptron, ReLU between its layers.

    Attributes:
        weights: float32, for each layer its (inputs, padded outputs) matrix row by row and then its bias; padded
            columns are 0.
        sizes: (layers + 1,) int64, inputs of the first layer and outputs of each, without padding.
        x, y: (widest + ROWS,) float32, working memory.
        rows: (widest + ROWS,) int64, working memory: where the rows begin whose x is not 0.
    """

    weights: np.ndarray
    sizes: np.ndarray
    x: np.ndarray
    y: np.ndarray
    rows: np.ndarray


def padded(width: int) -> int:
    """The least multiple of LANES that is not below ``width``."""
    return -(-width // LANES) * LANES


def pack(layers: Sequence[Layer]) -> Network:
    """The network of (weight (inputs, outputs), bias (outputs,)) layers."""
    parts = []
    for weight, bias in layers:
        rows = np.vstack([weight, bias])
        parts.append(np.pad(rows, ((0, 0), (0, padded(rows.shape[1]) - rows.shape[1]))).ravel())
    sizes = [len(layers[0][0]), *(len(bias) for _, bias in layers)]
    widest = padded(max(sizes)) + ROWS
    return Network(
        weights=np.concatenate(parts).astype(np.float32),
        sizes=np.array(sizes, dtype=np.int64),
        x=np.zeros(widest, dtype=np.float32),
        y=np.zeros(widest, dtype=np.float32),
        rows=np.zeros(widest, dtype=np.int64),
    )


@inner_fused
def forward(network: Network, inputs: np.ndarray, outputs: np.ndarray) -> None:
    """Run the network.

    Args:
        network: its working memory is changed.
        inputs: (sizes[0],) float32.
        outputs: (sizes[-1],) float32, written.
    """
    weights, sizes, x, y, rows = network.weights, network.sizes, network.x, network.y, network.rows
    last = len(sizes) - 2
    for i in range(sizes[0]):
        x[i] = inputs[i]
    first = 0
    for layer in range(last + 1):
        width = -(-sizes[layer + 1] // LANES) * LANES
        bias = first + sizes[layer] * width
        for j in range(width):
            y[j] = weights[bias + j]
        count = 0
        for i in range(sizes[layer]):
            x[count], rows[count] = x[i], first + i * width
            count += x[i] != 0.0
        for i in range(count, count + ROWS - 1):
            x[i], rows[i] = 0.0, first
        for i in range(0, count, ROWS):
            xa, xb, xc, xd = x[i], x[i + 1], x[i + 2], x[i + 3]
            a, b = weights[rows[i] : rows[i] + width], weights[rows[i + 1] : rows[i + 1] + width]
            c, d = weights[rows[i + 2] : rows[i + 2] + width], weights[rows[i + 3] : rows[i + 3] + width]
            for j in range(width):
                y[j] += xa * a[j] + xb * b[j] + xc * c[j] + xd * d[j]
        first = bias + width
        if layer < last:
            for j in range(width):
                x[j] = max(y[j], np.float32(0.0))
    for j in range(sizes[last + 1]):
        outputs[j] = y[j]
