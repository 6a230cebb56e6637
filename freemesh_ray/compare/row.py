"""One line of the comparison."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from envs.mdp.size_field import size_field, sizes_at
from envs.types import Domain, Floats, MeshingParameters
from freemesh_ray.compare.boundary_change import BoundaryChange
from freemesh_ray.compare.mixed_mesh import MixedMesh
from freemesh_ray.mesh_geometry import wanted_sizes
from freemesh_ray.mesh_geometry.metrics import angles_within, measure


@dataclass(frozen=True)
class Row:
    """A mesher on a domain.

    Attributes:
        domain: the domain's name.
        mesher: the mesher's.
        figures: of its mesh, by the names of :func:`figures`; None when it failed.
        boundary: what became of the given boundary; None when it failed.
        failure: why there is no mesh; "" when there is.
        remark: what is to be known of it beside its figures; "" for nothing.
    """

    domain: str
    mesher: str
    figures: Mapping[str, float] | None
    boundary: BoundaryChange | None
    failure: str
    remark: str = ""


def figures(mesh: MixedMesh, domain: Domain) -> dict[str, float]:
    """What is measured of a mesh of a domain.

    Returns:
        Those of metrics.measure.
        ``angles_45_135``, ``angles_60_120``: see metrics.angles_within.
        ``longest_edge``, ``elements_over_wanted``, ``sized_share``, ``neighbour_ratio``: see sizes; the lengths wanted
        are those of the domain's size field, the boundary's own at the boundary.
        ``seconds`` and ``elements_per_second``: NaN where the time is unknown.
    """
    found = measure(mesh)
    speed = found["elements"] / mesh.seconds if mesh.seconds > 0 else math.nan
    field = size_field(domain, MeshingParameters().size_gradient)

    def wanted(places: Floats) -> Floats:
        return sizes_at(field, places)

    return {
        **found,
        "angles_45_135": angles_within(mesh, 45.0, 135.0),
        "angles_60_120": angles_within(mesh, 60.0, 120.0),
        "longest_edge": wanted_sizes.longest_edge(mesh, wanted),
        "elements_over_wanted": wanted_sizes.elements_over_wanted(mesh, wanted),
        "sized_share": wanted_sizes.sized_share(mesh, wanted),
        "neighbour_ratio": wanted_sizes.neighbour_ratio(mesh),
        "seconds": mesh.seconds,
        "elements_per_second": speed,
    }
