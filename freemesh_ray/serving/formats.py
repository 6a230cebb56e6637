"""The formats that a mesh can be answered in: JSON, and the files that the package writes."""

from __future__ import annotations

import json
import math
import tempfile
from pathlib import Path
from typing import Final

from envs.mesh import Mesh
from freemesh_ray import export
from freemesh_ray.mesh_geometry.metrics import measure
from freemesh_ray.storage.atomic import OutputError

JSON: Final = "json"

#: Media type of each format; all but JSON are those of `export.FORMATS` of one file, without their dot.
MEDIA_TYPES = {
    JSON: "application/json",
    **{suffix[1:]: format.media_type for suffix, format in export.FORMATS.items() if not format.folder},
}


def encoded(mesh: Mesh, name: str, seconds: float) -> bytes:
    """The mesh as the body of an answer.

    Args:
        mesh: complete.
        name: of the format, a key of `MEDIA_TYPES`.
        seconds: that the meshing took; only JSON tells.

    Raises:
        OutputError: a mesh that the format cannot hold.
    """
    return as_json(mesh, seconds) if name == JSON else as_file(mesh, name)


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


def as_file(mesh: Mesh, name: str) -> bytes:
    """The file that `export.write` writes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{mesh.name}.{name}"
        try:
            export.write(mesh, path)
        except OutputError as error:
            # The temporary folder's name means nothing to a client.
            raise OutputError(str(error).replace(str(path), path.name)) from None
        return path.read_bytes()
