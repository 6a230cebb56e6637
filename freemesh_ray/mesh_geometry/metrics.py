"""What a mesh is worth in numbers: the paper's eight metrics, under the paper's definitions and the authors'.

Element metrics are of the quadrilaterals; vertices are judged by triangles, too, where a mesher left some.

Corner, edge and triangle order of a quadrilateral a b c d:

    d ---- c        edges      ab, bc, cd, da
    |      |        corners    a, b, c, d
    a ---- b        diagonals  ac, bd

Scaled Jacobian, stretch and taper are those of Verdict, as VTK computes them (Stimpson, Ernst, Knupp, Pebay, Thompson:
The Verdict Geometric Quality Library, SAND2007-1751).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from envs.quality import element_quality
from envs.types import Floats, Ints
from freemesh_ray.mesh_geometry.index import boundary_of, least_irregular
from freemesh_ray.mesh_geometry.protocol import PlaneMesh

#: Degrees by which an angle may be beyond a limit that it is meant to lie on.
ROUND_OFF = 1e-9


def by_element(mesh: PlaneMesh) -> dict[str, Floats]:
    """Each element metric of every quadrilateral, (m,) float64.

    Returns:
        ``eta``: element quality, in [0, 1], higher is better.
        ``min_angle``, ``max_angle``: |least angle - 90| and |largest angle - 90|, degrees, lower is better.
        ``min_angle_authors``, ``max_angle_authors``: least and largest of the four |angle - 90|, degrees.
        ``scaled_jacobian``: in [-1, 1], ``stretch``: in [0, 1], higher is better; ``taper``: >= 0, lower is better.
        ``taper_paper``: taper as the paper words it, in [0, 1] for convex elements, lower is better.
    """
    corners = mesh.vertices[mesh.quads]
    angles = inner_angles(corners)
    off_square = np.abs(angles - 90.0)
    return {
        "eta": element_quality(mesh.vertices, mesh.quads),
        "min_angle": np.abs(angles.min(axis=1) - 90.0),
        "max_angle": np.abs(angles.max(axis=1) - 90.0),
        "min_angle_authors": off_square.min(axis=1),
        "max_angle_authors": off_square.max(axis=1),
        "scaled_jacobian": scaled_jacobian(corners),
        "stretch": stretch(corners),
        "taper": taper(corners),
        "taper_paper": taper_by_triangles(corners),
    }


def measure(mesh: PlaneMesh) -> dict[str, float]:
    """The metrics of a mesh.

    Returns:
        ``elements``: their number, ``triangles`` included: how many have three corners.
        ``non_convex``: quadrilaterals with a corner of 180 degrees or more.
        ``singularity``: interior vertices whose valence is not 4 (the paper's definition).
        ``singularity_least``: those of valence 3 and 5 that the boundary asks for (see ``index``); NaN when the mesh is
        not complete.
        ``singularity_authors``: vertices, boundary included, of other than 1, 2 or 4 elements (the authors' code).
        Those of :func:`by_element`: means over the quadrilaterals, NaN when there are none.
        ``eta_p5``, ``eta_min``: 5th percentile and least element quality.
    """
    values = by_element(mesh)
    return {
        "elements": float(len(mesh.quads) + len(mesh.triangles)),
        "triangles": float(len(mesh.triangles)),
        "non_convex": float((inner_angles(mesh.vertices[mesh.quads]) >= 180.0).any(axis=1).sum()),
        "singularity": float(len(irregular(mesh))),
        "singularity_least": float(least_irregular(mesh.vertices, boundary_of(mesh)))
        if mesh.complete
        else float("nan"),
        "singularity_authors": float(len(irregular_authors(mesh))),
        **{name: _over(each) for name, each in values.items()},
        "eta_p5": _over(values["eta"], lambda eta: np.percentile(eta, 5)),
        "eta_min": _over(values["eta"], np.min),
    }


def irregular(mesh: PlaneMesh) -> Ints:
    """(k,) int64: the interior vertices whose valence is not 4.

    Interior is what elements surround: of an incomplete mesh, vertices on the front are not judged yet.
    """
    edges, counts = mesh.edges
    valence = np.bincount(edges.ravel(), minlength=len(mesh.vertices))
    inside = valence > 0
    inside[edges[counts == 1].ravel()] = False
    return np.flatnonzero(inside & (valence != 4))


def irregular_authors(mesh: PlaneMesh) -> Ints:
    """(k,) int64: the vertices, boundary included, that belong to other than 1, 2 or 4 elements."""
    corners = np.concatenate([mesh.quads.ravel(), mesh.triangles.ravel()])
    uses = np.bincount(corners, minlength=len(mesh.vertices))
    return np.flatnonzero(~np.isin(uses, (0, 1, 2, 4)))


def inner_angles(corners: Floats) -> Floats:
    """Inner angles in degrees, [0, 360), of counter-clockwise quadrilaterals: (m, 4, 2) -> (m, 4)."""
    ahead, behind = _sides(corners)
    return np.degrees(np.arctan2(_cross(ahead, behind), (ahead * behind).sum(axis=-1))) % 360.0


def angles_within(mesh: PlaneMesh, low: float, high: float) -> float:
    """The share of the quadrilaterals whose four inner angles lie in [low, high] degrees; NaN when there are none."""
    angles = inner_angles(mesh.vertices[mesh.quads])
    inside = (angles >= low - ROUND_OFF) & (angles <= high + ROUND_OFF)
    return _over(np.array(inside.all(axis=1), dtype=np.float64))


def scaled_jacobian(corners: Floats) -> Floats:
    """min over the corners of the sine of the inner angle, in [-1, 1]; 1 for a rectangle: (m, 4, 2) -> (m,)."""
    ahead, behind = _sides(corners)
    lengths = np.linalg.norm(ahead, axis=-1)
    # Verdict measures against the quadrilateral's own normal, which a clockwise one has downwards.
    first, second = _axes(corners)
    upwards = np.where(_cross(first, second) < 0, -1.0, 1.0)[:, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        sines = upwards * _cross(ahead, behind) / (lengths * np.roll(lengths, 1, axis=1))
    return np.where(lengths.min(axis=1) > 0, sines.min(axis=1), 0.0)


def stretch(corners: Floats) -> Floats:
    """sqrt(2) shortest edge / longest diagonal, in [0, 1]; 1 for a square: (m, 4, 2) -> (m,)."""
    edges = np.linalg.norm(_sides(corners)[0], axis=-1)
    diagonals = np.linalg.norm(corners[:, :2] - corners[:, 2:], axis=-1)
    return np.sqrt(2.0) * edges.min(axis=1) / diagonals.max(axis=1)


def taper(corners: Floats) -> Floats:
    """|X12| / min(|X1|, |X2|), >= 0; 0 for a parallelogram: (m, 4, 2) -> (m,).

    X1 = (b - a) + (c - d), X2 = (c - b) + (d - a), X12 = (a - b) + (c - d).
    """
    a, b, c, d = corners.swapaxes(0, 1)
    first, second = _axes(corners)
    return np.linalg.norm(a - b + c - d, axis=-1) / np.minimum(
        np.linalg.norm(first, axis=-1), np.linalg.norm(second, axis=-1)
    )


def taper_by_triangles(corners: Floats) -> Floats:
    """max |1 - A1 / A2| over both diagonals, A1 <= A2 the triangles' areas a diagonal separates: (m, 4, 2) -> (m,).

    In [0, 1] for a convex quadrilateral, 0 for a parallelogram. The paper does not say which triangle is above the
    line of the ratio; with the smaller one there the value is bounded.
    """
    areas = _cross(*_sides(corners))  # twice the triangle cut off at each corner
    pairs = np.stack([areas[:, :2], areas[:, 2:]], axis=-1)  # opposite corners share a diagonal
    with np.errstate(invalid="ignore", divide="ignore"):
        return (1.0 - pairs.min(axis=-1) / pairs.max(axis=-1)).max(axis=1)


def _axes(corners: Floats) -> tuple[Floats, Floats]:
    """The principal axes X1 and X2, each (m, 2)."""
    a, b, c, d = corners.swapaxes(0, 1)
    return (b - a) + (c - d), (c - b) + (d - a)


def _sides(corners: Floats) -> tuple[Floats, Floats]:
    """From each corner to the next and to the one before, each (m, 4, 2)."""
    return np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners


def _cross(first: Floats, second: Floats) -> Floats:
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]


def _over(values: Floats, statistic: Callable[[Floats], np.floating] = np.mean) -> float:
    """A statistic of the elements' values; NaN when there are no elements."""
    return float(statistic(values)) if len(values) else float("nan")
