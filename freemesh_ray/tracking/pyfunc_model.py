"""A policy as an MLflow model: polygons in, meshes out. MLflow runs a copy of this file when it loads the model.

    model = mlflow.pyfunc.load_model("models:/NAME@best")
    model.predict([{"geojson": '{"type": "Polygon", "coordinates": [...]}', "edge_length": 0.1}])

The input has a row for each polygon, with the columns

    geojson      text: a GeoJSON Polygon; its vertices are the boundary's unless ``edge_length`` is given
    edge_length  optional: split the boundary into pieces of about this length, in the polygon's units
    grading      optional: largest over smallest piece (1: all alike)

and the answer, for each row, ``vertices`` (n pairs), ``quads`` (m quadruples of indices, counter-clockwise) and
``quality``, the mesh's figures by name (see freemesh_ray.mesh_geometry.metrics.measure).
"""

from __future__ import annotations

import json
import math
from typing import Any

import mlflow
import pandas as pd
from mlflow.exceptions import MlflowException
from mlflow.pyfunc import PythonModel

from envs.types import DomainError
from freemesh_ray.mesher import MeshingError
from freemesh_ray.mesher.polygon_to_mesh import mesh
from freemesh_ray.policies.policy import Policy


class PolygonMesher(PythonModel):
    """The mesher with the policy that is the model's artifact ``policy``."""

    def load_context(self, context: Any) -> None:
        """Read the policy."""
        self.policy = Policy.load(context.artifacts["policy"])

    def predict(self, context: Any, model_input: pd.DataFrame, params: Any = None) -> list[dict[str, Any]]:
        """The mesh of every row; ``context`` and ``params`` are MLflow's and not used.

        Raises:
            MlflowException: a polygon that cannot be meshed; a server answers 400 with the line that says why.
        """
        return [self._mesh(row, f"row {number}") for number, row in enumerate(model_input.to_dict("records"))]

    def _mesh(self, row: dict[str, Any], name: str) -> dict[str, Any]:
        given = {key: row[key] for key in ("edge_length", "grading") if not _absent(row.get(key))}
        try:
            made = mesh(_polygon(row["geojson"], name), name=name, policy=self.policy, **given)
        except (DomainError, MeshingError) as error:
            raise MlflowException.invalid_parameter_value(str(error)) from error
        return {
            "vertices": made.vertices.tolist(),
            "quads": made.quads.tolist(),
            "quality": {key: float(value) for key, value in made.quality().items()},
        }


def _polygon(text: str, name: str) -> dict[str, Any]:
    """The GeoJSON object in ``text``.

    Raises:
        DomainError: there is none.
    """
    try:
        shape = json.loads(text)
    except (ValueError, TypeError, RecursionError) as error:
        raise DomainError(f"{name}: geojson is not JSON ({error}): give a GeoJSON Polygon as text") from error
    if not isinstance(shape, dict):
        raise DomainError(f"{name}: geojson is no object: give a GeoJSON Polygon as text")
    return shape


def _absent(value: Any) -> bool:
    return value is None or math.isnan(value)


mlflow.models.set_model(PolygonMesher())
