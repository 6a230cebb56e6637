"""Policy and domain in, mesh out."""

from freemesh_ray.mesher.meshing import MeshingError, MeshResult, mesh_domain

__all__ = ["MeshResult", "MeshingError", "mesh_domain"]
