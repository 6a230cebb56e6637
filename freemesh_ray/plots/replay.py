"""The growth of a mesh as a page: one HTML file that plays it element by element, in the order they were cut.

The page needs nothing but itself. Its coordinates are whole numbers on a grid of `GRID` steps along the longer side of
the domain: exact enough for any screen, not for computing (for that see :mod:`freemesh_ray.export`).
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from envs.mesh import Mesh
from envs.quality import element_quality
from envs.types import Floats
from freemesh_ray.formatting.html import embedded
from freemesh_ray.mesh_geometry.metrics import irregular
from freemesh_ray.plots.colours import FEW, MANY, scale
from freemesh_ray.storage.atomic import OutputError, replacing

#: Steps along the longer side of the domain, and steps of quality from 0 to 1.
GRID, ETA_UNIT = 10**7, 10**4
#: Colours of the quality scale.
SHADES = 64
#: Where the template takes the data.
PLACEHOLDER = "{{data}}"


#: What a replay is written as.
SUFFIX = ".html"


def write(mesh: Mesh, path: str | Path, finished: Mesh | None = None) -> None:
    """Write the page; the file is there as a whole or not at all.

    Args:
        mesh: complete or not; its elements appear in the order of ``quads``.
        path: of the HTML file; missing folders are made.
        finished: the mesh of the same domain after smoothing and clean-up, which may have other elements; shown at the
            end, and at the touch of a button.

    Raises:
        OutputError: a mesh without elements, or a place that cannot be written to.
    """
    path = Path(path)
    for each in (mesh, finished):
        if each is not None and not len(each.quads):
            raise OutputError(f"{path}: {each.name} has no elements: there is nothing to replay")
    template = files("freemesh_ray.plots").joinpath("replay.html").read_text(encoding="utf-8")
    page = template.replace(PLACEHOLDER, embedded(_data(mesh, finished)))
    with replacing(path) as draft:
        draft.write_text(page, encoding="utf-8")


def _data(mesh: Mesh, finished: Mesh | None) -> dict[str, Any]:
    """What the page knows; a coordinate is ``origin + step * number``."""
    points = np.concatenate([each.vertices for each in (mesh, finished) if each is not None])
    low = points.min(axis=0)
    size = points.max(axis=0) - low
    step = float(size.max()) / GRID
    return {
        "name": mesh.name,
        "origin": low.tolist(),
        "step": step,
        "size": np.rint(size / step).astype(np.int64).tolist(),
        "area": float(mesh.areas.sum()) / step**2,
        "etaUnit": ETA_UNIT,
        "scale": scale(SHADES),
        "few": FEW,
        "many": MANY,
        "raw": _part(mesh, low, step),
        "finished": None if finished is None else _part(finished, low, step),
    }


def _part(mesh: Mesh, low: Floats, step: float) -> dict[str, Any]:
    """One mesh, its arrays flat."""
    nodes, valence = irregular(mesh), mesh.valence
    return {
        "complete": mesh.complete,
        "vertices": np.rint((mesh.vertices - low) / step).astype(np.int64).ravel().tolist(),
        "quads": mesh.quads.ravel().tolist(),
        "eta": np.rint(element_quality(mesh.vertices, mesh.quads) * ETA_UNIT).astype(np.int64).tolist(),
        "segments": mesh.segments.ravel().tolist(),
        "few": nodes[valence[nodes] < 4].tolist(),
        "many": nodes[valence[nodes] > 4].tolist(),
    }
