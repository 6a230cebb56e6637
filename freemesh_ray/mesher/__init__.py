"""Policy and domain in, mesh out."""

from freemesh_ray.mesher.domain_to_mesh import MeshingError, MeshResult, check_memory, mesh_domain

__all__ = ["MeshResult", "MeshingError", "check_memory", "mesh_domain"]
