"""Networks whose products multiply bfloat16 numbers in a processor's tiles, in a third of the time of a library's.

What is rounded is what `Bfloat16Mlp` rounds, but for the biases, which stay float32.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch

from freemesh_ray.algorithms import tile_kernels, tiles
from freemesh_ray.algorithms.networks import Mlp
from freemesh_ray.algorithms.tile_kernels import BLOCK


def _padded(size: int) -> int:
    """The next multiple of `BLOCK`."""
    return -(-size // BLOCK) * BLOCK


class TileMlp:
    """An Mlp, or a stack of them, evaluated so; it has the methods of an Mlp that a written-out step needs.

    A trace is what all layers take, side by side, (..., rows, units) int16, and the output, (..., rows, outputs)
    float32.

    Args:
        network: its weights are read when this is made and in ``refresh``.
    """

    def __init__(self, network: Mlp) -> None:
        self._lead = network.lead
        self._shapes = [parameter.shape for parameter in network.parameters()]
        self._lengths = [math.prod(shape) for shape in self._shapes]
        count = math.prod(network.lead)
        *self._weights, self._last_weight = (
            weight.detach().numpy().reshape(count, *weight.shape[-2:]) for weight in network.weights
        )
        *self._biases, self._last_bias = (bias.detach().numpy().reshape(count, -1) for bias in network.biases)
        inputs = network.weights[0].shape[-2]
        self._sizes = np.array([inputs, *(weight.shape[-1] for weight in network.weights)])
        self._widths = np.array([_padded(size) for size in self._sizes[:-1]])

        pairs = list(zip(self._widths[:-1].tolist(), self._widths[1:].tolist(), strict=True))
        self._packed, self._layers = _parts([(count, inputs // 2, units) for inputs, units in pairs])
        self._packed_transposed, self._layers_transposed = _parts([(count, units // 2, inputs) for inputs, units in pairs])
        self._padded_biases = np.zeros((count, int(self._widths[1:].sum())), np.float32)
        self._last = np.zeros((count, int(self._sizes[-1]), int(self._widths[-1])), np.float32)

        width = int(self._widths.max())
        self._width = width
        self._room = np.empty(max(BLOCK, int(self._sizes[-1])) * width, np.float32)
        self._row = np.empty(width, np.float32)
        self._turn_room = [np.zeros((weight.shape[1], -(-weight.shape[2] // 2)), np.int32) for weight in self._weights]
        self._rooms: dict[tuple[int, ...], Any] = {}
        self.refresh()

    def refresh(self) -> None:
        """Read the weights, after they have changed."""
        at = 0
        for weight, packed, bias in zip(self._weights, self._layers, self._biases, strict=True):
            tile_kernels.pack(weight, packed)
            self._padded_biases[:, at : at + bias.shape[1]] = bias
            at += packed.shape[2]
        self._last[:, :, : self._last_weight.shape[1]] = self._last_weight.swapaxes(1, 2)
        self._is_transposed = False

    def _transposed(self) -> np.ndarray:
        """The weights that gradients are multiplied by; a target is never asked for them."""
        if not self._is_transposed:
            for weight, room, packed in zip(self._weights, self._turn_room, self._layers_transposed, strict=True):
                tile_kernels.pack_transposed(weight, room, packed)
            self._is_transposed = True
        return self._packed_transposed

    @torch.no_grad()
    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        """(batch, inputs) -> (batch, outputs) float32, as ``Mlp.forward``; without gradient."""
        output: torch.Tensor = self.trace(x)[-1]
        return output

    @torch.no_grad()
    def trace(self, x: torch.Tensor) -> list[Any]:
        """What all layers take and the network's output, for ``backward``."""
        rows, count = len(x), len(self._last)
        values = np.empty((count, _padded(rows), int(self._widths.sum())), np.int16)
        output = torch.empty((*self._lead, rows, int(self._sizes[-1])))
        found = output.numpy()
        tile_kernels.forward(
            x.numpy(), self._widths, self._packed, self._padded_biases, self._last, self._last_bias, values,
            found if self._lead else found[None], self._room, self._row, tiles.SHAPE,
        )  # fmt: skip
        values = values[:, :rows]
        return [values if self._lead else values[0], output]

    def _given(self, trace: list[Any], gradient: torch.Tensor) -> tuple[np.ndarray, np.ndarray]:
        """The values with padded rows, and the output's gradient, both with one axis of a stack."""
        values, given = trace[0], gradient.contiguous().numpy()
        if not self._lead:
            values, given = values[None], given[None]
        if more := _padded(values.shape[1]) - values.shape[1]:
            values = np.pad(values, ((0, 0), (0, more), (0, 0)))
        return np.ascontiguousarray(values), given

    @torch.no_grad()
    def backward(self, trace: list[Any], gradient: torch.Tensor) -> list[torch.Tensor]:
        """Gradients as ``Mlp.backward`` gives them, float32.

        Args:
            trace: of the forward pass.
            gradient: of the network's output.
        """
        values, given = self._given(trace, gradient)
        found = torch.empty(sum(self._lengths))
        tile_kernels.backward(
            values, values.view(np.int32), self._sizes, self._widths, self._transposed(), self._last, given,
            found.numpy(), *self._rooms_for(values.shape[1]), self._room, self._row, tiles.SHAPE,
        )  # fmt: skip
        return [part.view(shape) for part, shape in zip(found.split(self._lengths), self._shapes, strict=True)]

    @torch.no_grad()
    def backward_to_input(self, trace: list[Any], gradient: torch.Tensor) -> torch.Tensor:
        """Gradient of the input, (batch, inputs) float32; of a stack the sum over its networks."""
        values, given = self._given(trace, gradient)
        found = torch.empty((values.shape[1], int(self._widths[0])))
        passed = self._rooms_for(values.shape[1])[0]
        tile_kernels.backward_to_input(
            values, self._widths, self._transposed(), self._last, given, found.numpy(), passed, self._room, self._row,
            tiles.SHAPE,
        )  # fmt: skip
        return found[: given.shape[1], : int(self._sizes[0])]

    def _rooms_for(self, rows: int) -> tuple[np.ndarray, ...]:
        """Arrays of so many rows that kernels fill and nothing else reads."""
        if rows not in self._rooms:
            size = rows * self._width
            self._rooms[rows] = (
                np.empty((2, size), np.int16), np.empty(size // 2, np.int32), np.empty(size, np.int16),
                np.empty(size // 2, np.int32),
            )  # fmt: skip
        rooms: tuple[np.ndarray, ...] = self._rooms[rows]
        return rooms


def _parts(shapes: list[tuple[int, ...]]) -> tuple[np.ndarray, list[np.ndarray]]:
    """An array of zeros, int32, and parts of it, of these shapes."""
    lengths = [math.prod(shape) for shape in shapes]
    whole = np.zeros(sum(lengths), np.int32)
    parts = np.split(whole, np.cumsum(lengths)[:-1])
    return whole, [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]
