"""A processor's dot products of pairs of bfloat16 numbers (AVX512-BF16), for compiled kernels."""

from __future__ import annotations

import functools
from typing import Any

import llvmlite.binding
import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

#: Tells kernels to use them, by its type.
SHAPE = np.zeros(1, np.int8)
#: float32 numbers in a register, and the registers that a row of a block has.
LANES, ACROSS = 16, 2
#: Rows of a block: their sums and what they are made of fill a processor's 32 registers nearly.
ROWS = 8


class _Bfloat16(ir.Type):
    """LLVM's type, which llvmlite does not have."""

    def _to_string(self) -> str:
        return "bfloat"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, type(self))

    def __hash__(self) -> int:
        return hash(type(self))


_WORD, _INTEGER = ir.IntType(64), ir.IntType(32)
_SUMS, _PAIRS = ir.VectorType(ir.FloatType(), LANES), ir.VectorType(_INTEGER, LANES)
_NUMBERS = ir.VectorType(_Bfloat16(), 2 * LANES)


@functools.cache
def available() -> bool:
    """Whether this processor has them, and kernels are compiled."""
    features = llvmlite.binding.get_host_cpu_features()
    return bool(features.get("avx512bf16", False) and not numba.config.DISABLE_JIT)


@intrinsic
def block(
    typing: Any,
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
    """Write the product of `ROWS` rows of a and of 32 columns of b.

    Args:
        a: int16, bfloat16 numbers; from the flat index ``a_first`` on, ``a_stride`` from row to row.
        b: int32, pairs of rows, number by number in turn; from ``b_first`` on, ``b_stride`` from pair to pair.
        depth: columns of a, rows of b; even, above 0.
        found: float32; from ``first`` on, ``stride`` from row to row.
    """
    whole = types.intp
    signature = types.void(a, whole, whole, b, whole, whole, whole, found, whole, whole)

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        data = [context.make_array(kind)(context, builder, values[i]).data for i, kind in ((0, a), (3, b), (7, found))]
        _emit(builder, *data, *(values[i] for i in (1, 2, 4, 5, 6, 8, 9)))
        return context.get_dummy_value()

    return signature, code


def _emit(
    builder: Any, a: Any, b: Any, found: Any, a_first: Any, a_stride: Any, b_first: Any, b_stride: Any, depth: Any,
    first: Any, stride: Any,
) -> None:  # fmt: skip
    """The code of ``block``: a loop over pairs of columns of a, with all sums in registers."""

    def at(base: Any, index: Any, kind: ir.Type) -> Any:
        return builder.bitcast(builder.gep(base, [index]), kind.as_pointer())

    name = "llvm.x86.avx512bf16.dpbf16ps.512"
    kind = ir.FunctionType(_SUMS, [_SUMS, _NUMBERS, _NUMBERS])
    known = builder.module.globals
    add_products = known[name] if name in known else ir.Function(builder.module, kind, name)

    before, loop = builder.block, builder.append_basic_block("pairs")
    after = builder.append_basic_block("sums")
    builder.branch(loop)
    builder.position_at_end(loop)
    pair = builder.phi(_WORD)
    pair.add_incoming(_WORD(0), before)
    sums = [[builder.phi(_SUMS) for _ in range(ACROSS)] for _ in range(ROWS)]
    zero = ir.Constant(_SUMS, [0.0] * LANES)
    row_of_b = builder.add(b_first, builder.mul(pair, b_stride))
    columns = []
    for u in range(ACROSS):
        loaded = builder.load(at(b, builder.add(row_of_b, _WORD(u * LANES)), _PAIRS), align=4)
        columns.append(builder.bitcast(loaded, _NUMBERS))
    added = []
    for i in range(ROWS):
        index = builder.add(builder.add(a_first, builder.mul(_WORD(i), a_stride)), builder.mul(pair, _WORD(2)))
        both = builder.load(at(a, index, _INTEGER), align=2)
        one = builder.insert_element(ir.Constant(_PAIRS, ir.Undefined), both, _INTEGER(0))
        everywhere = ir.Constant(ir.VectorType(_INTEGER, LANES), [0] * LANES)
        spread = builder.shuffle_vector(one, ir.Constant(_PAIRS, ir.Undefined), everywhere)
        factor = builder.bitcast(spread, _NUMBERS)
        added.append([builder.call(add_products, [sums[i][u], factor, columns[u]]) for u in range(ACROSS)])
    following = builder.add(pair, _WORD(1))
    end = builder.block
    pair.add_incoming(following, end)
    for row, new in zip(sums, added, strict=True):
        for old, changed in zip(row, new, strict=True):
            old.add_incoming(zero, before)
            old.add_incoming(changed, end)
    more = builder.icmp_signed("<", builder.mul(following, _WORD(2)), depth)
    builder.cbranch(more, loop, after)
    builder.position_at_end(after)
    for i, new in enumerate(added):
        index = builder.add(first, builder.mul(_WORD(i), stride))
        for u, total in enumerate(new):
            builder.store(total, at(found, builder.add(index, _WORD(u * LANES)), _SUMS), align=4)
