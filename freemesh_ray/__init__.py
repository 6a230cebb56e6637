"""freemesh-ray: reinforcement learning that meshes polygons, and the experiment platform around it.

>>> mesh = freemesh_ray.mesh(shapely.Polygon(...), edge_length=0.1)
>>> mesh.write("part.inp")
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from freemesh_ray.mesher.api import Mesh, mesh

    __version__: str

__all__ = ["Mesh", "mesh"]


def __getattr__(name: str) -> Any:
    # On demand: the platform's processes need no mesher.
    if name in __all__:
        from freemesh_ray.mesher import api

        return getattr(api, name)
    if name == "__version__":  # it stands in pyproject.toml alone
        from importlib.metadata import version

        return version("freemesh-ray")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
