"""What a mesh can be answered as."""

from __future__ import annotations

import json
import math
import tempfile
from pathlib import Path
from typing import Final

from envs.mesh import Mesh
from freemesh_ray import export
from freemesh_ray.meshes.metrics import measure
from freemesh_ray.storage.atomic import OutputError

JSON: Final = "json"

#: Content type of each format.
MEDIA = {
    JSON: "application/json",
    "inp": "text/plain; charset=us-ascii",
    "msh": "model/mesh",
    "vtu": "application/xml",
    "bdf": "text/plain; charset=us-ascii",
    "obj": "model/obj",
}


def encoded(mesh: Mesh, form: str, seconds: float) -> bytes:
    """The mesh as the body of an answer.

    Args:
        mesh: complete.
        form: one of `MEDIA`.
        seconds: that the meshing took; ``json`` tells.

    Raises:
        OutputError: a mesh that the format cannot hold.
    """
    return as_json(mesh, seconds) if form == JSON else as_file(mesh, form)


def as_json(mesh: Mesh, seconds: float) -> bytes:
    """``vertices`` (n pairs), ``quads`` (m quadruples, counter-clockwise), ``quality`` (see metrics.measure)."""
    quality = {name: value if math.isfinite(value) else None for name, value in measure(mesh).items()}
    answer = {
        "vertices": mesh.vertices.tolist(),
        "quads": mesh.quads.tolist(),
        "quality": quality,
        "seconds": round(seconds, 6),
    }
    return json.dumps(answer, separators=(",", ":")).encode("ascii")


def as_file(mesh: Mesh, form: str) -> bytes:
    """What freemesh_ray.export writes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{mesh.name}.{form}"
        try:
            export.write(mesh, path)
        except OutputError as error:
            # The folder is nobody's business.
            raise OutputError(str(error).replace(str(path), path.name)) from None
        return path.read_bytes()
