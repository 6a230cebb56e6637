"""A network's passes with products of bfloat16 numbers, each one kernel.

bfloat16 numbers are as in `bfloat16_bits`. Rows, and the widths of the input and the hidden layers, are padded to
multiples of `BLOCK` with zeros. Arrays are contiguous. Those that all kernels know:

    values      (count, rows, sum of widths) int16: of each network of a stack what its layers take, side by side
    room        float32: room for BLOCK rows of a product, and for the last layer's weights
    row         float32: room for one row
    processor   see `block_products`
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from envs.kernels.jit import compiled_sums, inlined
from freemesh_ray.algorithms import block_products
from freemesh_ray.algorithms.bfloat16_bits import paired, rounded, widened
from freemesh_ray.algorithms.block_products import BLOCK, write_block

#: Columns that are transposed at once.
_TILE = 16
_ZERO, _NOTHING, _UPPER = np.float32(0.0), np.int16(0), np.int32(16)


class Network(NamedTuple):
    """The weights of a network, or of a stack of some, as kernels read them.

    Attributes:
        sizes: (layers + 2,) int64, of the input, every hidden layer and the output.
        widths: (layers + 1,) int64, of the input and every hidden layer, padded.
        parameters: float32, all weights and then all biases as ``Mlp.parameters`` has them, one after another; the
            others are made of these by ``read``.
        packed: int32, of each hidden layer and each network (inputs / 2, units) pairs of rows, number by number in
            turn.
        transposed: the same of the transposed matrices, which gradients are multiplied by; empty where none are.
        biases: (count, sum of the hidden layers' widths) float32.
        last: (count, outputs, width of the last hidden layer) float32, the last layer's weights, transposed.
        last_bias: (count, outputs) float32.
        pairs: int32, room for one layer's packed weights.
    """

    sizes: np.ndarray
    widths: np.ndarray
    parameters: np.ndarray
    packed: np.ndarray
    transposed: np.ndarray
    biases: np.ndarray
    last: np.ndarray
    last_bias: np.ndarray
    pairs: np.ndarray


class Rooms(NamedTuple):
    """Arrays that a backward pass fills and nothing else reads, of the rows times the largest width.

    Attributes:
        passed: (2, rows times width) int16.
        transposed, pairs: (half of that,) int32.
        columns: (rows times width,) int16.
    """

    passed: np.ndarray
    transposed: np.ndarray
    columns: np.ndarray
    pairs: np.ndarray


@inlined
def _transpose(matrix: np.ndarray, rows: int, found: np.ndarray) -> None:
    """The first ``rows`` rows of a matrix of pairs become the columns of another."""
    whole = rows - rows % _TILE
    for i in range(0, whole, _TILE):
        for k in range(matrix.shape[1]):
            for j in range(_TILE):  # as many steps as are known beforehand are taken at once
                found[k, i + j] = matrix[i + j, k]
    for i in range(whole, rows):
        for k in range(matrix.shape[1]):
            found[k, i] = matrix[i, k]


@inlined
def _pack(weight: np.ndarray, packed: np.ndarray) -> None:
    """A layer's (inputs, units) float32 -> (padded inputs / 2, padded units)."""
    inputs, units = weight.shape
    for i in range(inputs // 2):
        for u in range(units):
            packed[i, u] = paired(rounded(weight[2 * i, u]), rounded(weight[2 * i + 1, u]))
    if inputs % 2:
        for u in range(units):
            packed[inputs // 2, u] = paired(rounded(weight[inputs - 1, u]), _NOTHING)


@inlined
def _pack_transposed(weight: np.ndarray, pairs: np.ndarray, packed: np.ndarray) -> None:
    """The same -> (padded units / 2, padded inputs). ``pairs`` is (inputs, units / 2, rounded up)."""
    inputs, units = weight.shape
    for i in range(inputs):
        for u in range(units // 2):
            pairs[i, u] = paired(rounded(weight[i, 2 * u]), rounded(weight[i, 2 * u + 1]))
        if units % 2:
            pairs[i, units // 2] = paired(rounded(weight[i, units - 1]), _NOTHING)
    _transpose(pairs, inputs, packed)


@compiled_sums
def read(network: Network) -> None:
    """Fill the arrays of a network from its parameters; padding stays as it is."""
    sizes, widths, parameters = network.sizes, network.widths, network.parameters
    layers, count, outputs = len(widths) - 1, len(network.biases), network.sizes[-1]
    at, at_packed = 0, 0
    for layer in range(layers):
        inputs, units = sizes[layer], sizes[layer + 1]
        length = widths[layer] * widths[layer + 1] // 2
        for _ in range(count):
            weight = parameters[at : at + inputs * units].reshape(inputs, units)
            packed = network.packed[at_packed : at_packed + length]
            _pack(weight, packed.reshape(widths[layer] // 2, widths[layer + 1]))
            if len(network.transposed):
                packed = network.transposed[at_packed : at_packed + length]
                half = (units + 1) // 2
                pairs = network.pairs[: inputs * half].reshape(inputs, half)
                _pack_transposed(weight, pairs, packed.reshape(widths[layer + 1] // 2, widths[layer]))
            at, at_packed = at + inputs * units, at_packed + length
    units = sizes[layers]
    for n in range(count):
        for u in range(units):
            for o in range(outputs):
                network.last[n, o, u] = parameters[at + u * outputs + o]
        at += units * outputs
    at_bias = 0
    for layer in range(1, layers + 1):
        for n in range(count):
            for u in range(sizes[layer]):
                network.biases[n, at_bias + u] = parameters[at + u]
            at += sizes[layer]
        at_bias += widths[layer]
    for n in range(count):
        for o in range(outputs):
            network.last_bias[n, o] = parameters[at + o]
        at += outputs


@compiled_sums
def forward(
    network: Network,
    x: np.ndarray,
    values: np.ndarray,
    output: np.ndarray,
    room: np.ndarray,
    row: np.ndarray,
    processor: np.ndarray,
) -> None:
    """Fill ``values`` and ``output`` from what all networks take.

    Args:
        network: what is evaluated.
        x: (rows without padding, inputs) float32.
        output: (count, rows without padding, outputs) float32.
        values, room, row, processor: see above.
    """
    widths, weights, biases = network.widths, network.packed, network.biases
    last, last_bias = network.last, network.last_bias
    count, rows, stride = values.shape
    block_products.begin(processor)
    for n in range(count):
        for i in range(rows):
            for k in range(widths[0]):
                values[n, i, k] = _NOTHING
        for i in range(x.shape[0]):
            for k in range(x.shape[1]):
                values[n, i, k] = rounded(x[i, k])
    at_weights, at_bias, at = 0, 0, 0
    for layer in range(len(widths) - 1):
        inputs, units = widths[layer], widths[layer + 1]
        for n in range(count):
            bias = biases[n, at_bias : at_bias + units]
            for r in range(0, rows, BLOCK):
                for u in range(0, units, BLOCK):
                    at_values = (n * rows + r) * stride + at
                    write_block(
                        processor, values, at_values, stride, weights, at_weights + u, units, inputs, room, u, units
                    )
                for i in range(BLOCK):
                    found = values[n, r + i, at + inputs : at + inputs + units]
                    given = room[i * units : (i + 1) * units]
                    for j in range(units):
                        bits = rounded(given[j] + bias[j])
                        found[j] = bits if bits > 0 else _NOTHING
            at_weights += inputs // 2 * units
        at, at_bias = at + inputs, at_bias + units
    block_products.end(processor)
    for n in range(count):
        for i in range(output.shape[1]):
            value = values[n, i, at : at + last.shape[2]]
            for k in range(last.shape[2]):
                row[k] = widened(value[k])
            for o in range(output.shape[2]):
                total = _ZERO
                for k in range(last.shape[2]):
                    total += row[k] * last[n, o, k]
                output[n, i, o] = total + last_bias[n, o]


@inlined
def _before_last(
    values: np.ndarray, n: int, at: int, gradient: np.ndarray, last: np.ndarray, passed: np.ndarray, row: np.ndarray
) -> None:
    """Fill ``passed``, (rows, units) int16: the gradient of what the last hidden layer of network n gives before its
    ReLU. ``at`` is where its values begin.
    """
    rows, units = passed.shape
    for i in range(gradient.shape[1]):
        for k in range(units):
            row[k] = gradient[n, i, 0] * last[n, 0, k]
        for o in range(1, gradient.shape[2]):
            for k in range(units):
                row[k] += gradient[n, i, o] * last[n, o, k]
        value = values[n, i, at : at + units]
        for k in range(units):
            passed[i, k] = rounded(row[k]) if value[k] > 0 else _NOTHING
    for i in range(gradient.shape[1], rows):
        for k in range(units):
            passed[i, k] = _NOTHING


@inlined
def _before(
    processor: np.ndarray,
    passed: np.ndarray,
    turned: np.ndarray,
    at_turned: int,
    values: np.ndarray,
    n: int,
    at: int,
    before: np.ndarray,
    room: np.ndarray,
) -> None:
    """Fill ``before`` with the gradient of the hidden layer before, whose values begin at ``at``."""
    (rows, units), inputs = before.shape, passed.shape[1]
    for r in range(0, rows, BLOCK):
        for u in range(0, units, BLOCK):
            write_block(processor, passed, r * inputs, inputs, turned, at_turned + u, units, inputs, room, u, units)
        for i in range(BLOCK):
            given, value, found = room[i * units : (i + 1) * units], values[n, r + i, at : at + units], before[r + i]
            for j in range(units):
                found[j] = rounded(given[j]) if value[j] > 0 else _NOTHING


@inlined
def _add_rows(matrix: np.ndarray, found: np.ndarray) -> None:
    """Fill ``found`` with the sums of a matrix' columns, as many as it has room for."""
    found[:] = _ZERO
    for i in range(matrix.shape[0]):
        for j in range(len(found)):
            found[j] += widened(matrix[i, j])


@inlined
def _last_hidden(network: Network) -> tuple[int, int]:
    """Where the values of the last hidden layer begin, and where its transposed weights would end."""
    widths, count, at, at_turned = network.widths, len(network.biases), 0, 0
    for layer in range(len(widths) - 1):
        at += widths[layer]
        at_turned += count * (widths[layer] * widths[layer + 1] // 2)
    return at, at_turned


@compiled_sums
def backward(
    network: Network,
    values: np.ndarray,
    pairs: np.ndarray,
    gradient: np.ndarray,
    found: np.ndarray,
    rooms: Rooms,
    room: np.ndarray,
    row: np.ndarray,
    processor: np.ndarray,
) -> None:
    """Fill ``found`` with the gradients of all parameters.

    Args:
        network: what was evaluated.
        pairs: ``values`` with each two numbers of a row as one int32.
        gradient: (count, rows without padding, outputs) float32, of the output.
        found: as ``network.parameters``.
        rooms: room.
        values, room, row, processor: see above.
    """
    sizes, widths, turned, last = network.sizes, network.widths, network.transposed, network.last
    passed, transposed, columns, rows_in_pairs = rooms.passed, rooms.transposed, rooms.columns, rooms.pairs
    count, rows, _ = values.shape
    layers = len(widths) - 1
    outputs = sizes[layers + 1]
    block_products.begin(processor)
    for n in range(count):
        at, at_turned = _last_hidden(network)
        at_weight = 0  # where the gradients of the last layer begin
        for layer in range(layers):
            at_weight += count * sizes[layer] * sizes[layer + 1]
        units = widths[layers]
        at_bias = at_weight + count * sizes[layers] * outputs
        for layer in range(1, layers + 1):
            at_bias += count * sizes[layer]

        first = at_bias + n * outputs
        d_bias = found[first : first + outputs]
        d_bias[:] = _ZERO
        first = at_weight + n * sizes[layers] * outputs
        d_weight = found[first : first + sizes[layers] * outputs].reshape(sizes[layers], outputs)
        d_last = room[: outputs * units].reshape(outputs, units)
        d_last[:] = _ZERO
        for i in range(gradient.shape[1]):
            value = values[n, i, at : at + units]
            for o in range(outputs):
                factor = gradient[n, i, o]
                d_bias[o] += factor
                for k in range(units):
                    d_last[o, k] += factor * widened(value[k])
        for k in range(sizes[layers]):
            for o in range(outputs):
                d_weight[k, o] = d_last[o, k]

        own = passed[0, : rows * units].reshape(rows, units)
        _before_last(values, n, at, gradient, last, own, row)
        for layer in range(layers - 1, -1, -1):
            inputs, units = widths[layer], widths[layer + 1]
            at -= inputs
            at_turned -= count * (inputs * units // 2)
            at_weight -= count * sizes[layer] * sizes[layer + 1]
            at_bias -= count * sizes[layer + 1]
            first = at_bias + n * sizes[layer + 1]
            _add_rows(own, found[first : first + sizes[layer + 1]])

            # x^T g
            turn = transposed[: rows * inputs // 2].reshape(inputs // 2, rows)
            _transpose(pairs[n, :, at // 2 : (at + inputs) // 2], rows, turn)
            for k in range(inputs // 2):
                even = columns[2 * k * rows : (2 * k + 1) * rows]
                odd = columns[(2 * k + 1) * rows : (2 * k + 2) * rows]
                for r in range(rows):
                    even[r] = np.int16(turn[k, r])
                for r in range(rows):
                    odd[r] = np.int16(turn[k, r] >> _UPPER)
            for r in range(rows // 2):
                both = rows_in_pairs[r * units : (r + 1) * units]
                for u in range(units):
                    both[u] = paired(own[2 * r, u], own[2 * r + 1, u])
            first = at_weight + n * sizes[layer] * sizes[layer + 1]
            d_weight = found[first : first + sizes[layer] * sizes[layer + 1]].reshape(sizes[layer], sizes[layer + 1])
            for k in range(0, inputs, BLOCK):
                for u in range(0, units, BLOCK):
                    write_block(processor, columns, k * rows, rows, rows_in_pairs, u, units, rows, room, u, units)
                for i in range(min(BLOCK, sizes[layer] - k)):
                    given, d_row = room[i * units : (i + 1) * units], d_weight[k + i]
                    for j in range(len(d_row)):
                        d_row[j] = given[j]

            if layer:
                other = passed[(layers - layer) % 2, : rows * inputs].reshape(rows, inputs)
                _before(processor, own, turned, at_turned + n * (inputs * units // 2), values, n, at, other, room)
                own = other
    block_products.end(processor)


@compiled_sums
def backward_to_input(
    network: Network,
    values: np.ndarray,
    gradient: np.ndarray,
    found: np.ndarray,
    rooms: Rooms,
    room: np.ndarray,
    row: np.ndarray,
    processor: np.ndarray,
) -> None:
    """Fill ``found``, (rows, width of the input) float32, with the input's gradient, of all networks together.

    The rest as in ``backward``.
    """
    widths, turned, last, passed = network.widths, network.transposed, network.last, rooms.passed
    count, rows, _ = values.shape
    layers = len(widths) - 1
    found[:] = _ZERO
    block_products.begin(processor)
    for n in range(count):
        at, at_turned = _last_hidden(network)
        own = passed[0, : rows * widths[layers]].reshape(rows, widths[layers])
        _before_last(values, n, at, gradient, last, own, row)
        for layer in range(layers - 1, -1, -1):
            inputs, units = widths[layer], widths[layer + 1]
            at -= inputs
            at_turned -= count * (inputs * units // 2)
            if layer:
                other = passed[(layers - layer) % 2, : rows * inputs].reshape(rows, inputs)
                _before(processor, own, turned, at_turned + n * (inputs * units // 2), values, n, at, other, room)
                own = other
            else:
                for r in range(0, rows, BLOCK):
                    for u in range(0, inputs, BLOCK):
                        at_weight = n * (inputs * units // 2) + u
                        write_block(processor, own, r * units, units, turned, at_weight, inputs, units, room, u, inputs)
                    for i in range(BLOCK):
                        given, sums = room[i * inputs : (i + 1) * inputs], found[r + i]
                        for j in range(inputs):
                            sums[j] += given[j]
    block_products.end(processor)
