"""The values behind the box plots and the paper's table: those of all of a mesher's meshes together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from envs.types import Floats
from freemesh_ray.compare.mixed_mesh import MixedMesh
from freemesh_ray.mesh_geometry.metrics import by_element, irregular, irregular_authors


def pooled(metrics: Sequence[str], meshers: Sequence[str], meshes: Sequence[MixedMesh]) -> dict[str, dict[str, Floats]]:
    """Metric -> mesher -> values, (k,): one for each quadrilateral, or one for each mesh where the metric is a count.

    Args:
        metrics: keys of metrics.by_element, ``singularity``, ``singularity_authors``, ``triangles``.
        meshers: their names; one without meshes has no values.
        meshes: those of all of them.
    """
    values = [(mesh.mesher, values_of(mesh)) for mesh in meshes]
    return {
        metric: {
            name: np.concatenate([np.empty(0), *(found[metric] for mesher, found in values if mesher == name)])
            for name in meshers
        }
        for metric in metrics
    }


def values_of(mesh: MixedMesh) -> dict[str, Floats]:
    """The values of one mesh by metric."""
    counts = {
        "singularity": len(irregular(mesh)),
        "singularity_authors": len(irregular_authors(mesh)),
        "triangles": len(mesh.triangles),
    }
    return by_element(mesh) | {name: np.array([float(count)]) for name, count in counts.items()}
