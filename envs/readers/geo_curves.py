"""The curves of Gmsh scripts: exact, and as polylines."""

from __future__ import annotations

import numpy as np

from envs.polygons import curves
from envs.polygons.curves import Flattening
from envs.polygons.exact_curves import CircleArc, EllipseArc, ParametricCurve, arc_between
from envs.polygons.rings import EDGE_LENGTH
from envs.polygons.turning import signed_angles
from envs.readers.geo_model import Curve, Model
from envs.types import Curve as ExactCurve
from envs.types import DomainError, Floats

#: What curves are called, and the fewest points of each.
LEAST_POINTS = {"Line": 2, "Circle": 3, "Ellipse": 3, "Spline": 2, "BSpline": 2, "Bezier": 4}

#: Control points of a Bezier curve at most: its degree is one less, and its points take time with the square of that.
MOST_BEZIER = 50

#: The radii at an arc's ends may differ by this share; Gmsh lets them by a tenth.
SAME_RADIUS = 1e-2

#: A sweep as close to half a turn (radians) is one.
HALF = 1e-9

#: Two directions whose cross product is below this share of their lengths are one.
PARALLEL = 1e-12

#: How finely a curve is followed to count its segments along it.
ALONG = Flattening(np.inf, np.inf, np.radians(0.2))


def given_points(model: Model, curve: Curve) -> Floats:
    """(k, 2) the points that a curve is stated by."""
    return np.array([model.points[tag][:2] for tag in curve.points])


def reach(curve: Curve) -> Floats:
    """(k, 2) places along a curve that its points do not tell, about as far apart as it reaches."""
    path = curve.exact
    if path is None:
        return np.empty((0, 2))
    if isinstance(path, ParametricCurve):
        return path.at(path.breaks)
    assert isinstance(path, CircleArc | EllipseArc)
    return path.at(path.start + path.sweep * np.linspace(0.0, 1.0, 9))


def exact(model: Model, curve: Curve, source: str) -> ExactCurve | None:
    """The curve itself; None: it is straight between its points.

    Raises:
        DomainError: points that no such curve goes through.
    """
    if curve.exact is not None:
        return curve.exact
    given = given_points(model, curve)
    if curve.name == "Line" or len(given) == 2:
        return None
    where = f"{source}: line {curve.line}"
    if curve.name == "Circle":
        return circle_arc(given, where)
    if curve.name == "Ellipse":
        return ellipse_arc(given, where)
    return {"Spline": spline, "BSpline": b_spline, "Bezier": bezier}[curve.name](given)


def flattened(model: Model, curve: Curve, fineness: Flattening, source: str) -> Floats:
    """A curve as a (k, 2) polyline that starts and ends exactly at its end points."""
    given = given_points(model, curve)
    path = exact(model, curve, source)
    if path is None:
        return given
    if isinstance(path, ParametricCurve):
        points = curves.sampled(path.at, path.breaks, fineness)
        # A closed B-spline does not go through its points.
        closed = curve.name == "BSpline" and curve.points[0] == curve.points[-1]
        return points if closed else curves.pinned(points, given[0], given[-1])
    if isinstance(path, EllipseArc):
        points = curves.ellipse(path.centre, path.major, path.minor, path.start, path.sweep, fineness)
    elif isinstance(path, CircleArc) and curve.points[0] != curve.points[-1]:
        return curves.arc_between(given[0], given[-1], path.sweep, fineness)
    else:
        assert isinstance(path, CircleArc)
        points = curves.arc(path.centre, path.radius, path.start, path.sweep, fineness)
    return curves.pinned(points, given[0], given[-1])


def counted(model: Model, tag: int, source: str) -> Floats:
    """A transfinite curve: its stated number of segments, each ``ratio`` times as long as the one before."""
    segments, law, ratio = model.counts[tag]
    if law != "Progression" or not 1e-3 <= ratio <= 1e3:
        raise DomainError(
            f"{source}: points by {law[:20]} {ratio:g} are not understood; use Progression or {EDGE_LENGTH}"
        )
    steps = ratio ** np.arange(segments, dtype=np.float64) if abs(np.log(ratio)) * segments < 600 else np.ones(segments)
    share = np.concatenate([[0.0], np.cumsum(steps) / steps.sum()])
    fine = flattened(model, model.curves[tag], ALONG, source)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    points = np.stack([np.interp(share * along[-1], along, fine[:, axis]) for axis in (0, 1)], axis=1)
    return curves.pinned(points, fine[0], fine[-1])


def circle_arc(given: Floats, where: str) -> CircleArc:
    """The arc from a start to an end around a centre (rows 0, 2, 1): of less than half a turn, or half of one, to the
    left.
    """
    start, centre, end = given
    u, v = start - centre, end - centre
    radius, other = np.linalg.norm(u), np.linalg.norm(v)
    if radius == 0.0 or abs(radius - other) > SAME_RADIUS * radius:
        raise DomainError(f"{where}: an arc whose ends are {radius:g} and {other:g} from its centre; correct a point")
    sweep = float(signed_angles(u, v))
    if abs(np.sin(sweep / 2.0)) < PARALLEL:
        raise DomainError(f"{where}: an arc that ends where it starts; split the circle into three or more")
    if np.pi - abs(sweep) < HALF:
        sweep = np.pi
    return arc_between(start, end, sweep)


def ellipse_arc(given: Floats, where: str) -> EllipseArc:
    """The arc from a start to an end of the ellipse around a centre, with a point on its major axis.

    In coordinates (x, y) along and across the major axis both ends satisfy x^2 / a^2 + y^2 / b^2 = 1, two linear
    equations for 1 / a^2 and 1 / b^2. Three points are start, centre and end; the start then lies on the major axis.
    """
    start, centre, end = given[0], given[1], given[-1]
    axis = (given[2] if len(given) > 3 else start) - centre
    length = float(np.linalg.norm(axis))
    along = axis / (length or 1.0)
    across = np.array([-along[1], along[0]])
    local = np.array([[(p - centre) @ along, (p - centre) @ across] for p in (start, end)])
    scale = float(np.abs(local).max())
    fault = DomainError(f"{where}: no ellipse around this centre and axis goes through both ends; correct a point")
    if length == 0.0 or scale == 0.0:
        raise fault
    squares = (local / scale) ** 2
    if abs(np.linalg.det(squares)) < PARALLEL:
        raise fault
    inverse = np.linalg.solve(squares, np.ones(2))
    if not (inverse > 0.0).all():
        raise fault
    a, b = scale / np.sqrt(inverse)
    first, last = np.arctan2(local[:, 1] / b, local[:, 0] / a)
    sweep = float((last - first + np.pi) % (2 * np.pi) - np.pi)
    return EllipseArc(centre, a * along, b * across, float(first), sweep)


def spline(given: Floats) -> ParametricCurve:
    """A uniform Catmull-Rom spline; a closed one is smooth where it closes, an open one ends by mirrored points."""
    closed = bool((given[0] == given[-1]).all())
    before = given[-2] if closed else 2 * given[0] - given[1]
    after = given[1] if closed else 2 * given[-1] - given[-2]
    return cubics(np.concatenate([before[None], given, after[None]]), curves.CATMULL_ROM)


def b_spline(given: Floats) -> ParametricCurve:
    """A cubic B-spline over uniform knots, clamped at its ends; a closed one is smooth where it closes.

    A closed one does not go through its points, not even through the first; of few points the degree is lower.
    """
    from scipy.interpolate import BSpline  # half a second that other files need not wait

    if (given[0] == given[-1]).all() and len(given) > 3:
        return cubics(np.concatenate([given[-2:-1], given, given[1:2]]), curves.B_SPLINE)
    degree = min(3, len(given) - 1)
    knots = np.arange(len(given) - degree + 1, dtype=np.float64)
    clamped = np.concatenate([np.full(degree, knots[0]), knots, np.full(degree, knots[-1])])
    return ParametricCurve(BSpline(clamped, given, degree), knots)


def bezier(given: Floats) -> ParametricCurve:
    """A Bezier curve of the degree that its points ask for."""
    from scipy.interpolate import BSpline

    degree = len(given) - 1
    return ParametricCurve(BSpline(np.repeat([0.0, 1.0], degree + 1), given, degree), np.array([0.0, 1.0]))


def cubics(points: Floats, matrix: Floats) -> ParametricCurve:
    """A curve of one cubic piece for every four consecutive of (n, 2) points; a row of the matrix for each power."""
    from scipy.interpolate import PPoly

    controls = np.stack([points[i : len(points) - 3 + i] for i in range(4)], axis=1)
    breaks = np.arange(len(controls) + 1, dtype=np.float64)
    return ParametricCurve(PPoly(np.moveaxis(matrix @ controls, 1, 0), breaks), breaks)
