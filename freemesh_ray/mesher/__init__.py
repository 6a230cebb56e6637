"""Policy and domain in, mesh out."""

from freemesh_ray.mesher.meshing import Made, MeshingError, make

__all__ = ["Made", "MeshingError", "make"]
