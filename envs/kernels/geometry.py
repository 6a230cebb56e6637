"""Plane geometry on scalars. All angles in radians, counter-clockwise; all polygons counter-clockwise.

  c                      angle(b - a, c - a) turns the first direction
 /                       counter-clockwise onto the second: [0, 2 pi).
a --- b                  For a vertex a of a counter-clockwise ring, with b the next and c the
                         previous vertex, that is the angle inside the domain.
"""

from __future__ import annotations

import math

import numpy as np

from envs.kernels.jit import inlined
from envs.types import Floats

TWO_PI = 2.0 * math.pi


@inlined
def signed_angle(ux: float, uy: float, vx: float, vy: float) -> float:
    """The shorter turn from direction u to direction v, in (-pi, pi]."""
    return math.atan2(ux * vy - uy * vx, ux * vx + uy * vy)


@inlined
def angle(ux: float, uy: float, vx: float, vy: float) -> float:
    """The turn from direction u counter-clockwise to direction v, in [0, 2 pi)."""
    turn = signed_angle(ux, uy, vx, vy)
    return turn if turn >= 0.0 else turn + TWO_PI


def signed_angles(u: Floats, v: Floats) -> Floats:
    """(...) float64: `signed_angle` of the directions u and v, (..., 2) each."""
    return np.arctan2(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0], (u * v).sum(axis=-1))


@inlined
def segments_touch(
    px: float, py: float, qx: float, qy: float, ax: float, ay: float, bx: float, by: float, tol: float
) -> bool:
    """Whether segments pq and ab come within ``tol`` (a length) of each other.

    Separating axes: the normals of both segments and, for nearly parallel ones, the direction of pq. Within a few
    ``tol`` of an end the answer errs on the side of touching.
    """
    if max(ax, bx) < min(px, qx) - tol or min(ax, bx) > max(px, qx) + tol:
        return False
    if max(ay, by) < min(py, qy) - tol or min(ay, by) > max(py, qy) + tol:
        return False
    ux, uy = qx - px, qy - py
    reach = tol * (abs(ux) + abs(uy))
    a = ux * (ay - py) - uy * (ax - px)
    b = ux * (by - py) - uy * (bx - px)
    if (a > reach and b > reach) or (a < -reach and b < -reach):
        return False
    vx, vy = bx - ax, by - ay
    reach = tol * (abs(vx) + abs(vy))
    p = vx * (py - ay) - vy * (px - ax)
    q = vx * (qy - ay) - vy * (qx - ax)
    if (p > reach and q > reach) or (p < -reach and q < -reach):
        return False
    length2 = ux * ux + uy * uy
    reach = tol * (abs(ux) + abs(uy))
    a = ux * (ax - px) + uy * (ay - py)
    b = ux * (bx - px) + uy * (by - py)
    return not ((a < -reach and b < -reach) or (a > length2 + reach and b > length2 + reach))


@inlined
def distance2_to_segment(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Squared distance from (x, y) to segment ab."""
    vx, vy = bx - ax, by - ay
    wx, wy = x - ax, y - ay
    length2 = vx * vx + vy * vy
    t = 0.0
    if length2 > 0.0:
        t = min(1.0, max(0.0, (wx * vx + wy * vy) / length2))
    dx, dy = wx - t * vx, wy - t * vy
    return dx * dx + dy * dy


@inlined
def ray_hit(ox: float, oy: float, dx: float, dy: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Where the ray o + t d (d a unit vector) first meets segment ab: t >= 0, or infinity."""
    vx, vy = bx - ax, by - ay
    wx, wy = ax - ox, ay - oy
    determinant = dx * vy - dy * vx
    if determinant == 0.0:
        return math.inf
    t = (wx * vy - wy * vx) / determinant
    s = (wx * dy - wy * dx) / determinant
    return t if t >= 0.0 and 0.0 <= s <= 1.0 else math.inf
