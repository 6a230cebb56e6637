"""Wavefront's ``.obj``: vertices and faces, for modelling programs."""

from __future__ import annotations

from pathlib import Path

from freemesh_ray.export.finite_elements import FiniteElements


def write(mesh: FiniteElements, path: Path) -> None:
    """Write a face for every element, which has four nodes."""
    vertices = (f"v {x!r} {y!r} 0.0" for x, y in mesh.nodes.tolist())
    faces = (f"f {' '.join(map(str, face))}" for face in (mesh.elements + 1).tolist())
    path.write_bytes("\n".join([f"# {mesh.title}", *vertices, *faces, ""]).encode("ascii"))
