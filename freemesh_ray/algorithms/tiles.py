"""A processor's matrix tiles (Intel AMX), for compiled kernels.

Tiles 0 to 7 hold 16 rows of 64 bytes: of 16 float32 numbers, or of 32 bfloat16 ones. A product adds to tile c, of
float32 numbers, the product of tile a, 16 x 32 bfloat16 numbers, and of tile b, 32 x 16, whose row i holds rows 2 i and
2 i + 1 of the matrix, number by number in turn. (Intel 64 Architectures Software Developer's Manual, volume 1, chapter
18.)

A kernel calls ``begin``, then the others, then ``end``. Where ``available`` is false, a kernel must not run.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import llvmlite.binding
import numba
import numpy as np
import torch
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

#: Rows of a tile, and bytes of a row.
ROWS, ROW_BYTES = 16, 64
_BYTE, _WORD, _VOID = ir.IntType(8), ir.IntType(64), ir.VoidType()
_ADDRESS = _BYTE.as_pointer()


def _shape() -> np.ndarray:
    """What ``begin`` loads: all eight tiles with all of their rows."""
    shape = np.zeros(64, np.uint8)
    shape[0] = 1
    shape[16:32:2] = ROW_BYTES
    shape[48:56] = ROWS
    return shape


#: The argument of ``begin``.
SHAPE = _shape()


@functools.cache
def available() -> bool:
    """Whether this processor has tiles of bfloat16 numbers, the system lets this process use them, and kernels are
    compiled.
    """
    features = llvmlite.binding.get_host_cpu_features()
    there = features.get("amx-bf16", False) and torch.cpu._is_amx_tile_supported()
    return bool(there and not numba.config.DISABLE_JIT and torch.cpu._init_amx())


def _instruction(builder: Any, name: str, *arguments: Any) -> None:
    kind = ir.FunctionType(_VOID, [argument.type for argument in arguments])
    name = f"llvm.x86.{name}"
    known = builder.module.globals
    builder.call(known[name] if name in known else ir.Function(builder.module, kind, name), arguments)


def _nothing(emit: Callable[..., None], *given: Any) -> tuple[Any, Callable[..., Any]]:
    """What an intrinsic returns: its signature, and what makes its code by ``emit(context, builder, values)``."""

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        emit(context, builder, values)
        return context.get_dummy_value()

    return types.void(*given), code


def _address(context: Any, builder: Any, kind: types.Array, array: Any, first: Any = None) -> Any:
    """Of element ``first`` of a contiguous array."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(data if first is None else builder.gep(data, [first]), _ADDRESS)


@intrinsic
def begin(typing: Any, shape: types.Array) -> Any:
    """Take the tiles into use. ``shape`` is `SHAPE`."""

    def emit(context: Any, builder: Any, values: Any) -> None:
        _instruction(builder, "ldtilecfg", _address(context, builder, shape, values[0]))

    return _nothing(emit, shape)


@intrinsic
def end(typing: Any) -> Any:
    """Give the tiles back."""
    return _nothing(lambda context, builder, values: _instruction(builder, "tilerelease"))


@intrinsic(prefer_literal=True)
def zero(typing: Any, tile: types.IntegerLiteral) -> Any:
    """Make a tile 0."""
    number = _BYTE(tile.literal_value)
    return _nothing(lambda context, builder, values: _instruction(builder, "tilezero", number), tile)


@intrinsic(prefer_literal=True)
def add_product(typing: Any, c: types.IntegerLiteral, a: types.IntegerLiteral, b: types.IntegerLiteral) -> Any:
    """c += a b."""
    numbers = [_BYTE(tile.literal_value) for tile in (c, a, b)]
    return _nothing(lambda context, builder, values: _instruction(builder, "tdpbf16ps", *numbers), c, a, b)


def _moved(name: str) -> Callable[..., Any]:
    """Between a tile and a contiguous array, from its flat index ``first`` on, ``stride`` elements from row to row."""

    def signed(typing: Any, tile: Any, array: types.Array, first: Any, stride: Any) -> Any:
        def emit(context: Any, builder: Any, values: Any) -> None:
            size = context.get_abi_sizeof(context.get_data_type(array.dtype))
            at = _address(context, builder, array, values[1], values[2])
            _instruction(builder, name, _BYTE(tile.literal_value), at, builder.mul(values[3], _WORD(size)))

        return _nothing(emit, tile, array, types.intp, types.intp)

    return signed


#: load(tile, array, first, stride)
load = intrinsic(prefer_literal=True)(_moved("tileloadd64"))
#: store(tile, array, first, stride)
store = intrinsic(prefer_literal=True)(_moved("tilestored64"))
