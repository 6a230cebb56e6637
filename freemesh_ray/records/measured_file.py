"""What a run folder without a policy has of its policy's figures: ``measured.json``, opened from records."""

from __future__ import annotations

import json
from pathlib import Path

from freemesh_ray.records.measured import Measured, checked_mesh
from freemesh_ray.records.schema import FIGURES, MESH
from freemesh_ray.storage.atomic import replacing
from freemesh_ray.storage.json_file import read_json

#: Name of the file.
FILE = "measured.json"


def write(run: Path, measured: Measured) -> None:
    """Write it into a run folder.

    Raises:
        OutputError: the place cannot be written to.
    """
    meshes = {
        domain: dict(zip(MESH, (mesh.vertices.ravel().tolist(), mesh.quads.ravel().tolist(),
                                mesh.segments.ravel().tolist(), bool(mesh.complete)), strict=True))
        for domain, mesh in measured.meshes.items()
    }  # fmt: skip
    told = {"commit": measured.commit, "episodes": measured.episodes, "digests": dict(measured.digests),
            "figures": {domain: dict(figures) for domain, figures in measured.figures.items()},
            "meshes": meshes}  # fmt: skip
    with replacing(run / FILE) as draft:
        draft.write_text(json.dumps(told), encoding="utf-8")


def read(run: Path) -> Measured | None:
    """What a run folder has; None where it has nothing, or it is damaged."""
    try:
        told = read_json(run / FILE)
        figures = {
            str(domain): {str(name): float(value) for name, value in found.items() if name.startswith(FIGURES)}
            for domain, found in told["figures"].items()
        }
        meshes = {
            str(domain): checked_mesh(str(domain), *(found[column] for column in MESH))
            for domain, found in told["meshes"].items()
        }
        digests = {str(domain): str(digest) for domain, digest in told["digests"].items()}
        return Measured(int(told["episodes"]), figures, digests, meshes, str(told["commit"]))
    except (OSError, ValueError, TypeError, KeyError, AttributeError, OverflowError):
        return None
