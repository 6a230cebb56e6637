"""One line of the comparison."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from freemesh_ray.compare.boundary_change import BoundaryChange
from freemesh_ray.compare.mixed_mesh import MixedMesh
from freemesh_ray.meshes.metrics import measure


@dataclass(frozen=True)
class Row:
    """A mesher on a domain.

    Attributes:
        domain: the domain's name.
        mesher: the mesher's.
        figures: of its mesh, by the names of :func:`figures`; None when it failed.
        boundary: what became of the given boundary; None when it failed.
        failure: why there is no mesh; "" when there is.
    """

    domain: str
    mesher: str
    figures: Mapping[str, float] | None
    boundary: BoundaryChange | None
    failure: str


def figures(mesh: MixedMesh) -> dict[str, float]:
    """Those of metrics.measure, ``seconds`` and ``elements_per_second``, both NaN where the time is unknown."""
    found = measure(mesh)
    speed = found["elements"] / mesh.seconds if mesh.seconds > 0 else math.nan
    return found | {"seconds": mesh.seconds, "elements_per_second": speed}
