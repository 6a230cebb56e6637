"""Element quality, defined once: the reward, the smoother and the metrics all call this file.

Paper, Eq. "element quality":  eta_e = sqrt(q_edge q_angle),  q_edge = sqrt(2) min l_j / D_max,
q_angle = min angle_j / max angle_j. 1 for a square, towards 0 for a degenerate element.
"""

from __future__ import annotations

import math

import numpy as np

from envs.kernels.geometry import angle
from envs.kernels.jit import compiled, inlined
from envs.types import MAX_ELEMENT_ANGLE, MIN_ELEMENT_ANGLE, Floats, Ints


@inlined
def inner_angles(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float
) -> tuple[float, float, float, float]:
    """The inner angles at a, b, c, d of a counter-clockwise quadrilateral, each in [0, 2 pi)."""
    return (
        angle(bx - ax, by - ay, dx - ax, dy - ay),
        angle(cx - bx, cy - by, ax - bx, ay - by),
        angle(dx - cx, dy - cy, bx - cx, by - cy),
        angle(ax - dx, ay - dy, cx - dx, cy - dy),
    )


@inlined
def angles_valid(alpha: float, beta: float, gamma: float, delta: float) -> bool:
    """Whether all four inner angles lie strictly between 0.01 pi and 0.99 pi; the quadrilateral is then convex.

    Four angles below pi add up to 2 pi only around a simple counter-clockwise quadrilateral: a clockwise one has
    reflex angles, and of a self-crossing one two corners turn the wrong way.
    """
    return (
        min(min(alpha, beta), min(gamma, delta)) > MIN_ELEMENT_ANGLE
        and max(max(alpha, beta), max(gamma, delta)) < MAX_ELEMENT_ANGLE
    )


@inlined
def eta_from_angles(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float,
    alpha: float, beta: float, gamma: float, delta: float,
) -> float:  # fmt: skip
    """eta_e in [0, 1] of a valid quadrilateral whose inner angles are known."""
    shortest2 = min(
        min((bx - ax) ** 2 + (by - ay) ** 2, (cx - bx) ** 2 + (cy - by) ** 2),
        min((dx - cx) ** 2 + (dy - cy) ** 2, (ax - dx) ** 2 + (ay - dy) ** 2),
    )
    longest2 = max((cx - ax) ** 2 + (cy - ay) ** 2, (dx - bx) ** 2 + (dy - by) ** 2)
    q_edge = math.sqrt(2.0 * shortest2 / longest2)
    q_angle = min(min(alpha, beta), min(gamma, delta)) / max(max(alpha, beta), max(gamma, delta))
    return math.sqrt(q_edge * q_angle)


@inlined
def eta_or_bent(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float
) -> float:  # fmt: skip
    """eta_e in (0, 1] of a strictly convex counter-clockwise quadrilateral, -1 of any other.

    Equal to eta_from_angles, with two inverse tangents in place of four: dot / (|dot| + cross) falls with the angle
    between two directions, from 1 at 0 to -1 at pi, and tells which corners have the least and the largest one.
    """
    abx, aby, bcx, bcy = bx - ax, by - ay, cx - bx, cy - by
    cdx, cdy, dax, day = dx - cx, dy - cy, ax - dx, ay - dy
    cross_a, cross_b = dax * aby - day * abx, abx * bcy - aby * bcx
    cross_c, cross_d = bcx * cdy - bcy * cdx, cdx * day - cdy * dax
    if min(min(cross_a, cross_b), min(cross_c, cross_d)) <= 0.0:
        return -1.0
    dot_a, dot_b = -(dax * abx + day * aby), -(abx * bcx + aby * bcy)
    dot_c, dot_d = -(bcx * cdx + bcy * cdy), -(cdx * dax + cdy * day)
    slope_a, slope_b = dot_a / (abs(dot_a) + cross_a), dot_b / (abs(dot_b) + cross_b)
    slope_c, slope_d = dot_c / (abs(dot_c) + cross_c), dot_d / (abs(dot_d) + cross_d)
    high = max(max(slope_a, slope_b), max(slope_c, slope_d))
    low = min(min(slope_a, slope_b), min(slope_c, slope_d))
    q_angle = math.atan2(1.0 - abs(high), high) / math.atan2(1.0 - abs(low), low)
    shortest2 = min(
        min(abx * abx + aby * aby, bcx * bcx + bcy * bcy), min(cdx * cdx + cdy * cdy, dax * dax + day * day)
    )
    longest2 = max((cx - ax) ** 2 + (cy - ay) ** 2, (dx - bx) ** 2 + (dy - by) ** 2)
    return math.sqrt(math.sqrt(2.0 * shortest2 / longest2) * q_angle)


@compiled
def _convex_quality(vertices: Floats, quads: Ints, out: Floats) -> None:
    for i in range(len(quads)):
        ax, ay = vertices[quads[i, 0]]
        bx, by = vertices[quads[i, 1]]
        cx, cy = vertices[quads[i, 2]]
        dx, dy = vertices[quads[i, 3]]
        out[i] = eta_or_bent(ax, ay, bx, by, cx, cy, dx, dy)


def convex_quality(vertices: Floats, quads: Ints) -> Floats:
    """eta_e of every strictly convex counter-clockwise element, -1 of the others; as ``element_quality``."""
    out = np.empty(len(quads))
    _convex_quality(
        np.require(vertices, np.float64, ["C", "A", "W"]), np.require(quads, np.int64, ["C", "A", "W"]), out
    )
    return out


@compiled
def _element_quality(vertices: Floats, quads: Ints, out: Floats) -> None:
    for i in range(len(quads)):
        ax, ay = vertices[quads[i, 0]]
        bx, by = vertices[quads[i, 1]]
        cx, cy = vertices[quads[i, 2]]
        dx, dy = vertices[quads[i, 3]]
        alpha, beta, gamma, delta = inner_angles(ax, ay, bx, by, cx, cy, dx, dy)
        out[i] = eta_from_angles(ax, ay, bx, by, cx, cy, dx, dy, alpha, beta, gamma, delta)


def element_quality(vertices: Floats, quads: Ints) -> Floats:
    """eta_e of every element.

    Args:
        vertices: (n, 2) float64.
        quads: (m, 4) integer indices, counter-clockwise.

    Returns:
        (m,) float64 in [0, 1].
    """
    out = np.empty(len(quads))
    _element_quality(
        np.require(vertices, np.float64, ["C", "A", "W"]), np.require(quads, np.int64, ["C", "A", "W"]), out
    )
    return out
