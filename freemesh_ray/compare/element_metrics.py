"""The eight metrics of a mixed mesh, element by element and as figures, under the paper's definitions and the authors'.

Element metrics are of the quadrilaterals; vertices are judged by all elements.
"""

from __future__ import annotations

import numpy as np

from envs.quality import element_quality
from envs.types import Floats, Ints
from freemesh_ray.compare.mixed_mesh import MixedMesh
from freemesh_ray.metrics import inner_angles, scaled_jacobian, stretch, taper


def by_element(mesh: MixedMesh) -> dict[str, Floats]:
    """Each element metric of every quadrilateral, (m,) float64.

    Returns:
        ``eta`` (paper, Eq. "element quality"); ``min_angle`` and ``max_angle``: |least angle - 90| and |largest angle
        - 90|, degrees; ``min_angle_authors`` and ``max_angle_authors``: least and largest of the four |angle - 90|;
        ``scaled_jacobian``, ``stretch``, ``taper`` as Verdict has them; ``taper_paper`` as the paper words it.
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


def taper_by_triangles(corners: Floats) -> Floats:
    """max |1 - A1 / A2| over both diagonals, A1 <= A2 the triangles' areas a diagonal separates: (m, 4, 2) -> (m,).

    In [0, 1] for a convex quadrilateral, 0 for a parallelogram. The paper does not say which triangle is above the
    line of the ratio; with the smaller one there the value is bounded.
    """
    ahead, behind = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    areas = ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]  # twice the triangle cut off at each corner
    pairs = np.stack([areas[:, :2], areas[:, 2:]], axis=-1)  # opposite corners share a diagonal
    with np.errstate(invalid="ignore", divide="ignore"):
        return (1.0 - pairs.min(axis=-1) / pairs.max(axis=-1)).max(axis=1)


def figures(mesh: MixedMesh) -> dict[str, float]:
    """The figures of a mesh; element metrics are means over the quadrilaterals (NaN when there are none).

    Returns:
        Those of :func:`by_element`, and ``eta_p5``, ``eta_min``: 5th percentile and least element quality; ``quads``,
        ``triangles``; ``non_convex``: quadrilaterals with a corner of 180 degrees or more; ``singularity``: interior
        vertices whose valence is not 4; ``singularity_authors``: vertices, boundary included, of other than 1, 2 or 4
        elements; ``seconds``; ``elements_per_second``.
    """
    values = by_element(mesh)
    eta = values["eta"]
    return {
        "quads": float(len(mesh.quads)),
        "triangles": float(len(mesh.triangles)),
        "non_convex": float((inner_angles(mesh.vertices[mesh.quads]) >= 180.0).any(axis=1).sum()),
        "singularity": float(len(irregular(mesh))),
        "singularity_authors": float(len(irregular_authors(mesh))),
        **{key: float(value.mean()) if len(value) else float("nan") for key, value in values.items()},
        "eta_p5": float(np.percentile(eta, 5)) if len(eta) else float("nan"),
        "eta_min": float(eta.min()) if len(eta) else float("nan"),
        "seconds": mesh.seconds,
        "elements_per_second": len(mesh) / mesh.seconds if mesh.seconds > 0 else float("nan"),
    }


def irregular(mesh: MixedMesh) -> Ints:
    """(k,) int64: the interior vertices whose valence is not 4."""
    distinct, _ = mesh.edges
    valence = np.bincount(distinct.ravel(), minlength=len(mesh.vertices))
    inside = np.ones(len(mesh.vertices), dtype=bool)
    inside[mesh.boundary.ravel()] = False
    return np.flatnonzero(inside & (valence != 4))


def irregular_authors(mesh: MixedMesh) -> Ints:
    """(k,) int64: the vertices, boundary included, that belong to other than 1, 2 or 4 elements."""
    corners = np.concatenate([mesh.quads.ravel(), mesh.triangles.ravel()])
    return np.flatnonzero(~np.isin(np.bincount(corners, minlength=len(mesh.vertices)), (1, 2, 4)))
