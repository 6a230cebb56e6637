"""Plain structured meshes inside closed curves, and integrals over elements of any order."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from envs.mesh import CurvedEdges, Mesh, edges_of, sides
from envs.polygons.exact_curves import CircleArc, EllipseArc, ParametricCurve
from envs.types import Curve
from freemesh_ray.mesh_geometry import lagrange
from freemesh_ray.mesh_geometry.high_order import HighOrder

FULL = 2.0 * np.pi


def blob(seed: int = 0, controls: int = 7) -> ParametricCurve:
    """A smooth closed spline around the origin, its radius between .8 and 1.2."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, FULL, controls + 1)
    points = rng.uniform(0.8, 1.2, controls)[:, None] * np.stack([np.cos(t[:-1]), np.sin(t[:-1])], axis=1)
    return ParametricCurve(CubicSpline(t, np.concatenate([points, points[:1]]), bc_type="periodic"), t)


def unit_circle() -> CircleArc:
    return CircleArc(np.zeros(2), 1.0)


def ellipse(ratio: float = 0.6) -> EllipseArc:
    return EllipseArc(np.array([0.2, -0.1]), np.array([0.8, 0.6]), ratio * np.array([-0.6, 0.8]))


def inside(curve: Curve, n: int, centre: tuple[float, float] = (0.0, 0.0), core: float = 0.5) -> Mesh:
    """5 n^2 elements inside a closed curve of parameters 0 to 2 pi: a core, and four blocks around it."""
    outer = curve.at(FULL * np.arange(4 * n) / (4 * n))
    corners = np.array(centre) + core * (outer[::n] - centre)
    x = (np.arange(n + 1) / n)[:, None]
    y = x[:, None]
    grid = (1 - y) * ((1 - x) * corners[0] + x * corners[1]) + y * ((1 - x) * corners[3] + x * corners[2])
    number = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    around = np.concatenate([number[0, :-1], number[:-1, -1], number[-1, :0:-1], number[:0:-1, 0]])
    inner = grid.reshape(-1, 2)[around]
    layers = [around]
    points = [grid.reshape(-1, 2)]
    for i in range(1, n + 1):
        points.append(inner + i / n * (outer - inner))
        layers.append((n + 1) ** 2 + (i - 1) * 4 * n + np.arange(4 * n))
    quads = [np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)]
    for low, high in zip(layers[:-1], layers[1:], strict=True):
        quads.append(np.stack([low, high, np.roll(high, -1), np.roll(low, -1)], axis=1))
    return curved(np.concatenate(points), np.concatenate(quads), (curve,))


def ring(inner: Curve, outer: Curve, n: int, rows: np.ndarray | None = None) -> Mesh:
    """Elements between two closed curves of parameters 0 to 2 pi: n around, rows at shares from 0 to 1 of the way."""
    t = FULL * np.arange(n) / n
    shares = np.linspace(0.0, 1.0, n // 4 + 1) if rows is None else rows
    a, b = inner.at(t), outer.at(t)
    points = np.concatenate([a + share * (b - a) for share in shares])
    number = np.arange(len(points)).reshape(len(shares), n)
    low, high = number[:-1], number[1:]
    quads = np.stack([low, high, np.roll(high, -1, axis=1), np.roll(low, -1, axis=1)], axis=-1).reshape(-1, 4)
    return curved(points, quads, (inner, outer))


def curved(points: np.ndarray, quads: np.ndarray, curves: tuple[Curve, ...]) -> Mesh:
    """The mesh, each boundary edge on the curve that its ends are nearest to."""
    distinct, counts = edges_of(quads)
    walked = sides(quads).reshape(-1, 2)
    base = len(points)
    once = np.isin(np.sort(walked, axis=1) @ [base, 1], distinct[counts == 1] @ [base, 1])
    segments = walked[once]
    ends = points[segments[:, 0]]
    off = [np.linalg.norm(curve.at(curve.nearest(ends)) - ends, axis=1) for curve in curves]
    return Mesh(
        "curved", points, quads, segments, True, curved=CurvedEdges(segments, np.argmin(off, axis=0), curves)
    )  # fmt: skip


def straight(mesh: Mesh) -> Mesh:
    """The mesh without its curves."""
    return Mesh(mesh.name, mesh.vertices, mesh.quads, mesh.segments, mesh.complete)


def jacobians(mesh: HighOrder, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """At the tensor products of (p,) places: places (m, p^2, 2), Jacobians (m, p^2, 2, 2), determinants (m, p^2)."""
    value, slope = lagrange.values(mesh.stations, points), lagrange.derivatives(mesh.stations, points)
    grid = mesh.nodes[mesh.grid]
    shape = (len(grid), len(points) ** 2, 2)
    places = np.einsum("pi,qj,mjic->mqpc", value, value, grid).reshape(shape)
    along = np.einsum("pi,qj,mjic->mqpc", slope, value, grid).reshape(shape)
    across = np.einsum("pi,qj,mjic->mqpc", value, slope, grid).reshape(shape)
    return places, np.stack([along, across], axis=-1), along[..., 0] * across[..., 1] - along[..., 1] * across[..., 0]


def area(mesh: HighOrder) -> float:
    points, weights = lagrange.gauss(mesh.order + 1)
    return float((jacobians(mesh, points)[2] @ np.outer(weights, weights).ravel()).sum())
