"""freemesh-ray: reinforcement learning that meshes polygons, and the experiment platform around it.

>>> mesh = freemesh_ray.mesh(shapely.Polygon(...), edge_length=0.1)
>>> mesh.write("part.inp")
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from envs.errors import PluginError
    from freemesh_ray.mesher.api import Mesh, mesh
    from freemesh_ray.training.callback import Callback, StopTraining

    __version__: str

__all__ = ["Callback", "Mesh", "PluginError", "StopTraining", "mesh"]

#: Where each lies; imported on demand: the mesher needs no platform, and the platform no mesher.
_MODULES = {
    "Callback": "freemesh_ray.training.callback",
    "Mesh": "freemesh_ray.mesher.api",
    "PluginError": "envs.errors",
    "StopTraining": "freemesh_ray.training.callback",
    "mesh": "freemesh_ray.mesher.api",
}


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(_MODULES[name]), name)
    if name == "__version__":  # it stands in pyproject.toml alone
        from importlib.metadata import version

        return version("freemesh-ray")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
