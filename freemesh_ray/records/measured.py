"""What was measured of a training's best policy, so that the policy is not needed to report on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from envs.mesh import Mesh


@dataclass(frozen=True)
class Measured:
    """Figures of one policy.

    Attributes:
        episodes: on each domain, of each mode.
        figures: domain -> `evaluation.metric` of a mode and a figure -> mean over the episodes.
        digests: domain -> what it was then (`freemesh_ray.report.transfer.domain_digest`).
        meshes: domain -> what it cuts there; empty where another seed of its variant is better.
        commit: of the source that trained it; empty where that is not known.
    """

    episodes: int = 0
    figures: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    digests: Mapping[str, str] = field(default_factory=dict)
    meshes: Mapping[str, Mesh] = field(default_factory=dict)
    commit: str = ""


def as_recorded(mesh: Mesh) -> Mesh:
    """The mesh with its vertices as records keep them, in single precision."""
    return replace(mesh, vertices=mesh.vertices.astype(np.float32).astype(np.float64))


def checked_mesh(name: str, vertices: object, quads: object, segments: object, complete: object) -> Mesh:
    """The mesh of a record: its columns as lists.

    Raises:
        ValueError: they are none.
    """
    points = np.array(vertices, dtype=np.float64).reshape(-1, 2)
    elements, ends = (
        np.array(given, dtype=np.int64).reshape(-1, width) for given, width in ((quads, 4), (segments, 2))
    )
    if len(points) < 3 or not np.isfinite(points).all() or not isinstance(complete, bool):
        raise ValueError(f"the mesh of {name[:40]} has no points")
    for places in (elements, ends):
        if places.size and not (places.min() >= 0 and places.max() < len(points)):
            raise ValueError(f"the mesh of {name[:40]} names vertices that it has not")
    return Mesh(name, points, elements, ends, complete)
