"""What a mesher did to the boundary that it was given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree

from envs.types import Domain
from freemesh_ray.compare.mixed_mesh import MixedMesh

#: Points closer than this share of the domain's diameter are one.
SAME = 1e-6


@dataclass(frozen=True)
class BoundaryChange:
    """The difference between a mesh's boundary and its domain's.

    Attributes:
        added: boundary vertices of the mesh that are no points of the domain.
        lost: boundary points of the domain that are no vertices of the mesh's boundary.
        off: those of ``added`` that do not lie on the domain's boundary.
        kept: whether the boundary edges are exactly the given segments.
    """

    added: int
    lost: int
    off: int
    kept: bool

    @property
    def split(self) -> bool:
        """Whether given segments were split and nothing else was done: the shape is the domain's."""
        return self.added > 0 and self.lost == self.off == 0

    def __str__(self) -> str:
        """For a cell of a table: ``kept``, ``+12 points``, or ``CHANGED`` with what was added and lost."""
        if self.kept:
            return "kept"
        if self.split:
            return f"+{self.added} points"
        return f"CHANGED +{self.added} -{self.lost}"


def boundary_change(mesh: MixedMesh, domain: Domain) -> BoundaryChange:
    """Compare the boundaries of a mesh and of its domain; points within `SAME` of each other are one."""
    near = SAME * domain.diameter
    own = mesh.vertices[np.unique(mesh.segments)]
    given = domain.points[np.unique(domain.segments)]
    new = own[cKDTree(given).query(own)[0] > near]
    lines = shapely.multilinestrings(shapely.linestrings(domain.points[domain.segments]))
    shapely.prepare(lines)
    off = ~shapely.dwithin(shapely.points(new), lines, near)
    lost = cKDTree(own).query(given)[0] > near
    return BoundaryChange(len(new), int(lost.sum()), int(off.sum()), mesh.keeps(domain))
