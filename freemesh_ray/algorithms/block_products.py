"""Products of bfloat16 matrices in compiled kernels, block by block, by the instructions that a processor has for them.

Which these are, the type of the argument ``processor`` says: `tiles.SHAPE` or `dot_products.SHAPE`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numba.extending import overload

from freemesh_ray.algorithms import dot_products, tiles

#: Rows and columns of a block.
BLOCK = 32
_TILE = 16


def processor() -> np.ndarray | None:
    """What tells kernels which instructions to use; None where there are none."""
    if tiles.available():
        return tiles.SHAPE
    return dot_products.SHAPE if dot_products.available() else None


def begin(processor: np.ndarray) -> None:
    """Before the first block of a kernel."""


def end(processor: np.ndarray) -> None:
    """After the last one."""


def write_block(
    processor: np.ndarray,
    a: np.ndarray,
    a_first: int,
    a_stride: int,
    b: np.ndarray,
    b_first: int,
    b_stride: int,
    depth: int,
    found: np.ndarray,
    first: int,
    stride: int,
) -> None:
    """Write BLOCK rows of a times BLOCK columns of b.

    Args:
        processor: see above.
        a: int16, bfloat16 numbers; from the flat index ``a_first`` on, ``a_stride`` from row to row.
        b: int32, pairs of rows, number by number in turn; from ``b_first`` on, ``b_stride`` from pair to pair.
        depth: columns of a, rows of b; a multiple of BLOCK, above 0.
        found: float32; from ``first`` on, ``stride`` from row to row.
    """


def _has_tiles(processor: types.Array) -> bool:
    return bool(processor.dtype == types.uint8)


@overload(begin, strict=False)
def _begin(processor: types.Array) -> Any:
    if _has_tiles(processor):
        return lambda processor: tiles.begin(processor)
    return lambda processor: None


@overload(end, strict=False)
def _end(processor: types.Array) -> Any:
    if _has_tiles(processor):
        return lambda processor: tiles.end()
    return lambda processor: None


@overload(write_block, strict=False)
def _write_block(
    processor: types.Array,
    a: types.Array,
    a_first: types.Integer,
    a_stride: types.Integer,
    b: types.Array,
    b_first: types.Integer,
    b_stride: types.Integer,
    depth: types.Integer,
    found: types.Array,
    first: types.Integer,
    stride: types.Integer,
) -> Any:
    if _has_tiles(processor):

        def in_tiles(processor, a, a_first, a_stride, b, b_first, b_stride, depth, found, first, stride):  # type: ignore[no-untyped-def]
            # Two times two tiles for the block, and as many for what is multiplied
            tiles.zero(0)
            tiles.zero(1)
            tiles.zero(2)
            tiles.zero(3)
            for k in range(0, depth, BLOCK):
                at_a, at_b = a_first + k, b_first + k // 2 * b_stride
                tiles.load(4, a, at_a, a_stride)
                tiles.load(5, a, at_a + _TILE * a_stride, a_stride)
                tiles.load(6, b, at_b, b_stride)
                tiles.load(7, b, at_b + _TILE, b_stride)
                tiles.add_product(0, 4, 6)
                tiles.add_product(1, 4, 7)
                tiles.add_product(2, 5, 6)
                tiles.add_product(3, 5, 7)
            tiles.store(0, found, first, stride)
            tiles.store(1, found, first + _TILE, stride)
            tiles.store(2, found, first + _TILE * stride, stride)
            tiles.store(3, found, first + _TILE * stride + _TILE, stride)

        return in_tiles

    def by_dot_products(processor, a, a_first, a_stride, b, b_first, b_stride, depth, found, first, stride):  # type: ignore[no-untyped-def]
        for i in range(0, BLOCK, dot_products.ROWS):
            at_a, at_found = a_first + i * a_stride, first + i * stride
            dot_products.block(a, at_a, a_stride, b, b_first, b_stride, depth, found, at_found, stride)

    return by_dot_products
