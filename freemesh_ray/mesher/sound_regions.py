"""One mesh of those regions of a geometry that have one, where others have none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from envs.errors import UserError
from envs.polygons.geometry import Geometry
from envs.types import Domain, WantedSizes
from freemesh_ray.mesher.polygon_to_mesh import Mesh
from freemesh_ray.policies.policy import Policy


def mesh_of_sound(
    geometry: Geometry,
    policy: Policy,
    wishes: Callable[[Domain], WantedSizes],
    left_out: Callable[[str, UserError], None],
    **options: Any,
) -> Mesh | None:
    """The mesh of a geometry without those regions that cannot be meshed; None: none of them can.

    Args:
        geometry, policy, wishes, options: as of `Mesh.from_geometry`.
        left_out: called with the name of each domain that is left out, and why.

    Raises:
        UserError: what no region is at fault of.
    """
    regions = list(geometry.regions)
    while regions:
        try:
            return Mesh.from_geometry(replace(geometry, regions=tuple(regions)), policy, wishes, **options)
        except UserError as error:
            bad = next((region for region in regions if str(error).startswith(f"{region.domain.name}: ")), None)
            if bad is None:
                raise
            left_out(bad.domain.name, error)
            regions.remove(bad)
    return None
