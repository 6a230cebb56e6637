"""Networks whose passes are compiled, with products of bfloat16 numbers by the processor's own instructions.

What is rounded is what `Bfloat16Mlp` rounds, but for the biases, which stay float32.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch

from freemesh_ray.algorithms import mlp_passes
from freemesh_ray.algorithms.alignment import aligned_empty, aligned_zeros
from freemesh_ray.algorithms.block_products import BLOCK
from freemesh_ray.algorithms.mlp_passes import Network, Rooms
from freemesh_ray.algorithms.networks import Mlp


def _padded(size: int) -> int:
    """The next multiple of `BLOCK`."""
    return -(-size // BLOCK) * BLOCK


class CompiledMlp:
    """An Mlp, or a stack of them, evaluated so; it has the methods of an Mlp that a written-out step needs.

    A trace is what all layers take, side by side, (..., rows, units) int16, and the output, (..., rows, outputs)
    float32.

    Args:
        network: its weights are read when this is made and in ``refresh``.
        processor: see `block_products`.

    Attributes:
        network: the weights as kernels read them.
        room, row: what kernels need.
    """

    def __init__(self, network: Mlp, processor: np.ndarray) -> None:
        self.processor = processor
        self._lead = network.lead
        self._parameters = [parameter.detach().numpy() for parameter in network.parameters()]
        self._ends = np.cumsum([parameter.size for parameter in self._parameters]).tolist()
        count = math.prod(network.lead)
        inputs = network.weights[0].shape[-2]
        sizes = [inputs, *(weight.shape[-1] for weight in network.weights)]
        widths = [_padded(size) for size in sizes[:-1]]
        pairs = [a * b // 2 for a, b in zip(widths[:-1], widths[1:], strict=True)]
        moved = any(parameter.requires_grad for parameter in network.parameters())  # a target has no gradients
        self.network = Network(
            np.array(sizes),
            np.array(widths),
            aligned_zeros((self._ends[-1],), np.float32),
            aligned_zeros((count * sum(pairs),), np.int32),
            aligned_zeros((count * sum(pairs) if moved else 0,), np.int32),
            aligned_zeros((count, sum(widths[1:])), np.float32),
            aligned_zeros((count, sizes[-1], widths[-1]), np.float32),
            aligned_zeros((count, sizes[-1]), np.float32),
            aligned_zeros((max(pairs),), np.int32),
        )
        self.room = aligned_zeros((max(BLOCK, sizes[-1]) * max(widths),), np.float32)
        self.row = aligned_zeros((max(widths),), np.float32)
        self._rooms: dict[int, Rooms] = {}
        self.refresh()

    def refresh(self) -> None:
        """Read the weights, after they have changed."""
        first = 0
        for parameter, end in zip(self._parameters, self._ends, strict=True):
            self.network.parameters[first:end] = parameter.reshape(-1)
            first = end
        mlp_passes.read(self.network)

    def write(self) -> None:
        """Write the weights back that kernels have changed."""
        first = 0
        for parameter, end in zip(self._parameters, self._ends, strict=True):
            parameter[...] = self.network.parameters[first:end].reshape(parameter.shape)
            first = end

    def values(self, rows: int) -> np.ndarray:
        """An array for what all layers take."""
        return aligned_empty((len(self.network.last), _padded(rows), int(self.network.widths.sum())), np.int16)

    def rooms(self, rows: int) -> Rooms:
        """What backward passes of so many rows need."""
        rows = _padded(rows)
        if rows not in self._rooms:
            size = rows * len(self.row)
            self._rooms[rows] = Rooms(
                aligned_zeros((2, size), np.int16),
                aligned_zeros((size // 2,), np.int32),
                aligned_zeros((size,), np.int16),
                aligned_zeros((size // 2,), np.int32),
            )
        return self._rooms[rows]

    @torch.no_grad()
    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        """(batch, inputs) -> (batch, outputs) float32, as ``Mlp.forward``; without gradient."""
        output: torch.Tensor = self.trace(x)[-1]
        return output

    @torch.no_grad()
    def trace(self, x: torch.Tensor) -> list[Any]:
        """What all layers take and the network's output, for ``backward``."""
        rows, values = len(x), self.values(len(x))
        output = torch.empty((*self._lead, rows, self.network.last.shape[1]))
        found = output.numpy() if self._lead else output.numpy()[None]
        mlp_passes.forward(self.network, x.contiguous().numpy(), values, found, self.room, self.row, self.processor)
        values = values[:, :rows]
        return [values if self._lead else values[0], output]

    def _given(self, trace: list[Any], gradient: torch.Tensor) -> tuple[np.ndarray, np.ndarray]:
        """The values with padded rows, and the output's gradient, both with one axis of a stack."""
        values, given = trace[0], gradient.contiguous().numpy()
        if not self._lead:
            values, given = values[None], given[None]
        if more := _padded(values.shape[1]) - values.shape[1]:
            padded = aligned_zeros((len(values), values.shape[1] + more, values.shape[2]), np.int16)
            padded[:, :-more] = values
            values = padded
        return np.ascontiguousarray(values), given

    @torch.no_grad()
    def backward(self, trace: list[Any], gradient: torch.Tensor) -> list[torch.Tensor]:
        """Gradients as ``Mlp.backward`` gives them, float32.

        Args:
            trace: of the forward pass.
            gradient: of the network's output.
        """
        values, given = self._given(trace, gradient)
        found = torch.empty(self._ends[-1])
        rooms = self.rooms(values.shape[1])
        mlp_passes.backward(
            self.network,
            values,
            values.view(np.int32),
            given,
            found.numpy(),
            rooms,
            self.room,
            self.row,
            self.processor,
        )
        parts = found.tensor_split(self._ends[:-1])
        return [part.view(parameter.shape) for part, parameter in zip(parts, self._parameters, strict=True)]

    @torch.no_grad()
    def backward_to_input(self, trace: list[Any], gradient: torch.Tensor) -> torch.Tensor:
        """Gradient of the input, (batch, inputs) float32; of a stack the sum over its networks."""
        values, given = self._given(trace, gradient)
        found = torch.empty((values.shape[1], int(self.network.widths[0])))
        rooms = self.rooms(values.shape[1])
        mlp_passes.backward_to_input(
            self.network, values, given, found.numpy(), rooms, self.room, self.row, self.processor
        )
        return found[: given.shape[1], : int(self.network.sizes[0])]
