"""freemesh-ray: reinforcement learning that meshes polygons, and the experiment platform around it.

>>> mesh = freemesh_ray.mesh(shapely.Polygon(...), edge_length=0.1)
>>> mesh.write("part.inp")
>>> run = freemesh_ray.train({"curriculum.stages": ["T1"]}, callbacks=[freemesh_ray.ProgressLine()])
>>> study = freemesh_ray.study("mine.yaml")
>>> results = tune.Tuner(freemesh_ray.trainable, param_space={"learner.gamma": tune.grid_search([0.9, 0.99])}).fit()
"""

from __future__ import annotations

from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from envs.errors import PluginError
    from envs.polygons.layers_along import BoundaryLayers
    from freemesh_ray.api.run_study import study
    from freemesh_ray.api.run_training import train
    from freemesh_ray.api.tune_class import MeshTrainable as trainable
    from freemesh_ray.mesher.polygon_to_mesh import Mesh, mesh
    from freemesh_ray.training.callback import Callback, StopTraining
    from freemesh_ray.training.progress_line import ProgressLine
    from freemesh_ray.training.run import Run

    __version__: str

__all__ = [
    "BoundaryLayers", "Callback", "Mesh", "PluginError", "ProgressLine", "Run", "StopTraining", "mesh", "study",
    "train", "trainable",
]  # fmt: skip

#: Where each lies; imported on demand: the mesher needs no platform, and the platform no mesher.
_PLACES = {
    "BoundaryLayers": "envs.polygons.layers_along:BoundaryLayers",
    "Callback": "freemesh_ray.training.callback:Callback",
    "Mesh": "freemesh_ray.mesher.polygon_to_mesh:Mesh",
    "PluginError": "envs.errors:PluginError",
    "ProgressLine": "freemesh_ray.training.progress_line:ProgressLine",
    "Run": "freemesh_ray.training.run:Run",
    "StopTraining": "freemesh_ray.training.callback:StopTraining",
    "mesh": "freemesh_ray.mesher.polygon_to_mesh:mesh",
    "study": "freemesh_ray.api.run_study:study",
    "train": "freemesh_ray.api.run_training:train",
    "trainable": "freemesh_ray.api.tune_class:MeshTrainable",
}


def __getattr__(name: str) -> Any:
    if name in _PLACES:
        return resolve_name(_PLACES[name])
    if name == "__version__":  # it stands in pyproject.toml alone
        from importlib.metadata import version

        return version("freemesh-ray")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
