"""A mesh in, a better one out; the boundary stays as it is."""

from freemesh_ray.finish.finish import Finished, finish

__all__ = ["Finished", "finish"]
