"""Signs of turns that rounding cannot have changed."""

from __future__ import annotations

from envs.kernels.jit import inlined

#: Rounding error of the turn's determinant over the sum of its terms' sizes, u = 2^-53: (3 + 16 u) u
#: (Shewchuk 1997, "Adaptive precision floating-point arithmetic and fast robust geometric predicates", A).
ERROR_BOUND = (3.0 + 16.0 * 2.0**-53) * 2.0**-53


@inlined
def turns_left(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> bool:
    """Whether a -> b -> c certainly turns left; False where it does not or where rounding leaves a doubt."""
    left = (ax - cx) * (by - cy)
    right = (ay - cy) * (bx - cx)
    return left - right > ERROR_BOUND * (abs(left) + abs(right))
