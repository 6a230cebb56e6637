"""Policy and domain in, mesh out."""

from freemesh_ray.mesher.meshing import MeshingError, mesh

__all__ = ["MeshingError", "mesh"]
